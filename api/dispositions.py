"""What people say of an inspection, having looked at the part: whether its verdict holds."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Literal, Self

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel, Field, model_validator

from api.deps import TEXT, Id, Operator, ServiceDep, Viewer, WantedDep, in_thread, once, problems, tagged
from api.results import Disposition, Inspection, told
from api.schemas import Asked, Page
from inspector.stores.records import Decision

router = APIRouter(prefix="/v1/inspections", tags=["inspections"])


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


class DispositionPage(Page[Disposition]):
    """All that was said of an inspection, newest first."""


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
    request: Request, inspection_id: Id, service: ServiceDep, who: Viewer, wanted: WantedDep
) -> Response:
    """Everything that people said of it."""
    page = await in_thread(service.store.dispositions, inspection_id, *wanted)
    return tagged(request, DispositionPage.of(page, lambda word: Disposition(**asdict(word))))
