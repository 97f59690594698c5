"""Jobs: long work that was asked for, and how far it is."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel

from api.deps import PRODUCT, Engineer, Id, ServiceDep, Viewer, WantedDep, in_thread, problems, tagged
from api.schemas import Page
from inspector.stores.records import Job, JobKind, JobState

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])


class Accepted(BaseModel):
    """Work that is begun."""

    job_id: str
    """Ask at /v1/jobs/{job_id}."""


class BatchOut(BaseModel):
    """How many recordings of a batch came to what."""

    recordings: int
    before: int
    """Done before, and not again."""
    done: int
    failed: int
    """`said` has the reasons."""
    verdicts: dict[str, int]
    """Of those that are done, whenever that was."""


class JobOut(BaseModel):
    """How far it is, and what came of it."""

    job_id: str
    kind: JobKind
    product_id: str | None
    """Null where it is of no product: a workspace."""
    state: JobState
    progress: float
    """From 0 to 1."""
    created_ns: int
    ended_ns: int | None
    request: dict[str, Any]
    """What was asked for."""
    error: str | None
    """A sentence, where it failed."""
    appearance_id: str | None
    """Of what was learnt."""
    sweep_id: str | None
    """Of what was recorded."""
    inspection_id: str | None
    """Of what a replay became."""
    workspace_id: str | None
    """Of what was learnt from pictures."""
    batch: BatchOut | None
    """What came of a batch."""
    said: list[str]
    """What should be looked at, or was lost, a sentence each."""


class JobPage(Page[JobOut]):
    """Some of them, newest first."""


@router.get("", response_model=JobPage)
async def jobs(
    *,
    request: Request,
    service: ServiceDep,
    who: Viewer,
    product_id: Annotated[str | None, Query(pattern=PRODUCT)] = None,
    state: JobState | None = None,
    wanted: WantedDep,
) -> Response:
    """All jobs."""
    page = await in_thread(
        service.store.jobs, product_id=product_id, state=state, after=wanted.after, limit=wanted.limit
    )
    return tagged(request, JobPage.of(page, _told))


@router.get("/{job_id}", response_model=JobOut, responses=problems(404))
async def job(request: Request, job_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """How far a job is."""
    return tagged(request, _told(await in_thread(service.store.job, job_id)))


@router.post("/{job_id}/cancel", response_model=JobOut, responses=problems(404, 409))
async def cancel(job_id: Id, service: ServiceDep, who: Engineer) -> JobOut:
    """End a job that runs or waits, at whatever service. It has failed then; what it has done stays."""
    return _told(await service.jobs.cancel(job_id, who.actor))


def _told(job: Job) -> JobOut:
    outcome = job.outcome or {}
    same = ("job_id", "kind", "product_id", "state", "progress", "created_ns", "ended_ns", "request", "error")
    return JobOut(
        **{name: getattr(job, name) for name in same},
        appearance_id=outcome.get("appearance_id"),
        sweep_id=outcome.get("sweep_id"),
        inspection_id=outcome.get("inspection_id"),
        workspace_id=outcome.get("workspace_id"),
        batch=outcome.get("batch"),
        said=outcome.get("said", outcome.get("losses", [])),
    )
