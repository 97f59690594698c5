"""Pictures of inspections: the latest one of those that run, every recorded one of those that have ended."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel

from api.deps import Id, ServiceDep, Viewer, has_already, in_thread, problems, tagged
from inspector.picture_headers import kind_of
from inspector.result_json import frame_record
from models.frame import EncodedPicture

router = APIRouter(prefix="/v1/inspections", tags=["inspections"])
Kind = Literal["frame", "expected", "seen", "difference"]
Index = Annotated[int, Path(ge=0, le=10**6, description="Counts the frames of the inspection from 0.")]
FOREVER = {"Cache-Control": "private, max-age=86400, immutable", "Vary": "Authorization"}


def picture_of(*kinds: str) -> dict[int | str, dict[str, Any]]:
    """For the documentation: a picture, of one of these kinds."""
    content = {f"image/{kind}": {"schema": {"type": "string", "format": "binary"}} for kind in kinds}
    return {200: {"content": content, "description": "The picture."}}


class FrameOut(BaseModel):
    """What was said of a frame, by the names of a result, and how it was compared."""

    index: int
    t_ns: int
    state: str
    s: float | None
    score: float
    raw_score: float
    residuals: dict[str, float]
    regions: list[dict[str, Any]]
    """In pixels of the frame as recorded."""
    reference: int
    """The place of the reference sweep whose picture it was compared with, counted from 0; -1 where none was."""
    placement: list[float]
    """Affine (a, b, c, d, e, f): pixel (u, v) of the pictures `expected`, `seen` and `difference` lies at
    (a u + b v + c, d u + e v + f) of the frame; (0, 0) is the middle of the first pixel. Empty where not compared."""
    light: list[float]
    """Gain, offset in grey levels, shading across and down, that make the expected picture look like the frame."""


@router.get(
    "/{inspection_id}/picture",
    response_class=Response,
    responses=problems(404)
    | picture_of("jpeg", "png", "webp", "bmp", "tiff")
    | {204: {"description": "There is none: no frame was scored yet, or the inspection has ended."}},
)
async def latest(request: Request, inspection_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """The picture of a running inspection that was scored last; cheap to poll with If-None-Match.

    `Frame-Index`, `Frame-Sequence` and, as JSON by the names of a result, `Frame-Scored` tell of it; of its regions
    the highest 12. Who watches many rather listens to events with `pictures`.
    """
    running = service.inspections.find(inspection_id)
    last = running.shown if running is not None else None
    if last is None:
        await in_thread(service.store.inspection, inspection_id)
        # No problem: who watches asks until it hears of the end.
        return Response(None, 204, {"Cache-Control": "no-store"})
    tag = f'"{last.sequence}"'
    headers = {"ETag": tag, "Cache-Control": "private, no-cache", "Frame-Sequence": str(last.sequence)}
    if has_already(request, tag):
        return Response(None, 304, headers)
    received, scored = bytes(last.picture), last.scored
    told = {"Frame-Index": str(scored["index"]), "Frame-Scored": json.dumps(scored, separators=(",", ":"))}
    return Response(received, 200, headers | told, f"image/{kind_of(received)}")


@router.get("/{inspection_id}/frames/{index}", response_model=FrameOut, responses=problems(404, 409, 410))
async def frame(request: Request, inspection_id: Id, index: Index, service: ServiceDep, who: Viewer) -> Response:
    """What was said of a frame of an inspection that has ended."""
    scored = await in_thread(service.pictures.frame, inspection_id, index)
    how = {"reference": scored.reference, "placement": scored.placement, "light": scored.light}
    return tagged(request, FrameOut.model_validate(frame_record(scored) | how))


@router.get(
    "/{inspection_id}/frames/{index}/pictures/{kind}",
    response_class=Response,
    responses=problems(404, 409, 410, 500, 503) | picture_of("jpeg", "png", "webp", "bmp"),
)
async def picture(
    *, request: Request, inspection_id: Id, index: Index, kind: Kind, service: ServiceDep, who: Viewer
) -> Response:
    """A frame of an inspection that has ended, from its recording; of a replay, from what it is a replay of.

    `frame` is as it was recorded, `expected` what should be there, `seen` the frame laid on that and lit like it.
    `difference` is to be laid on either: orange where too bright, blue where too dark, clear within tolerance.
    """
    made = await service.jobs.shown(lambda: service.pictures.picture(inspection_id, index, kind))
    return shown(request, made, f"{index}-{kind}")


def shown(request: Request, picture: EncodedPicture, name: str, told: Mapping[str, str] | None = None) -> Response:
    """A picture that never changes; `name` tells it from others at the same address."""
    headers = {"ETag": f'"{name}"', **FOREVER, **(told or {})}
    if has_already(request, headers["ETag"]):
        return Response(None, 304, headers)
    return Response(picture.data, 200, headers, f"image/{picture.format}")
