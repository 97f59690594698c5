"""Bodies that are too large for memory: to the disk as they come, hashed on the way, gone again if they do not end."""

from __future__ import annotations

import hashlib
from pathlib import Path

from fastapi.requests import Request

from api.deps import in_thread
from inspector.files import NotWritten
from inspector.recording import begins_as_mcap
from inspector.service.folder import DataFolder, remove
from inspector.service.sweeps import Received

AT_ONCE = 1 << 20
"""Bytes that are written at once: the event loop only gathers them."""


async def receive_recording(request: Request, folder: DataFolder) -> Received:
    """The body, whole, in the folder `incoming`. What does not begin as a recording is refused after a few bytes.

    Raises NotARecording, NotWritten, BodyTooLarge, ClientDisconnect.
    """
    draft = folder.incoming()
    sink = _Sink(draft)
    try:
        await in_thread(sink.open)
        buffer, begun = bytearray(), False
        async for chunk in request.stream():
            buffer += chunk
            if len(buffer) >= 8:
                begun = begun or begins_as_mcap(Path("the body"), bytes(buffer[:8]))
            if len(buffer) >= AT_ONCE:
                await in_thread(sink.write, bytes(buffer))
                buffer.clear()
        begun = begun or begins_as_mcap(Path("the body"), bytes(buffer[:8]))
        await in_thread(sink.finish, bytes(buffer))
    except BaseException:
        sink.close()
        remove(draft)
        raise
    return Received(draft, sink.size, sink.sha256.hexdigest())


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
