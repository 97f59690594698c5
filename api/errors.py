"""One table from what can go wrong to what a stranger is told: problem documents, RFC 9457."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import structlog
from fastapi import FastAPI, WebSocket
from fastapi.exceptions import RequestValidationError, ValidationException, WebSocketRequestValidationError
from fastapi.requests import Request
from fastapi.responses import Response
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from inspector.cameras.base import CameraNotOpened, CameraStopped
from inspector.errors import (
    CameraError,
    OutputExists,
    PictureTooLarge,
    PictureUnreadable,
    RecordingError,
    RecordingStopped,
    StoreError,
)
from inspector.files import NotWritten
from inspector.labels import LabelsRefused
from inspector.objects import ObjectError
from inspector.policies import PolicyRefused
from inspector.result_json import BadRecord
from inspector.scores_json import ScoresUnreadable
from inspector.service.access import AccessRefused, RoleTooLow
from inspector.service.archives import ArchiveRefused
from inspector.service.batches import NothingChosen
from inspector.service.desk import DeskClosed, WorkerDied, WorkFailed
from inspector.service.errors import (
    AtCapacity,
    Busy,
    LocatorLost,
    Moved,
    NoRecipe,
    NotConcluded,
    NotOpen,
    OutOfOrder,
    PictureRefused,
    RecordingGone,
    ResumeFrom,
    ScorerLost,
    ScoresGone,
    Stopping,
    TooManyFrames,
    TooManyTracked,
)
from inspector.service.events import TooManyListeners
from inspector.service.folder import FolderInUse, FolderRefused, NoFileId
from inspector.service.jobs import TooMuchToDo
from inspector.service.pictures import NoSuchPicture
from inspector.service.replays import NoScores
from inspector.settings import SettingRefused
from inspector.stores.errors import NoSuch, StoreConflict
from models.errors import AppearanceError, InspectionError, NumericError

log = structlog.get_logger(__name__)
PROBLEM_JSON = "application/problem+json"


@dataclass(frozen=True)
class Kind:
    """What is told of all errors of a class."""

    status: int
    title: str


class BodyTooLarge(HTTPException):
    """A body of more bytes than allowed. The connection ends with it: what is still on its way is not read."""

    def __init__(self, limit: int) -> None:
        super().__init__(413, f"the body is larger than allowed; allowed are {limit} bytes", {"Connection": "close"})


class WrongType(HTTPException):
    """A body of a type that this route does not read."""

    def __init__(self, found: str, allowed: str) -> None:
        super().__init__(415, f"the body is {found or 'of no type'}; allowed is {allowed}")


KINDS: Mapping[type[InspectionError], Kind] = {
    # Who asks.
    AccessRefused: Kind(401, "No valid token"),
    RoleTooLow: Kind(403, "Not allowed"),
    # What is asked for, and what it goes with.
    NoSuch: Kind(404, "Not found"),
    NoFileId: Kind(404, "Not found"),
    NoSuchPicture: Kind(404, "No picture"),
    StoreConflict: Kind(409, "Not possible now"),
    NotOpen: Kind(409, "Takes no more frames"),
    TooManyFrames: Kind(409, "Too many frames"),
    OutOfOrder: Kind(409, "Too late"),
    ResumeFrom: Kind(409, "Frames are missing"),
    NotConcluded: Kind(409, "Not concluded"),
    RecordingGone: Kind(410, "No recording"),
    ScoresGone: Kind(410, "No scores"),
    NoScores: Kind(409, "No scores"),
    NoRecipe: Kind(409, "No active recipe"),
    NothingChosen: Kind(409, "Nothing chosen"),
    PictureTooLarge: Kind(413, "Picture too large"),
    PictureUnreadable: Kind(422, "Picture not readable"),
    NumericError: Kind(422, "Cannot be used"),
    RecordingError: Kind(422, "Recording not readable"),
    PolicyRefused: Kind(422, "Policy not allowed"),
    SettingRefused: Kind(422, "Not allowed"),
    CameraError: Kind(422, "Camera not usable"),
    WorkFailed: Kind(422, "Cannot be done"),
    PictureRefused: Kind(422, "Picture not usable"),
    LabelsRefused: Kind(422, "Labels not usable"),
    ArchiveRefused: Kind(422, "Archive not usable"),
    # What is wrong here.
    AppearanceError: Kind(500, "Stored file damaged"),
    ScoresUnreadable: Kind(500, "Stored scores damaged"),
    BadRecord: Kind(500, "Stored result damaged"),
    OutputExists: Kind(500, "File exists already"),
    WorkerDied: Kind(500, "Process ended"),
    CameraNotOpened: Kind(502, "Camera does not answer"),
    CameraStopped: Kind(502, "Camera stopped"),
    DeskClosed: Kind(503, "Being stopped"),
    TooMuchToDo: Kind(503, "Too much to do"),
    StoreError: Kind(503, "Database does not answer"),
    ObjectError: Kind(503, "Files cannot be had"),
    FolderInUse: Kind(503, "Data folder in use"),
    FolderRefused: Kind(503, "Data folder not writable"),
    AtCapacity: Kind(503, "No capacity"),
    Busy: Kind(503, "No room for this frame"),
    Moved: Kind(503, "Goes on elsewhere"),
    Stopping: Kind(503, "Being stopped"),
    TooManyListeners: Kind(503, "Too many listeners"),
    TooManyTracked: Kind(503, "No capacity"),
    LocatorLost: Kind(503, "Not located"),
    ScorerLost: Kind(500, "Inspection lost"),
    NotWritten: Kind(507, "Not written"),
    RecordingStopped: Kind(507, "Recording stopped"),
}
"""By the class, or the nearest one above it. Every class of InspectionError is under one of these: a test says so."""
TITLES = {
    400: "Bad request",
    403: "Not allowed",
    404: "Not found",
    405: "Method not allowed",
    409: "Not possible now",
    413: "Body too large",
    415: "Type not read here",
    422: "Not allowed",
    503: "Not now",
}


def kind_of(error: type[InspectionError]) -> tuple[type[InspectionError], Kind]:
    """The class in the table that speaks for this one."""
    return next((each, KINDS[each]) for each in error.__mro__ if each in KINDS)


def problem(
    status: int, title: str, detail: str, *, type: str = "", headers: Mapping[str, str] | None = None, **more: object
) -> Response:
    """A problem document; `type` is the name of what went wrong, about:blank where the status says it all."""
    document = {"type": f"urn:inspector:{type}" if type else "about:blank", "title": title, "status": status}
    body = json.dumps({**document, "detail": detail, **more}, ensure_ascii=False).encode("utf-8", "replace")
    return Response(body, status, {**(headers or {}), "Cache-Control": "no-store"}, PROBLEM_JSON)


def problem_of(error: InspectionError, hidden: Callable[[str], str] = str) -> Response:
    """What is told of an error; `hidden` takes out of a sentence what strangers need not know."""
    found, kind = kind_of(type(error))
    headers = {"WWW-Authenticate": "Bearer"} if kind.status == 401 else {}
    if (wait := getattr(error, "retry_after", 1 if kind.status == 503 else None)) is not None:
        headers["Retry-After"] = str(wait)
    return problem(
        kind.status,
        kind.title,
        hidden(str(error)),
        type=_slug(found.__name__),
        headers=headers,
        **getattr(error, "facts", {}),
    )


def _slug(name: str) -> str:
    """NoSuchSweep -> no-such-sweep."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower()


