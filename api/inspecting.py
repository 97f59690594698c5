"""What lines ask: to begin an inspection, to score it a picture at a time, to conclude or abort it."""

from __future__ import annotations

import json
from typing import Annotated

from fastapi import APIRouter, Header, Query
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel, Field

from api.bodies import PICTURES, body_of, picture_in
from api.deps import (
    IDENTITY,
    JSON,
    PART,
    PRODUCT,
    TEXT,
    Id,
    Operator,
    ServiceDep,
    checked_key,
    in_thread,
    once,
    problems,
)
from api.errors import problem
from api.results import Inspection, told
from api.schemas import Asked
from inspector.protocol import SentFrame
from inspector.service.errors import Busy

router = APIRouter(prefix="/v1/inspections", tags=["inspections"])


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
    openapi_extra=body_of(*PICTURES),
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
    key = checked_key(idempotency_key)
    picture = await picture_in(request)
    running = await service.inspections.open(inspection_id)
    number = sequence if sequence is not None else running.keys.get(key or "", running.next_sequence)
    if key is not None:
        running.keys.setdefault(key, number)
    at = next((each for each in (t_ns, t_ns_header) if each is not None), service.now_ns())
    try:
        answer = await running.offer_and_wait(SentFrame(number, at, encoder, picture))
    except Busy:
        # Nothing has changed: the next frame has this number, whose ever it is.
        running.keys.pop(key or "", None)
        raise
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
