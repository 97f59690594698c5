"""Bodies that are too large for memory: to the disk as they come, hashed on the way, gone again if they do not end."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal, TypeVar

from fastapi.requests import Request

from api.deps import in_thread
from api.errors import WrongType
from inspector.errors import NotARecording
from inspector.files import NotWritten
from inspector.recording import begins_as_mcap
from inspector.service.archives import BEGINS as ARCHIVE
from inspector.service.folder import DataFolder, remove
from inspector.service.sweeps import Received
from models.workspace.workspace import SEAL as WORKSPACE

T = TypeVar("T")
START = 8
"""Bytes by which a body is known."""
AT_ONCE = 1 << 20
"""Bytes that are written at once: the event loop only gathers them."""


async def receive_recording(request: Request, folder: DataFolder) -> Received:
    """The body, whole, in the folder `incoming`. What does not begin as a recording is refused after a few bytes.

    Raises NotARecording, NotWritten, BodyTooLarge, ClientDisconnect.
    """
    _, received = await _receive(request, folder, lambda start: begins_as_mcap(Path("the body"), start))
    return received


Kind = Literal["learnt", "archive", "recording"]


async def receive_workspace(request: Request, folder: DataFolder) -> tuple[Kind, Received]:
    """What the body is by its first bytes, and the body itself, as a recording is received.

    Raises WrongType, NotWritten, BodyTooLarge, ClientDisconnect.
    """
    return await _receive(request, folder, _begins_as_workspace)


def _begins_as_workspace(start: bytes) -> Kind:
    if start == WORKSPACE.tag[:START]:
        return "learnt"
    if start.startswith(ARCHIVE):
        return "archive"
    with suppress(NotARecording):
        begins_as_mcap(Path("the body"), start)
        return "recording"
    allowed = "a learnt workspace, a ZIP archive of pictures, or an MCAP recording"
    raise WrongType(f"no workspace, it begins with {start.hex()}", allowed)


async def _receive(request: Request, folder: DataFolder, check: Callable[[bytes], T]) -> tuple[T, Received]:
    """The body on the disk, and what `check` makes of its first bytes; what it refuses is not received."""
    draft = folder.incoming()
    sink = _Sink(draft)
    try:
        await in_thread(sink.open)
        buffer, begins = bytearray(), None
        async for chunk in request.stream():
            buffer += chunk
            if len(buffer) >= START:
                begins = begins or check(bytes(buffer[:START]))
            if len(buffer) >= AT_ONCE:
                await in_thread(sink.write, bytes(buffer))
                buffer.clear()
        begins = begins or check(bytes(buffer[:START]))
        await in_thread(sink.finish, bytes(buffer))
    except BaseException:
        # In a thread: to remove gigabytes takes a while, for which no frame should wait.
        await asyncio.shield(in_thread(sink.drop))
        raise
    return begins, Received(draft, sink.size, sink.sha256.hexdigest())


class _Sink:
    """A file that is written, counted and hashed, in threads. Raises NotWritten."""

    def __init__(self, path: Path) -> None:
        self.size, self.sha256 = 0, hashlib.sha256()
        self._path = path

    def open(self) -> None:
        try:
            self._file = self._path.open("xb", buffering=0)
        except OSError as error:
            raise NotWritten(self._path, error.strerror or str(error)) from error

    def write(self, data: bytes) -> None:
        self.sha256.update(data)
        self.size += len(data)
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) or 0 :]
        except OSError as error:
            raise NotWritten(self._path, error.strerror or str(error)) from error

    def finish(self, data: bytes) -> None:
        self.write(data)
        self.close()

    def close(self) -> None:
        if hasattr(self, "_file"):
            self._file.close()

    def drop(self) -> None:
        self.close()
        remove(self._path)
