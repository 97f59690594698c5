"""Whether the service lives, whether it can work, and its figures; no token is needed for these."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.responses import Response

from api.deps import JSON, ServiceDep
from api.schemas import Health

router = APIRouter(tags=["health"])


@router.get("/livez")
async def alive() -> Health:
    """The event loop turns."""
    return Health(state="alive", reasons=[])


@router.get("/readyz", responses={200: {"model": Health}, 503: {"model": Health, "description": "It cannot work."}})
async def ready(service: ServiceDep) -> Response:
    """Whether the database answers, the folder can be written to, and whoever scores is there; else 503 and why not."""
    reasons = await service.troubles()
    health = Health(state="not ready" if reasons else "ready", reasons=reasons)
    return Response(health.model_dump_json(), 503 if reasons else 200, {"Cache-Control": "no-store"}, JSON)


@router.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}})
async def metrics(service: ServiceDep) -> Response:
    """For Prometheus."""
    service.inspections.station.observe()
    service.metrics.services.set(len(service.peers.nodes))
    return Response(service.metrics.exposition(), media_type=service.metrics.content_type)
