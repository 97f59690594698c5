"""The stream of an inspection: a WebSocket that takes frames and tells what is said of them (`inspector.protocol`)."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Annotated, Any, Literal

from anyio import create_task_group
from fastapi import APIRouter, Query, WebSocket, WebSocketDisconnect
from fastapi.responses import Response
from pydantic import Field, ValidationError

from api.deps import service_of, who_asks
from api.errors import problem, problem_of
from api.schemas import Asked
from inspector.protocol import BadFrame, SentFrame
from inspector.service.errors import Moved
from inspector.service.running import Running
from inspector.service.service import Service
from models.errors import InspectionError

router = APIRouter()
_ASIDE = 1000
"""Answers that belong to this connection only and that it does not read; one more ends it."""
TAKEN_OVER, DONE, RESTART, BROKEN = 4409, 1000, 1012, 1008


@router.websocket("/v1/inspections/{inspection_id}/stream")
async def stream(
    socket: WebSocket,
    inspection_id: str,
    after: Annotated[int, Query(ge=-1)] = -1,
    log: Annotated[str, Query(max_length=64)] = "",
) -> None:
    """Frames in, messages out, until the inspection or the connection ends."""
    service = service_of(socket)
    try:
        await who_asks(socket, "operator")
        running = await service.inspections.attach(inspection_id)
    except InspectionError as error:
        await socket.send_denial_response(problem_of(error, service.hidden))
        return
    await socket.accept()
    # What another process numbered is not what this one did: then everything is told again.
    await _Connection(socket, service, running, after if log in ("", running.log_id) else -1).run()


class ConcludeMessage(Asked):
    """The only text that a client may send."""

    kind: Literal["conclude"]
    stopped: bool = False
    last_sequence: Annotated[int | None, Field(ge=0)] = None


class _Connection:
    """One connection: it reads the inspection's messages at its own pace, and holds up nobody."""

    def __init__(self, socket: WebSocket, service: Service, running: Running, after: int) -> None:
        self._socket, self._service, self._running, self._after = socket, service, running, after
        self._aside: deque[dict[str, Any]] = deque()
        self._group = create_task_group()
        running.connections += 1
        self._number = running.connections
        running.wake()

    async def run(self) -> None:
        """Until either side ends it."""
        async with self._group:
            for work in (self._send, self._receive):
                self._group.start_soon(self._all_end_with, work)

    async def _all_end_with(self, work: Callable[[], Awaitable[None]]) -> None:
        # what is sent to a connection that is gone, or was closed just now, is sent again to the next one
        with suppress(WebSocketDisconnect, RuntimeError):
            await work()
        self._group.cancel_scope.cancel()

    async def _send(self) -> None:
        running = self._running
        await self._socket.send_text(json.dumps(self._ready() | running.facts))
        at, saved = self._after + 1, 0
        while True:
            news = running.news
            while at < len(running.messages):
                await self._socket.send_text(running.messages[at].decode())
                at += 1
            while self._aside:
                await self._socket.send_text(json.dumps(self._aside.popleft()))
            if saved < running.ledger.below:
                saved = running.ledger.below
                await self._socket.send_text(json.dumps({"kind": "saved", "next_sequence": saved}))
            if running.phase == "moved":
                await self._socket.close(RESTART, "it goes on in another process")
                return
            if running.phase == "ended" and at >= len(running.messages):
                await self._socket.close(RESTART if self._service.inspections.stopping else DONE)
                return
            if running.connections != self._number:
                await self._socket.close(TAKEN_OVER, "another connection has taken over")
                return
            await news.wait()

    def _ready(self) -> dict[str, Any]:
        running, credits = self._running, self._service.settings.window
        facts = {"log": running.log_id, "saves": self._service.store.shared}
        return {"kind": "ready", "credits": credits, "next_sequence": running.next_sequence, **facts}

    async def _receive(self) -> None:
        while (message := await self._socket.receive())["type"] == "websocket.receive":
            if (data := message.get("bytes")) is not None:
                self._take(data)
            else:
                self._obey(message.get("text") or "")
            if len(self._aside) > _ASIDE:
                await self._socket.close(BROKEN, "answers are not read")
                return

    def _take(self, data: bytes) -> None:
        try:
            sent = SentFrame.from_bytes(data)
            if self._running.offer(sent) == "duplicate":
                self._say({"kind": "duplicate", "sequence": sent.sequence})
        except BadFrame as error:
            self._wrong(problem(422, "No frame", str(error), type="bad-frame"))
        except Moved:
            # This connection ends just now, and the frame is sent again over the next one.
            return
        except InspectionError as error:
            self._wrong(problem_of(error, self._service.hidden))

    def _obey(self, text: str) -> None:
        try:
            asked = ConcludeMessage.model_validate_json(text)
        except ValidationError:
            said = f'{text[:80]!r} is not understood; allowed are frames, and {{"kind": "conclude", "stopped": false}}'
            self._wrong(problem(422, "Not understood", said, type="bad-message"))
            return
        self._group.start_soon(self._conclude, asked)

    async def _conclude(self, asked: ConcludeMessage) -> None:
        """The verdict comes as a message, to this and any later connection."""
        try:
            await self._service.inspections.conclude(
                self._running.inspection_id, stopped=asked.stopped, last_sequence=asked.last_sequence
            )
        except Moved:
            return
        except InspectionError as error:
            self._wrong(problem_of(error, self._service.hidden))

    def _wrong(self, said: Response) -> None:
        self._say({"kind": "problem", **json.loads(bytes(said.body))})

    def _say(self, message: dict[str, Any]) -> None:
        self._aside.append(message)
        self._running.wake()
