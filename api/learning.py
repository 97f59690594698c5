"""Learning: golden sweeps into an appearance, as a job."""

from __future__ import annotations

from base64 import b64decode
from collections.abc import Callable
from dataclasses import asdict
from hashlib import sha256
from typing import Annotated, Any, Self

from fastapi import APIRouter, Query
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import AfterValidator, BaseModel, Field, model_validator

from api.deps import (
    IDENTITY,
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
from api.guard import MAX_JSON
from api.jobs import Accepted
from api.pictures import picture_of, shown
from api.schemas import Asked, Page
from inspector.picture_headers import kind_of, png_size
from inspector.stores.records import Json, StoredAppearance

router = APIRouter(prefix="/v1/products/{product_id}/appearances", tags=["learning"])


def _different(ids: list[str]) -> list[str]:
    if len(set(ids)) < len(ids):
        raise ValueError("one of them is named twice; a sweep counts once")
    return ids


S = Annotated[float, Query(ge=0, le=1, description="Sweep coordinate.")]
Ids = Annotated[list[Annotated[str, Field(pattern=IDENTITY)]], Field(min_length=1, max_length=100)]


def _mask(text: str) -> str:
    try:
        data = b64decode(text, validate=True)
        if kind_of(data) != "png":
            raise ValueError("it is no PNG")
        png_size(data)
    except ValueError as error:
        raise ValueError(f"the mask cannot be read: {error}; allowed is a PNG in base64") from error
    return text


class Excuse(Asked):
    """A rectangle of the part, drawn on the reference picture that `reference?s=` shows."""

    s: Annotated[float, Field(ge=0, le=1)]
    x: Annotated[int, Field(ge=0, lt=2**16)]
    y: Annotated[int, Field(ge=0, lt=2**16)]
    width: Annotated[int, Field(ge=1, lt=2**16)]
    height: Annotated[int, Field(ge=1, lt=2**16)]


class Learn(Asked):
    """Golden sweeps; the first is the map, as on the command line. Or an appearance, and what to excuse of the part."""

    sweep_ids: Annotated[Ids, AfterValidator(_different)] | None = None
    add_to: Annotated[str | None, Field(pattern=IDENTITY)] = None
    """An appearance that these sweeps, confirmed good, are added to; it stays as it is, and a new one is made."""
    ignore: Annotated[str, Field(max_length=MAX_JSON), AfterValidator(_mask)] | None = None
    """Pixels of every frame that say nothing: a PNG of the pictures' size in base64, white where not to look."""
    of: Annotated[str | None, Field(pattern=IDENTITY)] = None
    """An appearance to excuse regions of; it stays as it is, and a new one is made."""
    excuse: Annotated[list[Excuse], Field(min_length=1, max_length=100)] | None = None
    """Regions of the part where everything is tolerated; they move with it."""

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if (self.sweep_ids is None) == (self.of is None):
            raise ValueError("one of `sweep_ids` and `of` is needed, and not both")
        if (self.of is None) != (self.excuse is None):
            raise ValueError("`of` and `excuse` go together")
        if self.ignore is not None and (self.add_to is not None or self.of is not None):
            raise ValueError("`ignore` goes with `sweep_ids` alone: what was learnt keeps its mask")
        return self

    @property
    def request(self) -> Json:
        """For the job; of the mask the hash will do."""
        asked = self.model_dump(exclude_none=True)
        if self.ignore is not None:
            asked["ignore"] = "sha256:" + sha256(b64decode(self.ignore)).hexdigest()
        return asked


class AppearanceOut(BaseModel):
    """What was learnt; named by the hash of its bytes."""

    appearance_id: str
    product_id: str
    created_ns: int
    sweep_ids: list[str]
    facts: dict[str, Any]
    """Of the learning: sweeps, size, what it promises, what was left out."""
    said: list[str]
    """What should be looked at before it is trusted, a sentence each."""
    bytes: int


class AdviceOut(BaseModel):
    """Where to go slower."""

    s_start: float
    s_end: float
    said: str


class SamplingOut(BaseModel):
    """How densely a reference sweep shows its part; lists have one number per place."""

    s: list[float]
    pixels_per_frame: list[float]
    """How far the picture moves from this place to the next, in pixels of the frames."""
    frames_per_spot: list[float | None]
    """Frames in which a spot is seen at that pace; null where the picture does not move."""
    curve_per_frame: list[float]
    """How far the projected frame moves, in medians of that: 1 is as usual for this sweep."""
    reference_s: list[float]
    """Where there are reference pictures."""
    moves: bool
    """Whether the picture moves along the sweep; turntables and corridors change otherwise."""
    width: int
    height: int
    """Of the pictures."""
    interval_ns: int
    """From frame to frame."""
    advice: list[AdviceOut]


class AppearancePage(Page[AppearanceOut]):
    """Some of them, newest first."""


@router.post("", status_code=202, response_model=Accepted, responses=problems(404, 409, 503))
async def learn(request: Request, product_id: ProductId, asked: Learn, service: ServiceDep, who: Engineer) -> Response:
    """Learn how a good part looks. The same sweeps in the same order give the same appearance, here and elsewhere.

    Or excuse regions of the part: labels, serial numbers, manual solder.
    """
    sweep_ids, old = asked.sweep_ids or [], asked.of or asked.add_to
    mask = b64decode(asked.ignore) if asked.ignore is not None else None
    regions = [each.model_dump() for each in asked.excuse or ()]

    def work(progress: Callable[[float], object]) -> Json:
        if asked.of is not None:
            return service.learning.excuse(progress, product_id, asked.of, regions)
        return service.learning.learn(progress, product_id, sweep_ids, asked.add_to, mask)

    async def do() -> tuple[int, BaseModel]:
        await in_thread(service.learning.check, product_id, sweep_ids, old)
        job = await service.jobs.begin("learn", product_id, asked.request, work)
        return 202, Accepted(job_id=job.job_id)

    return await once(request, service, who, do)


@router.get("", response_model=AppearancePage, responses=problems(404))
async def appearances(
    request: Request, product_id: ProductId, service: ServiceDep, who: Viewer, wanted: WantedDep
) -> Response:
    """Everything that was learnt of a product."""
    page = await in_thread(service.store.appearances, product_id, *wanted)
    return tagged(request, AppearancePage.of(page, _told))


@router.get("/{appearance_id}/sampling", response_model=SamplingOut, responses=problems(404, 500, 503))
async def sampling(
    request: Request, product_id: ProductId, appearance_id: Id, service: ServiceDep, who: Viewer
) -> Response:
    """How densely the reference sweep shows the part, place by place, and where the camera should go slower."""
    made = await service.jobs.shown(lambda: service.pictures.sampling(product_id, appearance_id))
    return tagged(request, SamplingOut(**made))


@router.get(
    "/{appearance_id}/reference",
    response_class=Response,
    responses=problems(404, 500, 503) | picture_of("jpeg", "png"),
)
async def reference(
    *,
    request: Request,
    product_id: ProductId,
    appearance_id: Id,
    service: ServiceDep,
    who: Viewer,
    s: S = 0.0,
) -> Response:
    """The reference picture that is nearest to `s`: `Reference-S` tells its own, `Reference-Place` counts from 0."""
    made = await service.jobs.shown(lambda: service.pictures.reference(product_id, appearance_id, s))
    told = {"Reference-S": str(made.s), "Reference-Place": str(made.place)}
    return shown(request, made.picture, str(made.place), told)


@router.get(
    "/{appearance_id}/ignored",
    response_class=Response,
    responses=problems(404, 500, 503) | picture_of("png"),
)
async def ignored(
    *,
    request: Request,
    product_id: ProductId,
    appearance_id: Id,
    service: ServiceDep,
    who: Viewer,
    s: S = 0.0,
) -> Response:
    """What was learnt not to be looked at, on the reference picture that is nearest to `s`, and of its size.

    White is fixed in the picture, grey (128) excused on the part, black is looked at.
    """
    made = await service.jobs.shown(lambda: service.pictures.ignored(product_id, appearance_id, s))
    return shown(request, made, f"ignored-{s}")


@router.get("/{appearance_id}", response_model=AppearanceOut, responses=problems(404))
async def appearance(
    request: Request, product_id: ProductId, appearance_id: Id, service: ServiceDep, who: Viewer
) -> Response:
    """One of them."""
    return tagged(request, _told(await in_thread(service.store.appearance, product_id, appearance_id)))


def _told(appearance: StoredAppearance) -> AppearanceOut:
    return AppearanceOut(**asdict(appearance))
