"""Mending: recordings that a crash left half way between their end and their place, and files that nobody needs."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import structlog

from inspector.errors import RecordingError
from inspector.recording import SweepReader, join_parts
from inspector.service.files import Files
from inspector.service.folder import remove
from inspector.service.publishing import Publishing
from inspector.service.retention import DAY_NS
from inspector.stores.base import AbstractStore
from inspector.stores.errors import NoSuch
from inspector.stores.records import StoredInspection

_log = structlog.get_logger("inspector")
_BUSY_NS = 60_000_000_000
"""So long after the end of an inspection somebody may still be busy with its recording."""
_ALL_NS = 720_000_000_000
"""After so long, every service that lives has mended twice, and handed on what it had."""
_MENDED = "put together after a crash: frames may be missing"


class Mending:
    """Of one service. Everything here blocks."""

    def __init__(self, store: AbstractStore, files: Files, publishing: Publishing) -> None:
        self._store, self._files, self._publishing = store, files, publishing

    def mend(self, now_ns: int, keep_days: float) -> None:
        """Now and then, by each service: first its own files, then, by one of them, those that all have.

        Raises StoreError, ObjectError.
        """
        for inspection_id, take, path in self._files.left():
            with suppress(NoSuch):
                stored = self._store.inspection(inspection_id)
                if take is not None and _over(stored, now_ns, _BUSY_NS):
                    self._settle(stored, take, path, now_ns - (stored.ended_ns or 0) > keep_days * DAY_NS)
        with self._store.only_one("mending") as mine:
            for left in self._store.recordings("being written") if mine or not self._files.common else ():
                stored = self._store.inspection(left.inspection_id)
                if _over(stored, now_ns, _ALL_NS) and not self._publishing.has(stored.inspection_id):
                    self._put_together(stored)
        self._files.drop_copies(now_ns)

    def _settle(self, stored: StoredInspection, take: int, path: Path, is_old: bool) -> None:
        """What this service recorded of an inspection that has ended."""
        if stored.recording == "being written":
            self._files.publish(path, "part", f"{stored.inspection_id}.{take}")
        elif stored.recording == "none" and not is_old:
            self._publishing.keep(stored.inspection_id, path, _MENDED)
        elif is_old or stored.recording == "removed":
            remove(path)

    def _put_together(self, stored: StoredInspection) -> None:
        """Of all parts that are there, each up to where the next one begins."""
        inspection_id = stored.inspection_id
        parts = [f"{inspection_id}.{take}" for take in range(stored.takes + 1)]
        places = [self._files.place("part", part) for part in parts if self._files.size("part", part)]
        begins = {place: begin for place in places if (begin := _begin(place)) is not None}
        if begins:
            out = self._files.incoming()
            join_parts([*begins], [0, *[*begins.values()][1:]], out)
            self._publishing.keep(inspection_id, out, _MENDED)
            _log.warning("recording", inspection_id=inspection_id, state="kept", note=_MENDED)
        elif self._files.size("inspection", inspection_id):
            # In its place, and only the store was not told.
            self._publishing.keep(inspection_id, self._files.whole(inspection_id), stored.recording_note)
        # Else it is elsewhere: at a service that does not run, or that cannot bring it away.
        for part in parts:
            self._files.remove("part", part)


def _over(stored: StoredInspection, now_ns: int, for_ns: int) -> bool:
    return stored.state != "processing" and stored.ended_ns is not None and now_ns - stored.ended_ns > for_ns


def _begin(place: str) -> int | None:
    """The number of the first frame of a part; None where it has none."""
    try:
        return next(iter(SweepReader(place))).sequence
    except RecordingError:
        return None
