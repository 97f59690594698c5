"""Inspections: begun, fed a picture at a time, concluded; and everything that was said of them, again and again."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated, Any, Literal, Self

from fastapi import APIRouter, Header, Query
from fastapi.requests import Request
from fastapi.responses import FileResponse, Response
from pydantic import BaseModel, Field, model_validator

from api.deps import (
    IDENTITY,
    JSON,
    PART,
    PRODUCT,
    TEXT,
    After,
    Id,
    Limit,
    Operator,
    ServiceDep,
    Viewer,
    in_thread,
    once,
    problems,
    tagged,
)
from api.downloads import download
from api.errors import WrongType, problem
from api.schemas import Asked
from api.shared import Shared
from inspector.protocol import SentFrame
from inspector.result_json import frame_records
from inspector.scores_json import scores_from_bytes
from inspector.service.errors import NotConcluded, RecordingGone
from inspector.service.running import Running
from inspector.service.service import Service
from inspector.stores.records import Decision, InspectionSource, InspectionState, StoredInspection

router = APIRouter(prefix="/v1/inspections", tags=["inspections"])
PICTURES = ("image/jpeg", "image/png", "image/webp", "image/bmp", "image/tiff")
MAX_SCORES = 10_000


class Begin(Asked):
    """A part comes."""

    product_id: Annotated[str, Field(pattern=PRODUCT)]
    part_id: Annotated[str, Field(pattern=PART)]
    """The serial number."""
    recipe_id: Annotated[str | None, Field(pattern=IDENTITY)] = None
    """None for the active one."""


class Begun(BaseModel):
    """Ready for frames."""

    inspection_id: str
    product_id: str
    part_id: str | None
    recipe_id: str | None
    appearance_id: str
    credits: int
    """Frames that may be unanswered."""
    saves: bool
    """Whether another process goes on with it where this one is lost: then it is told which frames are saved."""


class Conclude(Asked):
    """The sweep is over."""

    stopped: bool = False
    """The line broke it off because NG was certain: it is NG, not INCOMPLETE."""
    last_sequence: Annotated[int | None, Field(ge=0, lt=2**32)] = None
    """Number of the last frame that was sent: 409 with `next_sequence` where frames to it were lost with a process that
    had the inspection."""


class Abort(Asked):
    """The sweep will not be finished."""

    reason: Annotated[str, Field(min_length=1, max_length=200, pattern=TEXT)] = "aborted by the line"


class Dispose(Asked):
    """What a person says of a part, having looked at it."""

    decision: Decision
    verdict: Literal["OK", "NG"] | None = None
    """What it is instead; only to `overrule`, and needed there."""
    comment: Annotated[str, Field(max_length=1000, pattern=TEXT)] = ""

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if (self.verdict is None) == (self.decision == "overrule"):
            raise ValueError("`verdict` is needed to overrule, and not allowed to confirm")
        return self


class Disposition(BaseModel):
    """What a person said; the machine's verdict stays as it was given."""

    decision: Decision
    verdict: str
    """What holds for that person."""
    comment: str
    actor: str
    t_ns: int


class DispositionPage(BaseModel):
    """All that was said of an inspection, newest first."""

    items: list[Disposition]
    next: int | None


class Inspection(BaseModel):
    """What is known of an inspection, without its frames."""

    inspection_id: str
    number: int
    """Increases with every inspection begun."""
    product_id: str
    part_id: str | None
    recipe_id: str | None
    appearance_id: str
    state: InspectionState
    verdict: str | None
    reason: str | None
    """Why it was aborted, or failed."""
    is_simulated: bool
    source: InspectionSource
    begun_ns: int
    ended_ns: int | None
    acknowledged_ns: int | None
    disposition: Disposition | None
    """The last word of a person, where one spoke."""
    coverage: float | None
    frames_scored: int | None
    """So far, where it is processing."""
    frames_dropped: int | None
    digest: str | None
    recording: str
    """`being written`, `kept`, `none`, `removed`."""
    recording_note: str | None
    next_sequence: int | None
    """The number that the next frame may have, where it is processing here."""
    profile: list[float | None] | None
    """The highest score in each fiftieth of the sweep; in lists only where it is asked for."""


class InspectionPage(BaseModel):
    """Part of the list, newest first."""

    items: list[Inspection]
    next: int | None


class Scores(BaseModel):
    """Scored frames, the oldest first, by the names of a result."""

    items: list[dict[str, Any]]
    next: int
    """Ask with `after` set to this for what follows."""
    state: InspectionState


