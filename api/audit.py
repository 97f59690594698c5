"""The audit trail: who changed what, when; nobody can change it, not even an admin."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel

from api.deps import ServiceDep, Viewer, WantedDep, in_thread, tagged
from api.schemas import Page

router = APIRouter(prefix="/v1/audit", tags=["audit"])


class Entry(BaseModel):
    """One change."""

    number: int
    t_ns: int
    actor: str
    action: str
    """`recipe.add`, `recipe.activate`, `inspection.dispose`, `token.add`, `token.revoke`."""
    thing: str
    """The id of what was changed."""
    before: dict[str, Any] | None
    after: dict[str, Any] | None


class AuditPage(Page[Entry]):
    """Some of them, newest first."""


@router.get("", response_model=AuditPage)
async def audit(request: Request, service: ServiceDep, who: Viewer, wanted: WantedDep) -> Response:
    """All changes."""
    page = await in_thread(service.store.audit, *wanted)
    return tagged(request, AuditPage.of(page, lambda change: Entry(**asdict(change))))
