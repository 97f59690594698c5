"""The stream of a part that is tracked: a WebSocket that takes frames and tells where the part is in each."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Annotated, Literal

from anyio import create_task_group
from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from fastapi.responses import Response
from pydantic import Field

from api.deps import service_of, who_asks
from api.errors import problem, problem_of
from api.schemas import Asked
from inspector.protocol import BadFrame, SentFrame
from inspector.service.locating import CREDITS, Trail
from models.errors import InspectionError

router = APIRouter()
_UNREAD = 1000
"""Messages that a client does not read; one more ends the connection."""
BROKEN, RESTART = 1008, 1012


class HandMessage(Asked):
    """Where the hand that holds the camera is in the frames that come; by parameter, all of them."""

    kind: Literal["hand"]
    place: dict[str, Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]]


@router.websocket("/v1/workspaces/{workspace_id}/track")
async def track(socket: WebSocket, workspace_id: str) -> None:
    """Frames in, messages out, until the connection ends; a new one begins anew."""
    service = service_of(socket)
    try:
        await who_asks(socket, "operator")
        trail = await service.locating.track(workspace_id)
    except InspectionError as error:
        await socket.send_denial_response(problem_of(error, service.hidden))
        return
    try:
        await socket.accept()
        await _Connection(socket, trail).run()
    finally:
        service.locating.forget(trail)


class _Connection:
    def __init__(self, socket: WebSocket, trail: Trail) -> None:
        self._socket, self._trail = socket, trail
        self._names = [each["name"] for each in trail.workspace.facts["parameters"]]
        self._group = create_task_group()

    async def run(self) -> None:
        """Until either side ends it."""
        async with self._group:
            for work in (self._send, self._receive):
                self._group.start_soon(self._all_end_with, work)

    async def _all_end_with(self, work: Callable[[], Awaitable[None]]) -> None:
        # a connection that is gone, or was closed just now, hears nothing more
        with suppress(WebSocketDisconnect, RuntimeError):
            await work()
        self._group.cancel_scope.cancel()

    async def _send(self) -> None:
        trail = self._trail
        facts = {"workspace_id": trail.workspace.workspace_id, **trail.workspace.facts}
        await self._socket.send_text(json.dumps({"kind": "ready", "credits": CREDITS, **facts}))
        while True:
            trail.news.clear()
            while trail.messages:
                await self._socket.send_text(trail.messages.popleft().decode())
            if trail.ended is not None:
                await self._socket.close(RESTART, trail.ended[:120])
                return
            await trail.news.wait()

    async def _receive(self) -> None:
        while (message := await self._socket.receive())["type"] == "websocket.receive":
            if (data := message.get("bytes")) is not None:
                self._take(data)
            else:
                self._obey(message.get("text") or "")
            if len(self._trail.messages) > _UNREAD:
                await self._socket.close(BROKEN, "answers are not read")
                return

    def _take(self, data: bytes) -> None:
        try:
            self._trail.offer(SentFrame.from_bytes(data))
        except BadFrame as error:
            self._wrong(problem(422, "No frame", str(error), type="bad-frame"))

    def _obey(self, text: str) -> None:
        try:
            place = HandMessage.model_validate_json(text).place
            if set(place) != set(self._names):
                raise ValueError(text)
            self._trail.hand = tuple(place[name] for name in self._names)
        except ValueError:
            allowed = json.dumps({"kind": "hand", "place": dict.fromkeys(self._names, 0.0)})
            said = f"{text[:80]!r} is not understood; allowed are frames, and {allowed}"
            self._wrong(problem(422, "Not understood", said, type="bad-message"))

    def _wrong(self, said: Response) -> None:
        self._trail.tell({"kind": "problem", **json.loads(bytes(said.body))})
