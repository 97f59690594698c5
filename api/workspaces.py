"""Workspaces: uploaded or learnt from pictures; a picture in, where it is out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from math import inf
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from fastapi.exceptions import RequestValidationError
from fastapi.requests import Request
from fastapi.responses import FileResponse, Response
from pydantic import BaseModel

from api.bodies import BINARY, PICTURES, body_of, picture_in, type_of
from api.deps import (
    JSON,
    PRODUCT,
    Engineer,
    Id,
    Operator,
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
from api.jobs import Accepted
from api.schemas import Page
from api.uploads import receive_workspace
from inspector.service.folder import remove
from inspector.stores.errors import NoSuchWorkspace
from inspector.stores.records import Json, StoredWorkspace, WorkspaceSource

router = APIRouter(prefix="/v1/workspaces", tags=["workspaces"])
ZIP = "application/zip"
MAX_BYTES = 1 << 30
"""Of a learnt file: it is read into memory."""


class ParameterOut(BaseModel):
    """One thing that pictures depend on."""

    name: str
    period: float | None
    """After how much it repeats, null where it does not."""


class WorkspaceOut(BaseModel):
    """Where objects are; named by the hash of its bytes."""

    workspace_id: str
    name: str | None
    created_ns: int
    source: WorkspaceSource
    """`upload`: it came learnt; `pictures`: it was learnt here."""
    parameters: list[ParameterOut]
    objects: list[str]
    pictures: int
    """How many it was learnt from."""
    bytes: int


class WorkspacePage(Page[WorkspaceOut]):
    """Some of them, newest first."""


class OtherOut(BaseModel):
    """Another place, or object, that fits."""

    object: str
    q: dict[str, float]
    distance: float


class LocatedOut(BaseModel):
    """What a picture shows, and where; the names of `inspector locate --json`."""

    object: str | None
    q: dict[str, float] | None
    """By parameter."""
    uncertainty: dict[str, float] | None
    """One standard deviation; where it is ambiguous, as far as the others lie off."""
    distance: float
    """From the closest place; pictures have length 1."""
    state: Literal["known", "ambiguous", "unknown"]
    others: list[OtherOut]
    """What else fits best, the closest first."""


@router.post(
    "",
    status_code=201,
    response_model=WorkspaceOut,
    responses=problems(409, 413, 415, 503, 507) | {202: {"model": Accepted, "description": "It is being learnt."}},
    openapi_extra=body_of(BINARY, ZIP),
)
async def add(
    *,
    request: Request,
    service: ServiceDep,
    who: Engineer,
    name: Annotated[str | None, Query(pattern=PRODUCT, description="What people call it.")] = None,
    periodic: Annotated[
        list[str] | None,
        Query(max_length=4, description="With pictures: a parameter that turns, and after how much: angle_deg=360."),
    ] = None,
) -> Response:
    """Upload what `inspector workspace learn` wrote; or pictures and their labels, which are learnt as a job.

    Pictures come as a ZIP archive with one CSV file (columns file, object, and one per parameter), or as an MCAP
    recording with a message on /workspace/q at the time of each, as `inspector workspace learn` reads it.
    """
    kind = type_of(request)
    if kind.startswith(("multipart/", "text/", "image/", "video/", "application/json")):
        raise WrongType(kind, f"a workspace as {BINARY}, or pictures with their labels as {ZIP}")
    periods = _periods(periodic or ())
    found, received = await receive_workspace(request, service.folder)
    taken = False

    async def keep() -> tuple[int, BaseModel]:
        return 201, _told(await service.jobs.at_once(lambda: service.workspaces.keep(received.draft, name)))

    async def learn() -> tuple[int, BaseModel]:
        nonlocal taken

        def work(progress: Callable[[float], object]) -> Json:
            return service.workspaces.learn(progress, received.draft, name, periods)

        asked: Json = {"sha256": received.sha256, "bytes": received.bytes, "name": name, "periodic": periods}
        job = await service.jobs.begin("workspace", None, asked, work)
        # The job removes what was received.
        taken = True
        return 202, Accepted(job_id=job.job_id)

    try:
        if found == "learnt" and received.bytes > MAX_BYTES:
            raise BodyTooLarge(MAX_BYTES)
        return await once(request, service, who, keep if found == "learnt" else learn, received.sha256.encode())
    finally:
        if not taken:
            await in_thread(remove, received.draft)


def _periods(periodic: Sequence[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for text in periodic:
        name, _, value = text.partition("=")
        try:
            period = float(value)
        except ValueError:
            period = inf
        if not name or name in found or not 0 < period < inf:
            said = "it should be NAME=PERIOD, each name once, as in angle_deg=360"
            raise RequestValidationError([{"loc": ("query", "periodic"), "msg": said, "type": "value", "input": text}])
        found[name] = period
    return found


@router.get("", response_model=WorkspacePage)
async def workspaces(request: Request, service: ServiceDep, who: Viewer, wanted: WantedDep) -> Response:
    """All workspaces."""
    page = await in_thread(service.store.workspaces, *wanted)
    return tagged(request, WorkspacePage.of(page, _told))


@router.get("/{workspace_id}", response_model=WorkspaceOut, responses=problems(404))
async def workspace(request: Request, workspace_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """One workspace."""
    return tagged(request, _told(await in_thread(service.store.workspace, workspace_id)))


@router.get("/{workspace_id}/file", response_class=FileResponse, responses=problems(404))
async def file(request: Request, workspace_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """The learnt file itself, as `inspector locate` reads it."""
    found = await in_thread(service.store.workspace, workspace_id)
    name = found.name or found.workspace_id.removeprefix("sha256:")[:16]
    sent = await download(request, service.files, "workspace", found.workspace_id, f"{name}.workspace")
    if sent is None:
        raise NoSuchWorkspace(workspace_id)
    return sent


@router.post(
    "/{workspace_id}/locate",
    response_model=LocatedOut,
    responses=problems(404, 413, 415, 500, 503),
    openapi_extra=body_of(*PICTURES),
)
async def locate(request: Request, workspace_id: Id, service: ServiceDep, who: Operator) -> Response:
    """One picture in; which object it shows and where out. 503 where too many wait: send it again."""
    return Response(await service.locating.locate(workspace_id, await picture_in(request)), media_type=JSON)


def _told(stored: StoredWorkspace) -> WorkspaceOut:
    told = asdict(stored)
    return WorkspaceOut(**told.pop("facts"), **told)
