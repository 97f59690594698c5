"""The dashboard at /, and its files at /dashboard/: a client of /v1 like any other, which asks no other host."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response
from starlette.exceptions import HTTPException

router = APIRouter(include_in_schema=False)
FOLDER = Path(__file__).parent / "dashboard"
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
"""What is served, and as what; other files of the folder are not."""
POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


@dataclass(frozen=True)
class Shipped:
    """A file of the dashboard."""

    body: bytes
    media_type: str
    tag: str


def read_files(folder: Path = FOLDER) -> dict[str, Shipped]:
    """Every file that is served, by its path below the folder. They are few and small, and held in memory."""
    found: dict[str, Shipped] = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix in TYPES and path.is_file():
            body = path.read_bytes()
            tag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
            found[path.relative_to(folder).as_posix()] = Shipped(body, TYPES[path.suffix], tag)
    return found


@router.api_route("/", methods=["GET", "HEAD"])
async def page(request: Request) -> Response:
    """The page itself."""
    return _send(request, "index.html")


@router.api_route("/dashboard/{name:path}", methods=["GET", "HEAD"])
async def file(request: Request, name: str) -> Response:
    """What the page is made of."""
    return _send(request, name)


def _send(request: Request, name: str) -> Response:
    files: dict[str, Shipped] = request.app.state.dashboard
    if (shipped := files.get(name)) is None:
        raise HTTPException(404, f"the dashboard has no file {name!r}")
    headers = {"ETag": shipped.tag, "Cache-Control": "no-cache", "Content-Security-Policy": POLICY}
    if shipped.tag in request.headers.get("if-none-match", ""):
        return Response(None, 304, headers)
    return Response(shipped.body, 200, headers, shipped.media_type)
