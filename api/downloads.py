"""Files that the service keeps, sent as they are: from the disk, or through it from a bucket, a megabyte at a time."""

from __future__ import annotations

from fastapi.requests import Request
from fastapi.responses import FileResponse, Response, StreamingResponse

from api.deps import in_thread
from inspector.objects import NoSuchObject
from inspector.service.files import Files, Kind

BINARY = "application/octet-stream"


async def download(request: Request, files: Files, kind: Kind, id: str, name: str) -> Response | None:
    """The file, by the name that browsers give it; None where it is not there. Raises ObjectError."""
    path = files.path(kind, id)
    if path is not None:
        return FileResponse(path, media_type=BINARY, filename=name) if await in_thread(path.is_file) else None
    if request.method == "HEAD":
        return await _head(files, kind, id, name)
    try:
        size, pieces = await in_thread(files.stream, kind, id)
    except NoSuchObject:
        return None
    return StreamingResponse(pieces, headers=_headers(name, size), media_type=BINARY)


async def _head(files: Files, kind: Kind, id: str, name: str) -> Response | None:
    size = await in_thread(files.size, kind, id)
    return None if size is None else Response(headers=_headers(name, size), media_type=BINARY)


def _headers(name: str, size: int) -> dict[str, str]:
    return {"Content-Length": str(size), "Content-Disposition": f'attachment; filename="{name}"'}
