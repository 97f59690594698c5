"""Bodies that are not JSON: of which type they are, and how the documentation tells of them."""

from __future__ import annotations

from typing import Any

from fastapi.requests import Request
from pydantic import BaseModel

from api.deps import JSON
from api.errors import WrongType

BINARY = "application/octet-stream"
PICTURES = ("image/jpeg", "image/png", "image/webp", "image/bmp", "image/tiff")


def body_of(*types: str, or_json: type[BaseModel] | None = None) -> dict[str, Any]:
    """For the documentation: a body that is needed, of one of these types."""
    content = {each: {"schema": {"type": "string", "format": "binary"}} for each in types}
    more = {} if or_json is None else {JSON: {"schema": or_json.model_json_schema()}}
    return {"requestBody": {"required": True, "content": content | more}}


def type_of(request: Request) -> str:
    """What the body is said to be, without its parameters; "" where nothing is said."""
    return request.headers.get("content-type", "").partition(";")[0].strip().lower()


async def picture_in(request: Request) -> bytes:
    """The body, which must say that it is a picture. Raises WrongType, BodyTooLarge, ClientDisconnect."""
    if (found := type_of(request)) not in PICTURES:
        raise WrongType(found, ", ".join(PICTURES))
    return await request.body()
