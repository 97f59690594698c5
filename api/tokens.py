"""Tokens: who may ask, and what. The text of a token is told once, when it is made, and kept nowhere."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel, Field

from api.deps import PART, Admin, Id, ServiceDep, in_thread, problems, tagged
from api.schemas import Asked
from inspector.stores.records import Role, Token

router = APIRouter(prefix="/v1/tokens", tags=["tokens"])


class NewToken(Asked):
    """Somebody who may ask."""

    name: Annotated[str, Field(pattern=PART)]
    """Who it is for: it stands in the audit trail."""
    role: Role
    """`viewer` looks, `operator` inspects, `engineer` learns and changes recipes, `admin` gives tokens."""


class TokenOut(BaseModel):
    """What is known of a token; not the token."""

    token_id: str
    name: str
    role: Role
    created_ns: int
    revoked_ns: int | None


class Tokens(BaseModel):
    """All of them."""

    items: list[TokenOut]


class MadeToken(TokenOut):
    """A new token."""

    token: str
    """Keep it: it is told this once."""


@router.get("", response_model=Tokens)
async def tokens(request: Request, service: ServiceDep, who: Admin) -> Response:
    """All tokens, those revoked, too."""
    return tagged(request, Tokens(items=[_told(each) for each in await in_thread(service.store.tokens)]))


@router.post("", status_code=201)
async def make(asked: NewToken, service: ServiceDep, who: Admin) -> MadeToken:
    """A new token. No Idempotency-Key here: an answer that is remembered would keep the token."""
    token, text = await in_thread(service.access.make, asked.name, asked.role, who.actor)
    return MadeToken(**_told(token).model_dump(), token=text)


@router.delete("/{token_id}", responses=problems(404))
async def revoke(token_id: Id, service: ServiceDep, who: Admin) -> TokenOut:
    """It is refused from now on."""
    return _told(await in_thread(service.access.revoke, token_id, who.actor))


def _told(token: Token) -> TokenOut:
    return TokenOut(**{name: getattr(token, name) for name in TokenOut.model_fields})
