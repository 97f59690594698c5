"""Batches: many recordings that the service has, inspected once more by one recipe, as a job."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal, Self

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import Field, model_validator

from api.deps import IDENTITY, PART, PRODUCT, Done, Engineer, ServiceDep, in_thread, once, problems
from api.jobs import Accepted
from api.schemas import Asked
from inspector.policies import PolicyFile
from inspector.stores.records import Json
from models.verdict import Judgement, Policy

router = APIRouter(prefix="/v1/batches", tags=["replays"])
MOST_IDS, MOST = 10_000, 100_000


class NewBatch(Asked):
    """What is inspected once more, and by what."""

    product_id: Annotated[str, Field(pattern=PRODUCT)]
    of: Literal["inspections", "sweeps"] = "inspections"
    ids: Annotated[list[Annotated[str, Field(pattern=IDENTITY)]] | None, Field(min_length=1, max_length=MOST_IDS)] = (
        None
    )
    """These."""
    last: Annotated[int, Field(ge=1, le=MOST)] | None = None
    """Or so many of the newest; of inspections those that were live and have a recording."""
    verdict: Judgement | None = None
    """With `last`, of inspections: only those with this verdict."""
    part: Annotated[str | None, Field(pattern=PART)] = None
    """With `last`, of inspections: only parts that begin so."""
    recipe_id: Annotated[str | None, Field(pattern=IDENTITY)] = None
    """None for the product's active one."""
    policy: PolicyFile | None = None
    """In place of the recipe's."""

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        if (self.ids is None) == (self.last is None):
            raise ValueError("one of `ids` and `last` is needed, and not both")
        if (self.verdict or self.part) and (self.ids is not None or self.of == "sweeps"):
            raise ValueError("`verdict` and `part` go with `last`, of inspections")
        return self


@router.post("", status_code=202, response_model=Accepted, responses=problems(404, 409, 503))
async def batch(request: Request, asked: NewBatch, service: ServiceDep, who: Engineer) -> Response:
    """Replay many recordings; each becomes an inspection of source `replay`. What is there already is not done again.

    `GET /v1/jobs/{job_id}` tells how far it is, and in the end the counts, and what could not be done and why.
    """
    policy = None if asked.policy is None else Policy(**asked.policy.model_dump())

    async def do() -> Done:
        what = await in_thread(
            service.batches.choose, asked.product_id, asked.of, ids=asked.ids, last=asked.last or 0,
            verdict=asked.verdict, part=asked.part, recipe_id=asked.recipe_id, policy=policy,
        )  # fmt: skip

        def work(progress: Callable[[float], object]) -> Json:
            return service.batches.run(progress, what)

        job = await service.jobs.begin("batch", asked.product_id, what.request, work)
        return 202, Accepted(job_id=job.job_id)

    return await once(request, service, who, do)