def install(app: FastAPI) -> None:
    """Every error of the app becomes a problem document."""

    async def ours(request: Request, error: InspectionError) -> Response:
        answer = problem_of(error, request.app.state.service.hidden)
        if answer.status_code >= 500:
            log.error("problem", path=request.url.path, status=answer.status_code, error=str(error))
        return answer

    async def invalid(request: Request, error: RequestValidationError) -> Response:
        return _invalid(error)

    async def denied(socket: WebSocket, error: WebSocketRequestValidationError) -> None:
        await socket.send_denial_response(_invalid(error))

    async def http(request: Request, error: HTTPException) -> Response:
        said = error.detail
        if error.status_code == 404 and said == "Not Found":
            said = f"there is nothing at {request.url.path}; /docs tells what there is"
        if error.status_code == 400 and said == "There was an error parsing the body":
            said = "the body cannot be read; allowed is JSON, in UTF-8"
        if error.status_code == 405:
            said = f"{request.method} is not possible at {request.url.path}"
        title = TITLES.get(error.status_code, "Not possible")
        return problem(error.status_code, title, said, headers=error.headers)

    async def unexpected(request: Request, error: Exception) -> Response:
        log.error("unexpected error", path=request.url.path, method=request.method, exc_info=error)
        return problem(500, "Unexpected error", "something went wrong here; the log of the service says what")

    async def gone(request: Request, error: ClientDisconnect) -> Response:
        log.debug("client gone", path=request.url.path)
        return problem(400, TITLES[400], "the connection broke off before the body ended")

    app.add_exception_handler(ClientDisconnect, gone)  # pyright: ignore[reportArgumentType]
    app.add_exception_handler(InspectionError, ours)  # pyright: ignore[reportArgumentType]
    app.add_exception_handler(RequestValidationError, invalid)  # pyright: ignore[reportArgumentType]
    app.add_exception_handler(WebSocketRequestValidationError, denied)  # pyright: ignore[reportArgumentType]
    app.add_exception_handler(HTTPException, http)  # pyright: ignore[reportArgumentType]
    app.add_exception_handler(Exception, unexpected)


def _invalid(error: ValidationException) -> Response:
    found = [_told(each) for each in error.errors()]
    return problem(422, TITLES[422], f"{found[0]['where']}: {found[0]['said']}", type="invalid", errors=found)


def _told(wrong: Mapping[str, Any]) -> dict[str, str]:
    where = ".".join(str(part) for part in wrong["loc"])
    said = str(wrong["msg"]).replace("Input should", "it should")
    value = wrong.get("input")
    shown = f" (it is {value!r})"[:200] if isinstance(value, str | int | float) else ""
    return {"where": where, "said": f"{said}{shown}"}
