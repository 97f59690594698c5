"""A service in small, for tests of what stands before it: says who it is and what it was told, and dies when asked to.

python -m tests.system.small_node ADDRESS PORT

By the protocol of servers itself (ASGI), so that it is there at once.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Awaitable, Callable
from typing import Any
from urllib.parse import parse_qs

import uvicorn

Receive = Callable[[], Awaitable[dict[str, Any]]]
Send = Callable[[dict[str, Any]], Awaitable[None]]


class Node:
    """The application."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._ready = True

    async def __call__(self, scope: dict[str, Any], receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await self._stream(receive, send)
        elif scope["type"] == "http":
            headers = {name.decode(): value.decode() for name, value in scope["headers"]}
            status, answer = self._answer(scope, headers, await _body(receive))
            told = [(b"content-type", b"application/json")]
            await send({"type": "http.response.start", "status": status, "headers": told})
            await send({"type": "http.response.body", "body": json.dumps(answer).encode()})

    async def _stream(self, receive: Receive, send: Send) -> None:
        """Says who it is, then what it hears."""
        await receive()
        await send({"type": "websocket.accept"})
        await send({"type": "websocket.send", "text": self._address})
        while (heard := await receive())["type"] == "websocket.receive":
            await send({"type": "websocket.send", "bytes": heard["bytes"]})

    def _answer(self, scope: dict[str, Any], headers: dict[str, str], body: bytes) -> tuple[int, dict[str, Any]]:
        """Who was asked, by which key, with how much; `die=ADDRESS` kills that one before it answers."""
        if scope["path"] == "/readyz":
            # As the service: only loopback is its host.
            here = headers["host"].partition(":")[0] in ("localhost", "127.0.0.1")
            return (200 if self._ready and here else 503), {}
        if scope["path"].startswith("/ready/"):
            self._ready = scope["path"].endswith("true")
        if parse_qs(scope["query_string"].decode()).get("die") == [self._address]:
            os._exit(1)
        return 200, {"node": self._address, "key": headers.get("x-session-id"), "bytes": len(body)}


async def _body(receive: Receive) -> bytes:
    body, more = b"", True
    while more:
        heard = await receive()
        body, more = body + heard.get("body", b""), heard.get("more_body", False)
    return body


if __name__ == "__main__":
    at, port = sys.argv[1:]
    # ASGI's types say less than these.
    application: Any = Node(at)
    uvicorn.run(application, host=at, port=int(port), log_level="error", lifespan="off")
