"""The stream of a part that is tracked: a WebSocket that takes frames and tells where the part is in each."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from fastapi import APIRouter, WebSocket
from pydantic import Field

from api.connection import RESTART, AbstractConnection, admitted
from api.deps import Id, service_of
from api.schemas import Asked
from inspector.protocol import SentFrame
from inspector.service.locating import CREDITS, Trail

router = APIRouter()


class HandMessage(Asked):
    """Where the hand that holds the camera is in the frames that come; by parameter, all of them."""

    kind: Literal["hand"]
    place: dict[str, Annotated[float, Field(ge=-1e12, le=1e12, allow_inf_nan=False)]]


@router.websocket("/v1/workspaces/{workspace_id}/track")
async def track(socket: WebSocket, workspace_id: Id) -> None:
    """Frames in, messages out, until the connection ends; a new one begins anew."""
    service = service_of(socket)
    trail = await admitted(socket, lambda: service.locating.track(workspace_id))
    if trail is None:
        return
    try:
        await socket.accept()
        await _Connection(socket, trail).run()
    finally:
        service.locating.forget(trail)


class _Connection(AbstractConnection):
    def __init__(self, socket: WebSocket, trail: Trail) -> None:
        super().__init__(socket)
        self._trail = trail
        self._names = [each["name"] for each in trail.workspace.facts["parameters"]]

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

    def _take(self, sent: SentFrame) -> None:
        self._trail.offer(sent)

    def _obey(self, text: str) -> None:
        try:
            place = HandMessage.model_validate_json(text).place
            if set(place) != set(self._names):
                raise ValueError(text)
            self._trail.hand = tuple(place[name] for name in self._names)
        except ValueError:
            self._not_understood(text, {"kind": "hand", "place": dict.fromkeys(self._names, 0.0)})

    def _say(self, message: dict[str, Any]) -> None:
        self._trail.tell(message)

    def _unread(self) -> int:
        return len(self._trail.messages)
