"""A service in small, for tests of what stands before it: says who it is and what it was told, and dies when asked to.

python -m tests.system.small_node ADDRESS PORT
"""

from __future__ import annotations

import os
import sys

import uvicorn
from fastapi import FastAPI, Request, Response, WebSocket, WebSocketDisconnect

app = FastAPI()
state = {"ready": True, "asked": 0}
ME = sys.argv[1] if len(sys.argv) > 1 else ""


@app.get("/readyz")
def ready(request: Request) -> Response:
    """As the service: 503 where it is not; only loopback is its host."""
    told = request.headers["host"].partition(":")[0] in ("localhost", "127.0.0.1")
    return Response(status_code=200 if state["ready"] and told else 503)


@app.post("/ready/{ready}")
def become(ready: bool) -> None:
    """Ready, or not."""
    state["ready"] = ready


@app.websocket("/v1/inspections/{inspection_id}/stream")
async def stream(socket: WebSocket, inspection_id: str) -> None:
    """Says who it is, then what it hears."""
    await socket.accept()
    await socket.send_text(ME)
    try:
        while True:
            await socket.send_bytes(await socket.receive_bytes())
    except WebSocketDisconnect:
        pass


@app.api_route("/{path:path}", methods=["GET", "POST"])
async def anything(request: Request, path: str) -> dict[str, object]:
    """Who was asked, by which key, with how much; `die=ADDRESS` kills that one before it answers."""
    size = len(await request.body())
    if request.query_params.get("die") == ME:
        os._exit(1)
    return {"node": ME, "key": request.headers.get("x-session-id"), "bytes": size}


if __name__ == "__main__":
    uvicorn.run(app, host=ME, port=int(sys.argv[2]), log_level="error")
