"""How a running inspection gets from one process to another: saved while it runs, handed over, taken over.

Who owns it is a column of the store, and every write says who does it: a process that lost an inspection, and does not
know it yet, cannot change anything any more.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from typing import Protocol

import structlog

from inspector.errors import WorldError
from inspector.scorers.wire import Head
from inspector.service.checkpoints import Cut, Kept, chunk_bytes, read_chunks, read_state, state_bytes
from inspector.service.files import Files
from inspector.service.running import Running
from inspector.stores.base import AbstractStore, AlreadyConcluded
from inspector.stores.records import Checkpoint, StoredInspection

SAVE_SECONDS = 1.0
"""How much of an inspection a process takes with it when it is killed; lines send it once more."""
_HANDED_SECONDS, _LOOK_SECONDS = 0.5, 0.02
"""How long a process that is there is waited for, and how often it is looked whether it is done."""


_log = structlog.get_logger("inspector")


class HandOver(Protocol):
    """Asks a process to hand over an inspection."""

    def __call__(self, node_id: str, *, inspection_id: str) -> bool:
        """False where there is no such process."""
        ...


class Moving:
    """Saves, gives and takes. Used from the event loop; the store is asked in threads."""

    def __init__(self, store: AbstractStore, files: Files, node_id: str, ask: HandOver) -> None:
        self._store, self._files, self._node, self._ask = store, files, node_id, ask

    def due(self, running: Running) -> bool:
        """Whether it is time to save it."""
        ledger = running.ledger
        late = time.monotonic() - ledger.saved_at > SAVE_SECONDS
        return late and ledger.due and running.phase == "open" and not ledger.turn.locked()

    async def save(self, running: Running) -> None:
        """All that was said of it so far is in the store when this returns. Raises StoreError, Moved, ScorerLost."""
        async with running.ledger.turn:
            if running.phase == "open" and running.ledger.due:
                await self._save(running, await running.cut())

    async def give(self, running: Running) -> None:
        """Another process may have it from now on, at the last frame that came. Raises as `save` does."""
        async with running.ledger.turn:
            if running.phase != "open":
                return
            running.phase = "moved"
            running.wake()
            try:
                cut, _ = await asyncio.gather(running.cut(), running.release())
                await self._save(running, cut)
                await asyncio.to_thread(self._publish, running)
                await asyncio.to_thread(
                    self._store.release_inspection, running.inspection_id, self._node, time.time_ns()
                )
            finally:
                running.move()

    async def claim(self, inspection_id: str) -> tuple[StoredInspection, Checkpoint | None]:
        """An inspection in processing is this process's from now on; who has it hands it over, where it can.

        Raises NoSuchInspection, AlreadyConcluded, StoreFailed.
        """
        stored = await asyncio.to_thread(self._store.inspection, inspection_id)
        if stored.state != "processing" or stored.source != "live":
            raise AlreadyConcluded(inspection_id, stored.state)
        if stored.node not in (None, self._node) and self._ask(stored.node, inspection_id=inspection_id):
            owner, until = stored.node, time.monotonic() + _HANDED_SECONDS
            while stored.node == owner and time.monotonic() < until:
                await asyncio.sleep(_LOOK_SECONDS)
                stored = await asyncio.to_thread(self._store.inspection, inspection_id)
        return await asyncio.to_thread(self._store.take_inspection, inspection_id, self._node)

    def _publish(self, running: Running) -> None:
        """The share of the recording that was made here, for whoever concludes it."""
        take = max((take for take, _ in running.ledger.kept.starts), default=0)
        tape = self._files.tape(running.inspection_id, take)
        if self._files.common and tape.exists():
            try:
                self._files.publish(tape, "part", f"{running.inspection_id}.{take}")
            except WorldError as error:
                # It stays here; this service's next start tries again.
                _log.warning("recording", inspection_id=running.inspection_id, state="not handed on", error=str(error))

    async def _save(self, running: Running, cut: Cut) -> None:
        ledger = running.ledger
        ledger.saved_at = time.monotonic()
        ledger.unstored.append((cut.frames, cut.lines))
        state, added = state_bytes(cut.kept, cut.state), chunk_bytes(ledger.unstored)
        save = self._store.save_checkpoint
        await asyncio.to_thread(save, running.inspection_id, self._node, ledger.chunks, state, added)
        ledger.unstored.clear()
        ledger.chunks += 1
        running.tell_saved(cut.kept.next)


def restored(stored: StoredInspection, checkpoint: Checkpoint | None) -> tuple[Kept, list[bytes], Head, bytes]:
    """What the service kept, the messages, and what the scorer's `begin` takes more: of its head, and its body."""
    kept, scorer = Kept(), b""
    frames: list[bytes] = []
    lines: list[bytes] = []
    if checkpoint is not None:
        # one that a crash of the database has lost is empty, and the scorer says so
        kept, scorer = read_state(checkpoint.state) if checkpoint.state else (kept, b"")
        frames, lines = read_chunks(checkpoint.added)
    kept = replace(kept, starts=(*kept.starts, (stored.takes, kept.next)))
    resume: Head = {"resume": [len(scorer), *map(len, frames)]} if checkpoint is not None else {}
    return kept, lines, resume, scorer + b"".join(frames)
