"""What another policy would have said of past inspections, from their stored scores; nothing is stored."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, Field

from api.deps import IDENTITY, Engineer, ProductId, ServiceDep, in_thread, problems
from api.schemas import Asked
from inspector.policies import PolicyFile
from models.verdict import Policy

router = APIRouter(prefix="/v1/products/{product_id}/rejudge", tags=["recipes"])
MOST = 1000


class Rejudge(Asked):
    """A policy, and the inspections to try it on."""

    policy: PolicyFile
    """What is left out is as usual."""
    last: Annotated[int, Field(ge=1, le=MOST)] = 100
    """So many of the latest live ones."""
    inspection_ids: Annotated[
        list[Annotated[str, Field(pattern=IDENTITY)]] | None, Field(min_length=1, max_length=MOST)
    ] = None
    """These instead."""


class Rejudged(BaseModel):
    """One inspection, before and now."""

    inspection_id: str
    part_id: str | None
    ended_ns: int | None
    before: str
    """The verdict that was given."""
    now: str
    """The verdict that this policy would have given."""
    reasons: list[str]
    """For that."""
    deviations: int
    highest_score: float


class RejudgedAll(BaseModel):
    """What would have been."""

    changed: int
    """Inspections whose verdict would have been another."""
    gone: int
    """Of the latest, those left out: the scores of their frames are not kept any more (`keep_scores_days`)."""
    counts: dict[str, dict[str, int]]
    """How many of each verdict, `before` and `now`."""
    inspections: list[Rejudged]


@router.post("", response_model=RejudgedAll, responses=problems(404, 409, 410, 500, 503))
async def rejudge(product_id: ProductId, asked: Rejudge, service: ServiceDep, who: Engineer) -> RejudgedAll:
    """Try a policy on completed inspections. Where limits fall, regions are missing that had not reached them then."""
    policy = Policy(**asked.policy.model_dump())
    chosen = await in_thread(service.replays.choose, product_id, asked.inspection_ids, asked.last)
    return RejudgedAll(**await service.jobs.at_once(lambda: service.replays.rejudge(policy, chosen)))
