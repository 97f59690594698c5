"""What routes ask for: the service, who asks, answers that are not sent or done twice."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from typing import Annotated, Any, NamedTuple, ParamSpec, TypeVar

from fastapi import Depends, Path, Query
from fastapi.concurrency import run_in_threadpool
from fastapi.requests import HTTPConnection, Request
from fastapi.responses import Response
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from api.schemas import Problem
from inspector.service import sweeps
from inspector.service.access import Who
from inspector.service.service import Service
from inspector.settings import NAME
from inspector.stores.records import Role

P = ParamSpec("P")
T = TypeVar("T")
JSON = "application/json"
MAX_KEY = 255
"""Characters of an Idempotency-Key."""


def service_of(connection: HTTPConnection) -> Service:
    """The service that the app speaks for."""
    return connection.app.state.service


async def _service_of(connection: HTTPConnection) -> Service:
    """The same. A function that is not async would be called in one of the few threads, for which frames would wait."""
    return service_of(connection)


ServiceDep = Annotated[Service, Depends(_service_of)]


async def who_asks(connection: HTTPConnection, role: Role) -> Who:
    """Who asks, by the token shown. Raises AccessRefused, RoleTooLow."""
    scheme, _, token = connection.headers.get("authorization", "").partition(" ")
    shown = token.strip() if scheme.lower() == "bearer" and token.strip() else None
    return await service_of(connection).access.who(shown, role)


def _needs(role: Role) -> Callable[[HTTPConnection], Coroutine[Any, Any, Who]]:
    async def who(connection: HTTPConnection) -> Who:
        return await who_asks(connection, role)

    return who


Viewer = Annotated[Who, Depends(_needs("viewer"))]
"""May look."""
Operator = Annotated[Who, Depends(_needs("operator"))]
"""May inspect."""
Engineer = Annotated[Who, Depends(_needs("engineer"))]
"""May learn, and change recipes."""
Admin = Annotated[Who, Depends(_needs("admin"))]
"""May give tokens."""

After = Annotated[int | None, Query(ge=0, le=2**63 - 1, description="`next` of the page before.")]
Limit = Annotated[int, Query(ge=1, le=200, description="The most that a page may hold.")]


class Wanted(NamedTuple):
    """Which part of a list is asked for."""

    after: int | None
    limit: int


async def _wanted(after: After = None, limit: Limit = 50) -> Wanted:
    return Wanted(after, limit)


WantedDep = Annotated[Wanted, Depends(_wanted)]

PRODUCT = f"^{NAME.pattern}$"
"""What products may be called."""
PART = f"^{sweeps.PART.pattern}$"
"""What parts may be called."""

TEXT = r"^[^\x00]*$"
"""Free text; databases know no zero in one."""
ProductId = Annotated[str, Path(pattern=PRODUCT, description="1 to 64 letters, digits, '.', '_', '-'.")]
IDENTITY = r"^[A-Za-z0-9:._-]{1,100}$"
"""What an id looks like that the service gave."""
Id = Annotated[str, Path(pattern=IDENTITY, description="As the service gave it.")]


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The problems that a route may answer with, for its documentation; those of every route are known."""
    said = {
        404: "There is no such thing.",
        409: "Not possible now.",
        413: "Too large.",
        410: "It was there, and is not any more.",
        415: "The body is of a type that this route does not read.",
        500: "What it needs is lost or damaged.",
        502: "The camera does not answer.",
        503: "Not now: try again after the seconds in `Retry-After`.",
        507: "The disk is full.",
    }
    return {status: {"model": Problem, "description": said[status]} for status in statuses}


def tagged(request: Request, answer: BaseModel | bytes) -> Response:
    """The answer, or 304 where who asks has it already; polling then costs a line."""
    body = _text(answer)
    tag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
    headers = {"ETag": tag, "Cache-Control": "private, no-cache"}
    if has_already(request, tag):
        return Response(None, 304, headers)
    return Response(body, 200, headers, JSON)


def has_already(request: Request, tag: str) -> bool:
    """Whether who asks has the answer of that ETag."""
    known = [each.strip().removeprefix("W/") for each in request.headers.get("if-none-match", "").split(",")]
    return tag in known or "*" in known


def in_thread(work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Coroutine[Any, Any, T]:
    """The work, beside the event loop: whatever asks the database or the disk."""
    return run_in_threadpool(work, *args, **kwargs)


def checked_key(key: str | None) -> str | None:
    """An Idempotency-Key that can be one: an empty one would stand for whatever has none. Raises HTTPException."""
    if key is not None and not (0 < len(key) <= MAX_KEY and key.isprintable()):
        raise HTTPException(422, f"Idempotency-Key has {len(key)} characters; allowed are 1 to {MAX_KEY}, printable")
    return key


Done = tuple[int, BaseModel] | tuple[int, bytes]
"""Status and answer."""


async def once(
    request: Request, service: Service, who: Who, do: Callable[[], Awaitable[Done]], body: bytes | None = None
) -> Response:
    """What `do` answers; where the request has an Idempotency-Key that was used before, what was answered then.

    `body` stands for the body of the request where that was not read as a whole. Keys are each sender's own, and
    remembered for a day. What failed is not remembered.
    """
    key = checked_key(request.headers.get("idempotency-key"))
    if key is None:
        return _answer(*await do())
    told = [request.method, request.url.path, request.url.query, request.headers.get("prefer", "")]
    mark = hashlib.sha256("\0".join(told).encode() + b"\0" + (await request.body() if body is None else body))
    node = service.peers.node_id
    claim = await in_thread(service.store.claim, who.actor, key, mark.hexdigest(), service.now_ns(), node=node)
    if claim.state == "settled":
        return Response(claim.body, claim.status or 200, {"Idempotency-Replayed": "true"}, JSON)
    if claim.state == "pending":
        raise HTTPException(409, f"the request with Idempotency-Key {key!r} is being done", {"Retry-After": "1"})
    if claim.state == "other":
        raise HTTPException(422, f"Idempotency-Key {key!r} was used for another request; take a new one for each")
    try:
        status, answer = await do()
        text = _text(answer)
        await in_thread(service.store.settle, who.actor, key, status, text, node=node)
    except BaseException:
        with suppress(Exception):
            await asyncio.shield(in_thread(service.store.release, who.actor, key, node=node))
        raise
    return Response(text, status, media_type=JSON)


def _answer(status: int, answer: BaseModel | bytes) -> Response:
    return Response(_text(answer), status, media_type=JSON)


def _text(answer: BaseModel | bytes) -> bytes:
    return answer if isinstance(answer, bytes) else answer.model_dump_json().encode()
