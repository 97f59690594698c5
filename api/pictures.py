"""Pictures of inspections: the latest one of those that run."""

from __future__ import annotations

import json

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response

from api.deps import Id, ServiceDep, Viewer, has_already, in_thread, problems
from inspector.picture_headers import kind_of
from inspector.service.errors import NoPictureYet
from inspector.service.running import Shown

router = APIRouter(prefix="/v1/inspections", tags=["inspections"])
PICTURES = {f"image/{kind}": {"schema": {"type": "string", "format": "binary"}} for kind in ("jpeg", "png", "webp")}
OTHERS = {f"image/{kind}": {"schema": {"type": "string", "format": "binary"}} for kind in ("bmp", "tiff")}
MOST = 12
"""Regions that a header tells."""


@router.get(
    "/{inspection_id}/picture",
    response_class=Response,
    responses=problems(404) | {200: {"content": PICTURES | OTHERS, "description": "The picture, as it was received."}},
)
async def latest(request: Request, inspection_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """The picture of a running inspection that was scored last; cheap to poll with If-None-Match.

    `Frame-Index`, `Frame-Sequence` and, as JSON by the names of a result, `Frame-Scored` tell of it; of its regions
    the highest 12. How often to ask, the event `station` says.
    """
    running = service.inspections.find(inspection_id)
    shown = running.shown if running is not None else None
    if shown is None:
        stored = await in_thread(service.store.inspection, inspection_id)
        raise NoPictureYet(inspection_id, stored.state)
    tag = f'"{shown.sequence}"'
    headers = {"ETag": tag, "Cache-Control": "private, no-cache", "Frame-Sequence": str(shown.sequence)}
    if has_already(request, tag):
        return Response(None, 304, headers)
    picture = bytes(shown.picture)
    return Response(picture, 200, headers | _told(shown), f"image/{kind_of(picture)}")


def _told(shown: Shown) -> dict[str, str]:
    """Box and picture are of one frame, whatever comes meanwhile."""
    scored = json.loads(shown.scored)
    del scored["kind"], scored["sequence"]
    scored["regions"] = sorted(scored["regions"], key=lambda region: -region["score"])[:MOST]
    return {"Frame-Index": str(scored["index"]), "Frame-Scored": json.dumps(scored, separators=(",", ":"))}
