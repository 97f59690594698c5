"""Sweeps: recordings of good parts, uploaded or recorded from a camera of the service."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.exceptions import RequestValidationError
from fastapi.requests import Request
from fastapi.responses import FileResponse, Response
from pydantic import BaseModel, Field, ValidationError

from api.bodies import BINARY, body_of, type_of
from api.deps import (
    JSON,
    PART,
    Engineer,
    Id,
    ProductId,
    ServiceDep,
    Viewer,
    WantedDep,
    in_thread,
    once,
    problems,
    tagged,
)
from api.downloads import download
from api.errors import BodyTooLarge, WrongType
from api.guard import MAX_JSON
from api.jobs import Accepted
from api.schemas import Asked, Page
from api.uploads import receive_recording
from inspector.service.access import Who
from inspector.service.folder import remove
from inspector.service.service import Service
from inspector.stores.errors import NoSuchSweep
from inspector.stores.records import Json, Sweep

router = APIRouter(prefix="/v1/products/{product_id}/sweeps", tags=["sweeps"])
REFUSED = ("multipart/", "text/", "image/", "video/")
"""Types that no recording has; a form would be read as a recording that begins with its own headings."""
MAX_SECONDS = 3600.0


class FromCamera(Asked):
    """A sweep to be recorded from a camera that the settings of the service name."""

    camera: Annotated[str, Field(max_length=64)]
    seconds: Annotated[float | None, Field(gt=0, le=MAX_SECONDS)] = None
    frames: Annotated[int | None, Field(ge=1, le=100_000)] = None
    """One of the two is needed; what comes first ends it."""
    part_id: Annotated[str | None, Field(pattern=PART)] = None


class SweepOut(BaseModel):
    """A sweep that the service keeps."""

    sweep_id: str
    product_id: str
    part_id: str | None
    created_ns: int
    frames: int
    bytes: int
    sha256: str
    source: str
    """`upload` or `camera`."""
    losses: list[str]
    """A sentence for each thing that could not be read."""


class SweepPage(Page[SweepOut]):
    """Some of them, newest first."""


@router.post(
    "",
    status_code=201,
    response_model=SweepOut,
    responses=problems(409, 413, 415, 503, 507) | {202: {"model": Accepted, "description": "It is being recorded."}},
    openapi_extra=body_of(BINARY, or_json=FromCamera),
)
async def add(
    request: Request,
    product_id: ProductId,
    service: ServiceDep,
    who: Engineer,
    part_id: Annotated[
        str | None, Query(pattern=PART, description="The serial number; else the recording's own.")
    ] = None,
) -> Response:
    """Upload a recording (MCAP, as the body), or have one made: `{"camera": NAME, "seconds": 10}` as JSON."""
    kind = type_of(request)
    if kind.startswith(REFUSED):
        raise WrongType(kind, f"an MCAP recording as {BINARY}, or {JSON} that names a camera")
    if kind == JSON:
        return await _record(request, service, who, product_id, part_id)
    received = await receive_recording(request, service.folder)

    async def do() -> tuple[int, BaseModel]:
        sweep = await service.jobs.at_once(lambda: service.sweeps.keep(product_id, part_id, received))
        return 201, _told(sweep)

    try:
        return await once(request, service, who, do, received.sha256.encode())
    finally:
        await in_thread(remove, received.draft)


async def _record(request: Request, service: Service, who: Who, product_id: str, part_id: str | None) -> Response:
    text = await _text(request)
    asked = _asked(text)
    service.sweeps.url(asked.camera)
    named: Json = {**asked.model_dump(), "part_id": asked.part_id or part_id}

    def work(progress: Callable[[float], object]) -> Json:
        return service.sweeps.record(progress, product_id=product_id, **named)

    async def do() -> tuple[int, BaseModel]:
        job = await service.jobs.begin("record", product_id, named, work)
        return 202, Accepted(job_id=job.job_id)

    return await once(request, service, who, do, text)


async def _text(request: Request) -> bytes:
    """A body of JSON on a route that takes recordings: its limit is not theirs."""
    text = bytearray()
    async for chunk in request.stream():
        text += chunk
        if len(text) > MAX_JSON:
            raise BodyTooLarge(MAX_JSON)
    return bytes(text)


def _asked(text: bytes) -> FromCamera:
    try:
        asked = FromCamera.model_validate_json(text)
    except ValidationError as error:
        found = [{**each, "loc": ("body", *each["loc"])} for each in error.errors(include_url=False)]
        raise RequestValidationError(found) from error
    if asked.seconds is None and asked.frames is None:
        raise RequestValidationError([_missing("seconds", "one of `seconds` and `frames` is needed")])
    return asked


def _missing(name: str, said: str) -> dict[str, Any]:
    return {"loc": ("body", name), "msg": said, "type": "missing", "input": None}


@router.get("", response_model=SweepPage, responses=problems(404))
async def sweeps(
    request: Request, product_id: ProductId, service: ServiceDep, who: Viewer, wanted: WantedDep
) -> Response:
    """All sweeps of a product."""
    page = await in_thread(service.store.sweeps, product_id, *wanted)
    return tagged(request, SweepPage.of(page, _told))


@router.get("/{sweep_id}", response_model=SweepOut, responses=problems(404))
async def sweep(request: Request, product_id: ProductId, sweep_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """One sweep."""
    return tagged(request, _told(await in_thread(_found, service, product_id, sweep_id)))


@router.get("/{sweep_id}/recording", response_class=FileResponse, responses=problems(404))
async def recording(
    request: Request, product_id: ProductId, sweep_id: Id, service: ServiceDep, who: Viewer
) -> Response:
    """The recording itself, MCAP."""
    found = await in_thread(_found, service, product_id, sweep_id)
    sent = await download(request, service.files, "sweep", found.sweep_id, f"{sweep_id}.mcap")
    if sent is None:
        raise NoSuchSweep(sweep_id)
    return sent


def _found(service: Service, product_id: str, sweep_id: str) -> Sweep:
    sweep = service.store.sweep(sweep_id)
    if sweep.product_id != product_id:
        raise NoSuchSweep(sweep_id)
    return sweep


def _told(sweep: Sweep) -> SweepOut:
    return SweepOut(**asdict(sweep))
