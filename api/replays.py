"""Replays: what was recorded, inspected once more by any recipe, and marked as simulated."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Self

from fastapi import APIRouter, Header
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import Field, RootModel, model_validator

from api.deps import IDENTITY, Done, Engineer, ServiceDep, in_thread, once, problems
from api.jobs import Accepted
from api.results import whole_result
from api.schemas import Asked
from inspector.policies import PolicyFile
from inspector.stores.records import Json
from models.verdict import Policy

router = APIRouter(prefix="/v1/replays", tags=["replays"])
AnyId = Annotated[str | None, Field(pattern=IDENTITY)]


class NewReplay(Asked):
    """Of one inspection or one sweep."""

    inspection_id: AnyId = None
    sweep_id: AnyId = None
    recipe_id: AnyId = None
    """None for that of the inspection; for a sweep, the product's active one."""
    policy: PolicyFile | None = None
    """In place of the recipe's."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.inspection_id is None) == (self.sweep_id is None):
            raise ValueError("one of `inspection_id` and `sweep_id` is needed, and not both")
        return self


class Result(RootModel[dict[str, object]]):
    """The result, as `inspector replay --json` writes it."""


@router.post(
    "",
    status_code=201,
    response_model=Result,
    responses=problems(404, 409, 410, 500, 503) | {202: {"model": Accepted, "description": "It is being replayed."}},
)
async def replay(
    request: Request,
    asked: NewReplay,
    service: ServiceDep,
    who: Engineer,
    prefer: Annotated[str, Header(max_length=200, description="`respond-async` for a job.")] = "",
) -> Response:
    """Replay a recording: the same recording, appearance and policy give the same digest as live."""
    policy = None if asked.policy is None else Policy(**asked.policy.model_dump())
    later = "respond-async" in prefer.lower()

    async def do() -> Done:
        what = await in_thread(
            service.replays.prepare, asked.inspection_id, asked.sweep_id, asked.recipe_id, policy
        )  # fmt: skip

        def work(progress: Callable[[float], object]) -> Json:
            stored = service.replays.replay(progress, what)
            return {"inspection_id": stored.inspection_id, "verdict": stored.verdict}

        if later:
            job = await service.jobs.begin("replay", what.recipe.product_id, what.request, work)
            return 202, Accepted(job_id=job.job_id)
        made = await service.jobs.at_once(lambda: work(lambda share: None))
        return 201, await in_thread(whole_result, service, made["inspection_id"])

    return await once(request, service, who, do)
