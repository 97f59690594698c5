"""What happens, as server-sent events: for dashboards, which read at their own pace and hold up nobody."""

from __future__ import annotations

import json
from collections.abc import AsyncGenerator
from functools import lru_cache
from typing import Annotated

from fastapi import APIRouter, Header, Query
from fastapi.responses import Response, StreamingResponse
from fastapi.sse import format_sse_event

from api.deps import IDENTITY, ServiceDep, Viewer, problems
from inspector.service.events import Event
from inspector.service.service import Service

router = APIRouter(prefix="/v1", tags=["events"])
QUIET = b": nothing happened\n\n"


@router.get(
    "/events",
    response_class=StreamingResponse,
    responses=problems(503) | {200: {"content": {"text/event-stream": {}}, "description": "Events, without end."}},
)
async def events(
    service: ServiceDep,
    who: Viewer,
    last_event_id: Annotated[str | None, Header(max_length=64)] = None,
    pictures: Annotated[str | None, Query(pattern=IDENTITY, description="`every`, or the id of an inspection.")] = None,
) -> Response:
    """Everything that happens from now on, or since `Last-Event-ID`, at whichever service that shares the database.

    First comes the `station` as it is: `state`, `running`. Then come `begun`, `scores` (four times a second:
    [index, s, score, state] of each frame, and the drops), `deviation_opened`, `deviation_closed`, `early_ng`,
    `early_invalid`, `recognised`, `part_found`, `verdict`, `aborted`, `interrupted` (the service that had it is gone),
    `disposition`, `station` (of this service only), `job`; `missed` where some can not be told any more: read the lists
    again. With `pictures` also `picture`: the latest of a running inspection as it was received (`type`, `picture` in
    base64), with what was said of it (`scored`); at most four a second of each inspection, fewer where many watch.
    """
    service.events.check_room()
    told = _told(service, last_event_id, pictures)
    return StreamingResponse(told, media_type="text/event-stream", headers={"Cache-Control": "no-store"})


async def _told(service: Service, last_id: str | None, pictures: str | None) -> AsyncGenerator[bytes]:
    with service.events.listening(pictures):
        station = json.dumps(service.inspections.station.facts)
        here = service.events.last_id if last_id is None else None
        yield format_sse_event(retry=1000, event="station", data_str=station, id=here)
        async for batch in service.events.since(here or last_id, pictures):
            yield b"".join(map(_formatted, batch)) or QUIET


@lru_cache(maxsize=64)
def _formatted(event: Event) -> bytes:
    """The same bytes for every listener."""
    return format_sse_event(data_str=event.data, event=event.kind, id=event.id or None)
