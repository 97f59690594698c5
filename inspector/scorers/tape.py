"""Tapes: the recordings of a scorer's inspections, written by one thread, so that no score waits for the disk.

A tape takes exactly the frames that were scored, in that order. Its queue is bounded: a disk that is too slow makes
the scorer wait, the frames pile up before it, and what finds no room there is dropped and counted; a frame that was
scored is never missing. A tape that cannot be written on says so, and the inspection goes on without.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from inspector.recording import SweepWriter
from models.frame import Frame

_QUEUE = 64
_IDLE_SECONDS = 0.2


@dataclass(frozen=True)
class Recorded:
    """What became of a recording."""

    frames: int
    bytes: int
    note: str | None
    """Why it is not whole, where it is not."""


class TapeThread(threading.Thread):
    """Writes what the tapes hand in, in order; brings what is due to the disk when nothing comes."""

    def __init__(self) -> None:
        super().__init__(name="tapes", daemon=True)
        self.jobs: queue.Queue[Callable[[], object] | None] = queue.Queue(_QUEUE)
        self.tapes: set[Tape] = set()

    def run(self) -> None:
        while True:
            try:
                job = self.jobs.get(timeout=_IDLE_SECONDS)
            except queue.Empty:
                for tape in [*self.tapes]:
                    tape.flush_if_due()
                continue
            if job is None:
                return
            job()

    def finish(self) -> None:
        """All that was handed in is written, all tapes are closed."""
        for tape in [*self.tapes]:
            tape.close(lambda recorded: None)
        self.jobs.put(None)
        self.join()


class Tape:
    """The recording of one inspection. What goes wrong is kept in `note`, and ends the recording only."""

    def __init__(self, thread: TapeThread, path: Path, facts: dict[str, str]) -> None:
        self.note: str | None = None
        self._thread = thread
        self._writer = SweepWriter(path, metadata=facts)
        thread.tapes.add(self)

    def write(self, frame: Frame) -> None:
        """Append a frame; waits while the queue is full."""
        self._thread.jobs.put(lambda: self._attempt(lambda: self._writer.write(frame)))

    def drop(self, count: int, t_ns: int) -> None:
        """Tell that so many frames were lost before this time."""
        self._thread.jobs.put(lambda: self._attempt(lambda: self._writer.drop(count, t_ns)))

    def flush(self, then: Callable[[], object]) -> None:
        """Bring everything so far to the disk, then call back, from the thread of the tapes."""

        def flushing() -> None:
            self._attempt(self._writer.flush)
            then()

        self._thread.jobs.put(flushing)

    def close(self, then: Callable[[Recorded], object]) -> None:
        """Write the index and close, then call back, from the thread of the tapes."""

        def closing() -> None:
            self._attempt(self._writer.close)
            self._thread.tapes.discard(self)
            size = self._writer.path.stat().st_size if self._writer.path.exists() else 0
            then(Recorded(self._writer.frames, size, self.note))

        self._thread.jobs.put(closing)

    def flush_if_due(self) -> None:
        """For pauses in which no frame comes; called by the thread of the tapes."""
        self._attempt(self._writer.flush_if_due)

    def _attempt(self, action: Callable[[], object]) -> None:
        if self.note is None:
            try:
                action()
            except Exception as error:
                # Whatever it is: the thread goes on for the other tapes, and the inspection without a recording.
                self.note = str(error) or type(error).__name__
