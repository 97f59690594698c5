"""The stream of an inspection: a WebSocket that takes frames and tells what is said of them (`inspector.protocol`)."""

from __future__ import annotations

import json
from collections import deque
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, WebSocket
from pydantic import Field, ValidationError

from api.connection import DONE, RESTART, TAKEN_OVER, AbstractConnection, admitted
from api.deps import Id, service_of
from api.schemas import Asked
from inspector.protocol import SentFrame
from inspector.service.errors import Moved
from inspector.service.running import Running
from inspector.service.service import Service
from models.errors import InspectionError

router = APIRouter()


@router.websocket("/v1/inspections/{inspection_id}/stream")
async def stream(
    socket: WebSocket,
    inspection_id: Id,
    after: Annotated[int, Query(ge=-1)] = -1,
    log: Annotated[str, Query(max_length=64)] = "",
) -> None:
    """Frames in, messages out, until the inspection or the connection ends."""
    service = service_of(socket)
    running = await admitted(socket, lambda: service.inspections.attach(inspection_id))
    if running is None:
        return
    await socket.accept()
    # What another process numbered, or nobody said yet, was not heard here: then everything is told again.
    heard = log in ("", running.log_id) and after < len(running.messages)
    await _Connection(socket, service, running, after if heard else -1).run()


class ConcludeMessage(Asked):
    """The only text that a client may send."""

    kind: Literal["conclude"]
    stopped: bool = False
    last_sequence: Annotated[int | None, Field(ge=0)] = None


class _Connection(AbstractConnection):
    """One connection: it reads the inspection's messages at its own pace, and holds up nobody."""

    def __init__(self, socket: WebSocket, service: Service, running: Running, after: int) -> None:
        super().__init__(socket)
        self._service, self._running, self._after = service, running, after
        self._aside: deque[dict[str, Any]] = deque()
        running.connections += 1
        self._number = running.connections
        running.wake()

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
                await self._socket.close(RESTART if self._service.inspections.station.stopping else DONE)
                return
            if running.connections != self._number:
                await self._socket.close(TAKEN_OVER, "another connection has taken over")
                return
            await news.wait()

    def _ready(self) -> dict[str, Any]:
        running, credits = self._running, self._service.settings.window
        facts = {"log": running.log_id, "saves": self._service.store.shared}
        return {"kind": "ready", "credits": credits, "next_sequence": running.next_sequence, **facts}

    def _take(self, sent: SentFrame) -> None:
        try:
            if self._running.offer(sent) == "duplicate":
                self._say({"kind": "duplicate", "sequence": sent.sequence})
        except Moved:
            # This connection ends just now, and the frame is sent again over the next one.
            return

    def _obey(self, text: str) -> None:
        try:
            asked = ConcludeMessage.model_validate_json(text)
        except ValidationError:
            self._not_understood(text, {"kind": "conclude", "stopped": False})
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
            self._wrong(self._problem(error))

    def _say(self, message: dict[str, Any]) -> None:
        self._aside.append(message)
        self._running.wake()

    def _unread(self) -> int:
        return len(self._aside)
