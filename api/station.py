"""The station as a whole: what it is doing, what it lost, how long a frame takes, which services there are."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import Response
from pydantic import BaseModel

from api.deps import JSON, ServiceDep, Viewer

router = APIRouter(prefix="/v1/station", tags=["station"])


class Latency(BaseModel):
    """From the last byte of a frame to its score, in seconds; null where no frame came."""

    p50: float | None
    p99: float | None


class Node(BaseModel):
    """A service that works on the same database."""

    node_id: str
    """New at every start."""
    name: str
    """Of its computer."""
    started_ns: int
    silent_seconds: float
    """Since it said that it lives; after 3 the others take it for gone."""
    state: str | None
    """As of this one; null where it is not known yet."""
    running: int | None


class Station(BaseModel):
    """Of this service, since it was started."""

    state: str
    """`ready`, `inspecting`, `at capacity`, `stopping`."""
    running: int
    capacity: int
    """Inspections at once, at the most."""
    frames: dict[str, int]
    """`scored`, `dropped` for want of room, `refused` as no picture of this product."""
    latency: Latency
    nodes: list[Node]
    """All services on this database, this one first; others as they were a second ago at the most."""


@router.get("", response_model=Station)
async def station(service: ServiceDep, who: Viewer) -> Response:
    """State, frames and latency since the start, the same figures as in /metrics; and who else is there."""
    frames = service.metrics.frames_by_outcome()
    told = Station(
        state=service.inspections.station.state,
        running=len(service.inspections.roster),
        capacity=service.settings.max_inspections,
        frames={outcome: frames.get(outcome, 0) for outcome in ("scored", "dropped", "refused")},
        latency=Latency(p50=service.metrics.latency(0.5), p99=service.metrics.latency(0.99)),
        nodes=[
            Node(
                node_id=node.node_id,
                name=node.name,
                started_ns=node.started_ns,
                silent_seconds=round(node.silent_seconds, 3),
                state=node.facts.get("state"),
                running=node.facts.get("running"),
            )
            for node in service.peers.nodes
        ],
    )
    return Response(told.model_dump_json(), 200, {"Cache-Control": "no-store"}, JSON)
