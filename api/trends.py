"""Trends: how parts of a product came out over time, ready for a control chart."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel

from api.deps import ProductId, ServiceDep, Viewer, problems, tagged

router = APIRouter(prefix="/v1/products/{product_id}/trends", tags=["trends"])
MOST = 5000


class Group(BaseModel):
    """Parts that followed each other."""

    start_ns: int
    end_ns: int
    parts: int
    rejected: int
    """NG."""
    review: int


class Change(BaseModel):
    """A stretch s_start <= s < s_end whose scores went from one level to another, and stayed there."""

    s_start: float
    s_end: float
    before: float
    """Median score; 1.0 is at the threshold."""
    after: float
    since_ns: int
    inspection_id: str
    """The first part of the other level."""


class Drift(BaseModel):
    """Scores along the sweep, of earlier and of later parts; of those that were judged by the latest part's recipe."""

    s: list[float]
    earlier: list[float | None]
    """Median of the highest score in each fiftieth of the sweep; null where nothing was seen."""
    later: list[float | None]
    changes: list[Change]


class People(BaseModel):
    """What people said of the verdicts, the latest of each part."""

    looked_at_ok: int
    looked_at_rejected: int
    looked_at_review: int
    escapes: int
    """OK, overruled as NG."""
    false_rejects: int
    """NG, overruled as OK."""
    confirmed: int
    undecided: int


class TrendsOut(BaseModel):
    """Of parts that were inspected live and judged OK, NG or REVIEW, oldest first."""

    parts: int
    verdicts: dict[str, int]
    """Of all inspections that were looked at, INCOMPLETE and INVALID among them."""
    groups: list[Group]
    drift: Drift | None
    people: People


@router.get("", response_model=TrendsOut, responses=problems(404, 500, 503))
async def trends(
    *,
    request: Request,
    product_id: ProductId,
    service: ServiceDep,
    who: Viewer,
    last: Annotated[int, Query(ge=1, le=MOST, description="So many of the latest inspections.")] = 2000,
    group: Annotated[int | None, Query(ge=1, le=MOST, description="Parts in a group; usual is some 40 groups.")] = None,
) -> Response:
    """Reject rate by groups of parts, since when scores moved along the sweep, what people said of the verdicts."""
    made = await service.jobs.at_once(lambda: service.trends.of(product_id, last, group))
    return tagged(request, TrendsOut(**made))
