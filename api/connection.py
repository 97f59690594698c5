"""A WebSocket that takes frames and tells what is said of them: what the streams of parts have in common."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from typing import Any, TypeVar

from anyio import create_task_group
from fastapi import WebSocket, WebSocketDisconnect
from fastapi.responses import Response

from api.deps import service_of, who_asks
from api.errors import problem, problem_of
from inspector.protocol import BadFrame, SentFrame
from models.errors import InspectionError

T = TypeVar("T")
DONE, BROKEN, RESTART, TAKEN_OVER = 1000, 1008, 1012, 4409
"""Why a connection is closed."""
_UNREAD = 1000
"""Messages of its own that a client does not read; one more ends the connection."""


async def admitted(socket: WebSocket, opens: Callable[[], Awaitable[T]]) -> T | None:
    """What is opened for who may inspect; None where that is refused: the connection is denied then, with a problem."""
    try:
        await who_asks(socket, "operator")
        return await opens()
    except InspectionError as error:
        await socket.send_denial_response(problem_of(error, service_of(socket).hidden))
        return None


class AbstractConnection(ABC):
    """Both directions of an accepted connection; one ends with the other."""

    def __init__(self, socket: WebSocket) -> None:
        self._socket = socket
        self._group = create_task_group()

    async def run(self) -> None:
        """Until either side ends it."""
        async with self._group:
            for work in (self._send, self._receive):
                self._group.start_soon(self._all_end_with, work)

    async def _all_end_with(self, work: Callable[[], Awaitable[None]]) -> None:
        # A connection that is gone, or was closed just now, hears nothing more.
        with suppress(WebSocketDisconnect, RuntimeError):
            await work()
        self._group.cancel_scope.cancel()

    async def _receive(self) -> None:
        while (message := await self._socket.receive())["type"] == "websocket.receive":
            if (data := message.get("bytes")) is not None:
                self._read(data)
            else:
                self._obey(message.get("text") or "")
            if self._unread() > _UNREAD:
                await self._socket.close(BROKEN, "answers are not read")
                return

    def _read(self, data: bytes) -> None:
        try:
            self._take(SentFrame.from_bytes(data))
        except BadFrame as error:
            self._wrong(problem(422, "No frame", str(error), type="bad-frame"))
        except InspectionError as error:
            self._wrong(self._problem(error))

    def _problem(self, error: InspectionError) -> Response:
        return problem_of(error, service_of(self._socket).hidden)

    def _not_understood(self, text: str, allowed: Mapping[str, Any]) -> None:
        said = f"{text[:80]!r} is not understood; allowed are frames, and {json.dumps(allowed)}"
        self._wrong(problem(422, "Not understood", said, type="bad-message"))

    def _wrong(self, said: Response) -> None:
        self._say({"kind": "problem", **json.loads(bytes(said.body))})

    @abstractmethod
    async def _send(self) -> None:
        """Tell what there is to tell, until there is nothing more."""

    @abstractmethod
    def _take(self, sent: SentFrame) -> None:
        """A frame came. May raise InspectionError, which is told."""

    @abstractmethod
    def _obey(self, text: str) -> None:
        """A text came."""

    @abstractmethod
    def _say(self, message: dict[str, Any]) -> None:
        """Tell this, to this connection only."""

    @abstractmethod
    def _unread(self) -> int:
        """How much of that waits to be sent."""
