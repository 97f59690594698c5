"""The audit trail: who changed what, when; nobody can change it, not even an admin."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel

from api.deps import After, Limit, ServiceDep, Viewer, in_thread, tagged

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


class AuditPage(BaseModel):
    """Some of them, newest first."""

    items: list[Entry]
    next: int | None
    """Ask with `after` set to this for what follows; null where nothing does."""


@router.get("", response_model=AuditPage)
async def audit(request: Request, service: ServiceDep, who: Viewer, after: After = None, limit: Limit = 50) -> Response:
    """All changes."""
    page = await in_thread(service.store.audit, after, limit)
    return tagged(request, AuditPage(items=[Entry(**asdict(each)) for each in page.items], next=page.next))
