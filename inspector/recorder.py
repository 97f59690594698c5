"""Camera -> bounded queue -> recording: a slow disk never stops the camera, and every frame lost to it is counted."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from inspector.errors import NothingRecorded, RecordingError
from inspector.recording import SweepWriter
from models.frame import Frame

IDLE_SECONDS = 0.2
"""How long the writer waits for a frame before it looks whether a flush is due."""


class FrameSource(Protocol):
    """What is needed of a camera: its frames, and facts for the recording."""

    def frames(self) -> Iterator[Frame]:
        """The frames in order of exposure; ends when the camera does."""
        ...

    def describe(self) -> Mapping[str, str]:
        """Facts of the camera; never a password."""
        ...


@dataclass(frozen=True)
class RecordingSummary:
    """What has been recorded: so far, or in the end."""

    frames: int
    """Frames taken from the camera and kept."""
    drops: int
    """Frames that came while the queue was full."""
    bytes: int
    """Size of the file on the disk."""
    seconds: float
    """From the first frame to the last, by the frames' own time."""


@dataclass(frozen=True)
class _Entry:
    frame: Frame
    dropped: int
    """Frames lost between the entry before and this one."""


class _WriterThread(threading.Thread):
    """Empties the queue into the recording; ends at None, or at the first error, which it keeps."""

    def __init__(self, writer: SweepWriter, size: int) -> None:
        super().__init__(name="sweep-writer", daemon=True)
        self.entries: queue.Queue[_Entry | None] = queue.Queue(size)
        self.error: Exception | None = None
        self._writer = writer

    def run(self) -> None:
        try:
            while self._step():
                pass
        except Exception as error:
            # Kept for the thread that records, which raises it.
            self.error = error
            self._drain()

    def _step(self) -> bool:
        try:
            entry = self.entries.get(timeout=IDLE_SECONDS)
        except queue.Empty:
            self._writer.flush_if_due()
            return True
        if entry is None:
            return False
        if entry.dropped:
            self._writer.drop(entry.dropped, entry.frame.t_ns)
        self._writer.write(entry.frame)
        return True

    def _drain(self) -> None:
        """Nobody may wait for room in a queue that nobody empties."""
        while self.entries.get() is not None:
            pass


class _Recording:
    """The camera's side: offers each frame, counts what finds no room."""

    def __init__(self, thread: _WriterThread, writer: SweepWriter, lossless: bool) -> None:
        self._thread, self._writer, self._lossless = thread, writer, lossless
        self._first: int | None = None
        self._last = 0
        self._kept = 0
        self._drops = 0
        self.pending = 0
        """Frames dropped since the last one that was kept."""

    @property
    def last_ns(self) -> int:
        return self._last

    def offer(self, frame: Frame) -> None:
        self._first = frame.t_ns if self._first is None else self._first
        self._last = frame.t_ns
        try:
            self._thread.entries.put(_Entry(frame, self.pending), block=self._lossless)
        except queue.Full:
            self._drops += 1
            self.pending += 1
        else:
            self._kept += 1
            self.pending = 0

    def done(self, frames: int | None, seconds: float | None) -> bool:
        return (frames is not None and self._kept + self._drops >= frames) or (
            seconds is not None and self.summary().seconds >= seconds
        )

    def summary(self) -> RecordingSummary:
        seconds = (self._last - (self._first or 0)) / 1e9 if self._first is not None else 0.0
        return RecordingSummary(self._kept, self._drops, self._writer.bytes, seconds)


def record(
    camera: FrameSource,
    path: Path | str,
    *,
    seconds: float | None = None,
    frames: int | None = None,
    product_id: str | None = None,
    part_id: str | None = None,
    queue_size: int = 64,
    lossless: bool = False,
    flush_seconds: float = 1.0,
    on_progress: Callable[[RecordingSummary], object] | None = None,
    stop: threading.Event | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> RecordingSummary:
    """Record until the camera ends, `seconds` or `frames` are reached, or `stop` is set; the file is closed properly.

    `frames` counts what the camera delivered, dropped or not: the end of a sweep does not move with the disk.
    `lossless` makes the source wait for the disk instead of dropping: right for files, wrong for a live camera.
    """
    facts = dict(camera.describe())
    writer = SweepWriter(
        path, product_id=product_id, part_id=part_id, metadata=facts, flush_seconds=flush_seconds, clock=clock
    )
    thread = _WriterThread(writer, queue_size)
    recording = _Recording(thread, writer, lossless)
    thread.start()
    try:
        for frame in camera.frames():
            if thread.error is not None or (stop is not None and stop.is_set()):
                break
            recording.offer(frame)
            if on_progress is not None:
                on_progress(recording.summary())
            if recording.done(frames, seconds):
                break
    finally:
        thread.entries.put(None)
        thread.join()
        _finish(writer, thread, recording)
    if not writer.frames:
        raise NothingRecorded(writer.path)
    return recording.summary()


def _finish(writer: SweepWriter, thread: _WriterThread, recording: _Recording) -> None:
    """Close the file, whatever happened; a file without a frame is taken away again."""
    if thread.error is not None:
        with suppress(RecordingError):
            writer.close()
        raise thread.error
    with closing(writer):
        if recording.pending:
            writer.drop(recording.pending, recording.last_ns)
    if not writer.frames:
        writer.path.unlink()
