"""What stays of an inspection that has ended: its result and scores in the store, its recording. Everything blocks."""

from __future__ import annotations

import time
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

import structlog

from inspector.errors import WorldError
from inspector.recording import join_parts
from inspector.service.checkpoints import Kept, restored
from inspector.service.files import Files
from inspector.service.folder import remove
from inspector.service.publishing import Publishing
from inspector.service.running import Ended
from inspector.stores.base import AbstractStore
from inspector.stores.errors import StoreConflict
from inspector.stores.records import StoredInspection

_NOT_CLOSED = "not closed properly: the last second may be missing"
KILLED = "the service ended while the inspection was processing"
_log = structlog.get_logger("inspector")


class Endings:
    """Stores ends; each says that it is this process that had the inspection, and raises NotOwner where it had not."""

    def __init__(self, store: AbstractStore, files: Files, publishing: Publishing, node_id: str) -> None:
        self._store, self._files, self._publishing, self._node_id = store, files, publishing, node_id

    def conclude(self, inspection_id: str, ended: Ended, kept: Kept, reason: str | None) -> StoredInspection:
        """The result and its scores, then what became of the recording; a recording in parts waits for `join`."""
        verdict, result, scores = ended.result["verdict"], ended.result, ended.scores
        state = ended.result["result_state"]
        stored = self._end(inspection_id, state, verdict=verdict, result=result, scores=scores, reason=reason)
        if kept.starts:
            return stored
        return self._publishing.keep(inspection_id, self._files.tape(inspection_id), ended.recording["note"])

    def join(self, stored: StoredInspection, kept: Kept, note: str | None = None) -> None:
        """The recording of an inspection that more than one process had, of all parts that can be had."""
        inspection_id, begins = stored.inspection_id, [(0, 0), *kept.starts]
        found = [(take, start, self._part(inspection_id, take)) for take, start in begins]
        notes = [note] if note else []
        for (take, start, place), (_, end, _) in pairwise([*found, (0, 1 << 32, None)]):
            if place is None and start < end:
                until = f" to {end - 1}" if take != stored.takes else " on"
                notes.append(f"frames from {start}{until} are not in it: the process that recorded them was lost")
        out = self._files.incoming()
        try:
            there = [(place, start) for _, start, place in found if place is not None]
            if there:
                join_parts([place for place, _ in there], [start for _, start in there], out)
            self._publishing.keep(inspection_id, out, "; ".join(notes) or None)
            for take, _, _ in found:
                if (tape := self._files.tape(inspection_id, take)) != self._files.whole(inspection_id):
                    remove(tape)
            self._forget(inspection_id, [take for take, _, _ in found])
        except (WorldError, OSError) as error:
            _log.error("recording", inspection_id=inspection_id, state="not joined", error=str(error))

    def lose(self, inspection_id: str, why: str) -> StoredInspection:
        """It failed: there is no verdict, and what is on the disk stays."""
        self._end(inspection_id, "failed", reason=why)
        return self._keep_what_is_there(inspection_id)

    def recover(self) -> None:
        """At start, where no other process shares the store: what a crash left behind."""
        self._store.abort_processing(time.time_ns(), KILLED)
        for left in self._store.recordings("being written"):
            self._keep_what_is_there(left.inspection_id)

    def abandon(self, idle_seconds: float) -> list[StoredInspection]:
        """Inspections that no process has, and that nobody fed for so long, are aborted."""
        ended: list[StoredInspection] = []
        with self._store.only_one("abandon") as mine:
            for left in self._store.ownerless() if mine else ():
                idle = (time.time_ns() - (left.left_ns or left.begun_ns)) / 1e9
                if left.source == "live" and idle > idle_seconds:
                    ended += self._abandoned(left.inspection_id, idle_seconds)
        return ended

    def _abandoned(self, inspection_id: str, idle_seconds: float) -> list[StoredInspection]:
        why = f"its process was lost, and no frame came for {idle_seconds:g} s"
        try:
            taken, checkpoint = self._store.take_inspection(inspection_id, self._node_id)
            stored = self._end(inspection_id, "aborted", reason=why)
        except StoreConflict:
            # Somebody goes on with it just now.
            return []
        self.join(stored, restored(checkpoint, taken.takes).kept, why)
        return [stored]

    def _end(self, inspection_id: str, state: Any, **more: Any) -> StoredInspection:
        usual: dict[str, Any] = {"verdict": None, "result": None, "scores": None, "node": self._node_id}
        return self._store.conclude_inspection(inspection_id, state, ended_ns=time.time_ns(), **usual | more)

    def _keep_what_is_there(self, inspection_id: str) -> StoredInspection:
        """The recording of an inspection that nobody closed."""
        return self._publishing.keep(inspection_id, self._files.tape(inspection_id), _NOT_CLOSED)

    def _part(self, inspection_id: str, take: int) -> str | None:
        """Where a process's share of a recording is."""
        own: Path = self._files.tape(inspection_id, take)
        if own.exists() and own.stat().st_size:
            return str(own)
        id = f"{inspection_id}.{take}"
        return self._files.place("part", id) if self._files.size("part", id) else None

    def _forget(self, inspection_id: str, takes: Iterable[int]) -> None:
        for take in takes:
            self._files.remove("part", f"{inspection_id}.{take}")
