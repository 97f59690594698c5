"""Files that the service keeps, sent as they are: from the disk, or through it from a bucket, a megabyte at a time."""

from __future__ import annotations

import re
from pathlib import Path

from fastapi.requests import Request
from fastapi.responses import FileResponse, Response, StreamingResponse

from api.bodies import BINARY
from api.deps import in_thread
from inspector.locations import RemoteFile
from inspector.objects import NoSuchObject
from inspector.service.files import Files, Kind

_RANGE = re.compile(r"bytes=(\d{1,18})-(\d{0,18})")


async def download(request: Request, files: Files, kind: Kind, id: str, name: str) -> Response | None:
    """The file or a range of its bytes, by the name that browsers give it; None where it is not there.

    Raises ObjectError.
    """
    place = files.location(kind, id)
    if isinstance(place, Path):
        return FileResponse(place, media_type=BINARY, filename=name) if await in_thread(place.is_file) else None
    headers = {"Content-Disposition": f'attachment; filename="{name}"', "Accept-Ranges": "bytes"}
    if (wanted := _RANGE.fullmatch(request.headers.get("range", ""))) is not None:
        return await _range(place, int(wanted[1]), int(wanted[2]) + 1 if wanted[2] else None, headers=headers)
    try:
        size, pieces = await in_thread(place.stream)
    except NoSuchObject:
        return None
    return StreamingResponse(pieces, headers=headers | {"Content-Length": str(size)}, media_type=BINARY)


async def _range(place: RemoteFile, start: int, end: int | None, *, headers: dict[str, str]) -> Response | None:
    size = await in_thread(place.size)
    if size is None:
        return None
    end = size if end is None else min(end, size)
    if start >= end:
        return Response(None, 416, {"Content-Range": f"bytes */{size}"})
    _, pieces = await in_thread(place.stream, start, end)
    headers |= {"Content-Length": str(end - start), "Content-Range": f"bytes {start}-{end - 1}/{size}"}
    return StreamingResponse(pieces, 206, headers, BINARY)
