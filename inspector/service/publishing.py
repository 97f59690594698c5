"""Publishing: closed recordings go where they are kept. What cannot be brought there waits on the disk, and is told."""

from __future__ import annotations

import threading
from collections import OrderedDict
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import structlog

from inspector.errors import WorldError
from inspector.service.files import Files
from inspector.service.folder import remove
from inspector.service.metrics import Metrics
from inspector.stores.base import AbstractStore
from inspector.stores.errors import NoSuch
from inspector.stores.records import StoredInspection

_log = structlog.get_logger("inspector")
_FIRST_WAIT, _LONGEST_WAIT = 0.5, 30.0
"""Seconds until it is tried again."""
_CLOSING_SECONDS = 10.0


@dataclass(frozen=True)
class _Waiting:
    recording: Path
    bytes: int
    note: str | None


class Publishing:
    """Recordings in the data folder itself are there already; others are brought where they belong by a thread."""

    def __init__(self, store: AbstractStore, files: Files, metrics: Metrics) -> None:
        self._store, self._files, self._metrics = store, files, metrics
        self._waiting: OrderedDict[str, _Waiting] = OrderedDict()
        self._changed = threading.Condition()
        self._closing = False
        self._thread: threading.Thread | None = None
        self.trouble: str | None = None
        """Why nothing could be brought away, the last time; None where it could."""

    def start(self) -> None:
        """What an earlier run left is taken up; then what is handed in. Blocks for a moment."""
        if self._files.common:
            self._thread = threading.Thread(target=self._run, name="publishing", daemon=True)
            self._thread.start()
        for inspection_id, take, path in self._files.left():
            with suppress(NoSuch):
                self._take_up(self._store.inspection(inspection_id), take, path)

    def keep(self, inspection_id: str, recording: Path, note: str | None) -> StoredInspection:
        """A recording that is closed, or that nobody will close, stays; in the store it is `kept` once it is in place.

        Blocks. Raises NoSuchInspection, StoreError, NotWritten.
        """
        whole = self._files.whole(inspection_id)
        found = recording if recording.exists() else whole
        size = found.stat().st_size if found.exists() else 0
        if not size:
            there = self._files.size("inspection", inspection_id) if self._files.common and not found.exists() else None
            remove(found)
            return self._store.set_recording(inspection_id, "kept" if there else "none", there or 0, note)
        if not self._files.common:
            self._files.publish(found, "inspection", inspection_id)
            return self._store.set_recording(inspection_id, "kept", size, note)
        with suppress(OSError):
            # By this name the next start takes it up.
            found = found.rename(whole)
        stored = self._store.set_recording(inspection_id, "being written", size, note)
        self._hand_in(inspection_id, _Waiting(found, size, note))
        return stored

    def close(self) -> None:
        """What waits is tried once more, for some seconds; the next start takes up the rest. Blocks."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join(_CLOSING_SECONDS)

    def _take_up(self, stored: StoredInspection, take: int | None, path: Path) -> None:
        """A file that an earlier run of this service left; what else there may be is mended later."""
        inspection_id, running = stored.inspection_id, stored.state == "processing"
        if take is None and not running:
            note = stored.recording_note
            self._hand_in(inspection_id, _Waiting(path, path.stat().st_size, note))
        elif take is not None and running:
            # For whoever has it now, and concludes it.
            with suppress(WorldError):
                self._files.publish(path, "part", f"{inspection_id}.{take}")

    def has(self, inspection_id: str) -> bool:
        """Whether that recording waits here."""
        with self._changed:
            return inspection_id in self._waiting

    def _hand_in(self, inspection_id: str, what: _Waiting) -> None:
        with self._changed:
            self._waiting[inspection_id] = what
            self._metrics.unpublished.set(len(self._waiting))
            self._changed.notify_all()

    def _run(self) -> None:
        wait = _FIRST_WAIT
        while (next_one := self._next()) is not None:
            inspection_id, what = next_one
            try:
                self._bring(inspection_id, what)
            except (WorldError, OSError) as error:
                self.trouble = self._files.hidden(str(error))
                _log.error("recording", inspection_id=inspection_id, state="waits to be published", error=self.trouble)
                with self._changed:
                    # Another one may do better: one file that cannot be read does not hold up the rest.
                    self._waiting.move_to_end(inspection_id)
                    if self._closing or self._changed.wait_for(lambda: self._closing, wait):
                        return
                wait = min(2 * wait, _LONGEST_WAIT)
            else:
                self.trouble, wait = None, _FIRST_WAIT

    def _next(self) -> tuple[str, _Waiting] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._closing or self._waiting)
            return next(iter(self._waiting.items()), None)

    def _bring(self, inspection_id: str, what: _Waiting) -> None:
        # Brought away before, where only the store could not be told.
        if what.recording.exists():
            self._files.publish(what.recording, "inspection", inspection_id)
        self._store.set_recording(inspection_id, "kept", what.bytes, what.note)
        with self._changed:
            del self._waiting[inspection_id]
            self._metrics.unpublished.set(len(self._waiting))
