"""The station as a whole: what it is doing, what it lost, how long a frame takes."""

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


class Station(BaseModel):
    """Since the service was started."""

    state: str
    """`ready`, `inspecting`, `at capacity`, `stopping`."""
    running: int
    capacity: int
    """Inspections at once, at the most."""
    frames: dict[str, int]
    """`scored`, `dropped` for want of room, `refused` as no picture of this product."""
    latency: Latency


@router.get("", response_model=Station)
async def station(service: ServiceDep, who: Viewer) -> Response:
    """State, frames and latency since the start; the same figures as in /metrics."""
    frames = service.metrics.frames_by_outcome()
    told = Station(
        state=service.inspections.state,
        running=len(service.inspections.running),
        capacity=service.settings.max_inspections,
        frames={outcome: frames.get(outcome, 0) for outcome in ("scored", "dropped", "refused")},
        latency=Latency(p50=service.metrics.latency(0.5), p99=service.metrics.latency(0.99)),
    )
    return Response(told.model_dump_json(), 200, {"Cache-Control": "no-store"}, JSON)
