"""Inspections, for whoever reads: the list, one, and everything that was said of it, again and again."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.requests import Request
from fastapi.responses import FileResponse, Response
from pydantic import BaseModel

from api.deps import PART, PRODUCT, Id, ServiceDep, Viewer, WantedDep, in_thread, problems, tagged
from api.downloads import download
from api.results import Inspection, stored_scores, told, whole_result
from api.schemas import Page
from api.shared import Shared
from inspector.service.errors import NotConcluded, RecordingGone
from inspector.service.running import Running
from inspector.stores.records import InspectionSource, InspectionState

router = APIRouter(prefix="/v1/inspections", tags=["inspections"])
MAX_SCORES = 10_000


class InspectionPage(Page[Inspection]):
    """Part of the list, newest first."""


class Scores(BaseModel):
    """Scored frames, the oldest first, by the names of a result."""

    items: list[dict[str, Any]]
    next: int
    """Ask with `after` set to this for what follows."""
    state: InspectionState


@router.get("", response_model=InspectionPage)
async def inspections(
    *,
    request: Request,
    service: ServiceDep,
    who: Viewer,
    product_id: Annotated[str | None, Query(pattern=PRODUCT)] = None,
    verdict: Annotated[str | None, Query(pattern="^[A-Z]{1,16}$")] = None,
    state: InspectionState | None = None,
    source: InspectionSource | None = None,
    part: Annotated[str | None, Query(pattern=PART, description="How `part_id` begins.")] = None,
    profile: Annotated[bool, Query(description="With the profile of each.")] = False,
    wanted: WantedDep,
) -> Response:
    """All inspections, newest first; cheap to poll with If-None-Match."""

    def read() -> bytes:
        page = service.store.inspections(
            product_id=product_id,
            verdict=verdict,
            state=state,
            source=source,
            part=part,
            after=wanted.after,
            limit=wanted.limit,
        )
        return InspectionPage.of(page, lambda each: told(each, service, profile)).model_dump_json().encode()

    shared: Shared = request.app.state.shared
    return tagged(request, await shared.get(request.url.query, read))


@router.get("/{inspection_id}", response_model=Inspection, responses=problems(404))
async def inspection(request: Request, inspection_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """How far it is, or what came of it."""
    known = told(await in_thread(service.store.inspection, inspection_id), service)
    running = service.inspections.find(inspection_id)
    if known.state == "processing" and running is not None:
        known.so_far = running.so_far
    return tagged(request, known)


@router.get("/{inspection_id}/result", responses=problems(404, 409) | {200: {"description": "The result."}})
async def result(
    *,
    request: Request,
    inspection_id: Id,
    service: ServiceDep,
    who: Viewer,
    frames: Annotated[bool, Query(description="With the score of every frame.")] = True,
) -> Response:
    """The result, as it was when it was concluded.

    The scores of its frames are kept for so many days (`keep_scores_days`): afterwards `frames` is null, and
    `frames_note` says so. All else stays.
    """
    # What may have megabytes is hashed in the thread, too.
    return await in_thread(lambda: tagged(request, whole_result(service, inspection_id, frames)))


@router.get("/{inspection_id}/scores", response_model=Scores, responses=problems(404, 410))
async def scores(
    *,
    request: Request,
    inspection_id: Id,
    service: ServiceDep,
    who: Viewer,
    after: Annotated[int, Query(ge=-1, description="Index of the last frame that is known; -1 for none.")] = -1,
    limit: Annotated[int, Query(ge=1, le=MAX_SCORES)] = 1000,
) -> Response:
    """Scored frames with a higher index, while the inspection runs and as long as they are kept."""
    stored = await in_thread(service.store.inspection, inspection_id)
    running = service.inspections.find(inspection_id)
    if stored.state == "processing" and running is not None:
        return await in_thread(lambda: tagged(request, _live_scores(running, after, limit)))
    return await in_thread(lambda: tagged(request, stored_scores(service, stored, after, limit)))


@router.get("/{inspection_id}/recording", responses=problems(404, 409, 410), response_class=FileResponse)
async def recording(request: Request, inspection_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """Exactly the frames that were scored, as MCAP."""
    stored = await in_thread(service.store.inspection, inspection_id)
    if stored.recording == "being written":
        raise NotConcluded(inspection_id, "recording")
    kept = stored.recording == "kept"
    sent = (
        await download(request, service.files, "inspection", inspection_id, f"{inspection_id}.mcap") if kept else None
    )
    if sent is None:
        raise RecordingGone(inspection_id, stored.recording, stored.recording_note)
    return sent


def _live_scores(running: Running, after: int, limit: int) -> bytes:
    lines = running.scores_after(after, limit)
    return b'{"items":[%b],"next":%d,"state":"processing"}' % (b",".join(lines), after + len(lines))
