"""Before any route: bodies within their limits, nobody led here by a page of theirs, frames first, all is counted."""

from __future__ import annotations

import re
from collections.abc import MutableMapping
from typing import Any
from urllib.parse import urlsplit

from fastapi.requests import HTTPConnection
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.errors import BodyTooLarge, problem
from inspector.service.service import Service
from inspector.settings import is_loopback

MAX_JSON = 1 << 20
"""Bytes of a body that is neither a picture nor a recording."""
HEADERS = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY"}
_RECORDING = re.compile(r"/v1/products/[^/]*/sweeps|/v1/workspaces")
_PICTURE = re.compile(r"/v1/inspections/[^/]*/frames|/v1/workspaces/[^/]*/locate")


class Guard:
    """Wraps the app."""

    def __init__(self, app: ASGIApp, service: Service) -> None:
        self._app, self._settings, self._metrics = app, service.settings, service.metrics
        self._service = service

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer what must not go on, and hand on the rest."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        if (why := self._stray(HTTPConnection(scope))) is not None:
            await problem(403, "Not from there", why)(scope, receive, send)
            return
        if scope["type"] == "websocket":
            await self._app(scope, receive, send)
            return
        await self._answer(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        limit, seen, status, headers = self._limit(scope["path"]), 0, 500, Headers(scope=scope)
        declared = headers.get("content-length", "")
        reads = scope["method"] in ("GET", "HEAD")
        # Whether a part of the body is still on its way.
        coming = "transfer-encoding" in headers or declared not in ("", "0")

        async def counted() -> Message:
            nonlocal seen, coming
            message = await receive()
            coming = coming and message.get("more_body", False)
            seen += len(message.get("body", b""))
            if seen > limit:
                raise BodyTooLarge(limit)
            return message

        async def marked(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = int(message["status"])
                MutableHeaders(scope=message).update(HEADERS)
                if not (reads or _PICTURE.fullmatch(scope["path"])):
                    self._service.events.changed()
                if coming:
                    # What nobody reads would otherwise be waited for, gigabytes of it.
                    MutableHeaders(scope=message)["Connection"] = "close"
            await send(message)

        try:
            if declared.isdecimal() and int(declared) > limit:
                error = BodyTooLarge(limit)
                await problem(413, "Body too large", error.detail, headers=error.headers)(scope, receive, marked)
            else:
                if reads:
                    await self._service.inspections.station.make_way()
                await self._app(scope, counted, marked)
        finally:
            route = getattr(scope.get("route"), "path", "none")
            self._metrics.requests.labels(_method(scope), route, str(status)).inc()

    def _limit(self, path: str) -> int:
        if _RECORDING.fullmatch(path):
            return self._settings.max_recording
        return self._settings.max_body if _PICTURE.fullmatch(path) else MAX_JSON

    def _stray(self, asked: HTTPConnection) -> str | None:
        """Where no token is asked for, a page from elsewhere must not reach us through somebody's browser."""
        if self._settings.asks_for_tokens:
            return None
        host = asked.headers.get("host", "")
        if self._settings.on_loopback and not is_loopback(urlsplit(f"//{host}").hostname or ""):
            return f"Host is {host!r}; this service listens on loopback, allowed are 127.0.0.1, localhost and [::1]"
        origin = asked.headers.get("origin")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return f"Origin is {origin!r}; without tokens, only pages of this service ({host}) may ask"
        return None


def _method(scope: MutableMapping[str, Any]) -> str:
    """One of a few: what anybody may write would make a label each."""
    method = str(scope["method"])
    return method if method in ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS") else "other"