@router.post("", status_code=201, response_model=Begun, responses=problems(404, 409, 503))
async def begin(
    *,
    request: Request,
    asked: Begin,
    service: ServiceDep,
    who: Operator,
    x_session_id: Annotated[str | None, Header(pattern="^[0-9a-f]{32}$", description="The id it is to have.")] = None,
) -> Response:
    """Open an inspection of a part. 503 with `Retry-After` where one more could not be scored in time.

    `X-Session-Id` chooses its id, 32 hexadecimal digits that nothing has: by it, proxies find the process that has the
    inspection. One that has that id already, is of the same part and runs is answered as if it had just begun.
    """

    async def do() -> tuple[int, BaseModel]:
        begun = await service.inspections.begin(asked.product_id, asked.part_id, asked.recipe_id, x_session_id)
        names = ("inspection_id", "product_id", "part_id", "recipe_id", "appearance_id")
        return 201, Begun(**{name: getattr(begun, name) for name in names}, credits=service.settings.window,
            saves=service.store.shared,
        )  # fmt: skip

    return await once(request, service, who, do)


@router.post(
    "/{inspection_id}/frames",
    responses=problems(404, 409, 413, 415, 500, 503) | {200: {"description": "The scored frame."}},
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {kind: {"schema": {"type": "string", "format": "binary"}} for kind in PICTURES},
        }
    },
)
async def frame(
    *,
    request: Request,
    inspection_id: Id,
    service: ServiceDep,
    who: Operator,
    t_ns: Annotated[int | None, Query(ge=0, lt=2**63, description="Time of exposure, ns since the epoch.")] = None,
    t_ns_header: Annotated[int | None, Header(alias="t-ns", ge=0, lt=2**63)] = None,
    sequence: Annotated[
        int | None, Query(ge=0, lt=2**32, description="Counts the camera's frames; a gap is a lost frame.")
    ] = None,
    encoder: Annotated[float | None, Query(allow_inf_nan=False, description="Position of robot or conveyor.")] = None,
    idempotency_key: Annotated[str | None, Header(max_length=255)] = None,
) -> Response:
    """One picture; the answer is its score. Usual are the time of arrival as `t_ns`, and the next number as `sequence`.

    A frame that is sent again, with the same sequence or Idempotency-Key, gets the same answer and is not scored twice.
    503 where too many wait: nothing has changed, send it again. 422 for what is no picture of the learnt kind: it
    counts as dropped. Where several processes share a database: frames below `Saved-Sequence` of the answer survive the
    process; 409 `resume-from` with `next_sequence` where some were lost with one, which are then to be sent once more.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in PICTURES:
        raise WrongType(kind, ", ".join(PICTURES))
    picture = await request.body()
    running = await service.inspections.open(inspection_id)
    number = sequence if sequence is not None else running.keys.get(idempotency_key or "", running.next_sequence)
    if idempotency_key is not None:
        running.keys.setdefault(idempotency_key, number)
    at = next((each for each in (t_ns, t_ns_header) if each is not None), service.now_ns())
    answer = await running.offer_and_wait(SentFrame(number, at, encoder, picture))
    said = json.loads(answer)
    if said["kind"] == "refused":
        return problem(422, "Picture not usable", said["why"], type="refused", sequence=number)
    if said["kind"] == "dropped":
        return problem(409, "Dropped", said["why"], type="dropped", sequence=number)
    headers = {"Saved-Sequence": str(running.ledger.below)} if service.store.shared else {}
    return Response(answer, headers=headers, media_type=JSON)


@router.post(
    "/{inspection_id}/conclude", responses=problems(404, 409, 500, 503) | {200: {"description": "The result."}}
)
async def conclude(
    *, request: Request, inspection_id: Id, service: ServiceDep, who: Operator, asked: Conclude | None = None
) -> Response:
    """The result, stored before it is told. It can be read again at any time."""

    async def do() -> tuple[int, bytes]:
        how = asked or Conclude()
        return 200, await service.inspections.conclude(
            inspection_id, stopped=how.stopped, last_sequence=how.last_sequence
        )

    return await once(request, service, who, do)


@router.post("/{inspection_id}/abort", responses=problems(404, 409, 500, 503) | {200: {"description": "The result."}})
async def abort(
    *, request: Request, inspection_id: Id, service: ServiceDep, who: Operator, asked: Abort | None = None
) -> Response:
    """End it without a verdict on the part: what was seen so far is told, and it is never OK."""

    async def do() -> tuple[int, bytes]:
        return 200, await service.inspections.abort(inspection_id, (asked or Abort()).reason)

    return await once(request, service, who, do)


@router.post("/{inspection_id}/acknowledge", responses=problems(404, 409))
async def acknowledge(inspection_id: Id, service: ServiceDep, who: Operator) -> Inspection:
    """The line has taken note of the result; the first time counts."""
    stored = await in_thread(service.store.acknowledge_inspection, inspection_id, service.now_ns())
    return told(stored, service)


@router.post("/{inspection_id}/disposition", response_model=Inspection, responses=problems(404, 409))
async def dispose(request: Request, inspection_id: Id, asked: Dispose, service: ServiceDep, who: Operator) -> Response:
    """Confirm or overrule the verdict of an inspection that has ended; the last word counts, every one is kept."""

    async def do() -> tuple[int, BaseModel]:
        stored = await in_thread(
            service.store.dispose,
            inspection_id,
            asked.decision,
            asked.verdict,
            comment=asked.comment,
            actor=who.actor,
            t_ns=service.now_ns(),
        )
        names = {"inspection_id": inspection_id, "product_id": stored.product_id, "verdict": stored.verdict}
        service.events.publish("disposition", **names, disposition=stored.disposition)
        return 200, told(stored, service)

    return await once(request, service, who, do)


@router.get("/{inspection_id}/dispositions", response_model=DispositionPage, responses=problems(404))
async def dispositions(
    *, request: Request, inspection_id: Id, service: ServiceDep, who: Viewer, after: After = None, limit: Limit = 50
) -> Response:
    """Everything that people said of it."""
    page = await in_thread(service.store.dispositions, inspection_id, after, limit)
    return tagged(request, DispositionPage(items=[Disposition(**asdict(each)) for each in page.items], next=page.next))


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
    after: After = None,
    limit: Limit = 50,
) -> Response:
    """All inspections, newest first; cheap to poll with If-None-Match."""

    def read() -> bytes:
        page = service.store.inspections(
            product_id=product_id,
            verdict=verdict,
            state=state,
            source=source,
            part=part,
            after=after,
            limit=limit,
        )
        items = [told(each, service, profile) for each in page.items]
        return InspectionPage(items=items, next=page.next).model_dump_json().encode()

    shared: Shared = request.app.state.shared
    return tagged(request, await shared.get(request.url.query, read))


@router.get("/{inspection_id}", response_model=Inspection, responses=problems(404))
async def inspection(request: Request, inspection_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """How far it is, or what came of it."""
    return tagged(request, told(await in_thread(service.store.inspection, inspection_id), service))


@router.get("/{inspection_id}/result", responses=problems(404, 409) | {200: {"description": "The result."}})
async def result(
    *,
    request: Request,
    inspection_id: Id,
    service: ServiceDep,
    who: Viewer,
    frames: Annotated[bool, Query(description="With the score of every frame.")] = True,
) -> Response:
    """The result, as it was when it was concluded."""
    return tagged(request, await in_thread(whole_result, service, inspection_id, frames))


@router.get("/{inspection_id}/scores", response_model=Scores, responses=problems(404))
async def scores(
    *,
    request: Request,
    inspection_id: Id,
    service: ServiceDep,
    who: Viewer,
    after: Annotated[int, Query(ge=-1, description="Index of the last frame that is known; -1 for none.")] = -1,
    limit: Annotated[int, Query(ge=1, le=MAX_SCORES)] = 1000,
) -> Response:
    """Scored frames with a higher index, while the inspection runs and ever after."""
    stored = await in_thread(service.store.inspection, inspection_id)
    running = service.inspections.find(inspection_id)
    if stored.state == "processing" and running is not None:
        return tagged(request, await in_thread(_live_scores, running, after, limit))
    return tagged(request, await in_thread(_stored_scores, service, stored, after, limit))


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


def told(stored: StoredInspection, service: Service, profile: bool = True) -> Inspection:
    """What is known of it, with how far it is where it runs here."""
    running = service.inspections.find(stored.inspection_id) if stored.state == "processing" else None
    result = stored.result or {}
    live = {"frames_scored": running.scored, "frames_dropped": running.lost} if running is not None else result
    same = {name: getattr(stored, name) for name in Inspection.model_fields if hasattr(stored, name)}
    return Inspection(
        **same,
        coverage=result.get("coverage"),
        frames_scored=live.get("frames_scored"),
        frames_dropped=live.get("frames_dropped"),
        digest=result.get("digest"),
        next_sequence=running.next_sequence if running is not None and running.phase == "open" else None,
        profile=result.get("profile") if profile else None,
    )


def whole_result(service: Service, inspection_id: str, frames: bool = True) -> bytes:
    """The result as JSON, from the store. Blocks. Raises NoSuchInspection, NotConcluded."""
    stored = service.store.inspection(inspection_id)
    if stored.state == "processing":
        raise NotConcluded(inspection_id)
    if stored.result is None:
        names = ("inspection_id", "product_id", "part_id", "recipe_id", "appearance_id", "verdict", "is_simulated")
        said = {name: getattr(stored, name) for name in names}
        bare = {"result_state": stored.state, "is_partial": True, "reasons": [stored.reason or ""], "frames": []}
        return json.dumps(said | bare).encode()
    scores = service.store.scores(inspection_id) if frames else None
    more = {"frames": frame_records(scores_from_bytes(scores))} if scores is not None else {}
    return json.dumps(stored.result | more).encode()


def _live_scores(running: Running, after: int, limit: int) -> bytes:
    lines = running.scores_after(after, limit)
    return b'{"items":[%b],"next":%d,"state":"processing"}' % (b",".join(lines), after + len(lines))


def _stored_scores(service: Service, stored: StoredInspection, after: int, limit: int) -> bytes:
    scores = service.store.scores(stored.inspection_id)
    frames = scores_from_bytes(scores)[after + 1 : after + 1 + limit] if scores is not None else ()
    return json.dumps({"items": frame_records(frames), "next": after + len(frames), "state": stored.state}).encode()
