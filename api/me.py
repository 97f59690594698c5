"""Who asks: so that a page can show what its token may not do before it is tried."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel

from api.deps import Viewer, tagged
from inspector.stores.records import Role

router = APIRouter(prefix="/v1/me", tags=["tokens"])


class Me(BaseModel):
    """Who this token is for."""

    actor: str
    """As the audit trail has it; `local` where no token is asked for."""
    role: Role
    """What it may do; that of an admin where no token is asked for."""


@router.get("", response_model=Me)
async def me(request: Request, who: Viewer) -> Response:
    """Who asks, and what they may do."""
    return tagged(request, Me(actor=who.actor, role=who.role))
