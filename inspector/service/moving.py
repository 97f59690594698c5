"""How a running inspection gets from one process to another: saved while it runs, handed over, claimed, dropped.

Who owns it is a column of the store, and every write says who does it: a process that lost an inspection, and does not
know it yet, cannot change anything any more.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from pathlib import Path
from typing import Protocol

import structlog

from inspector.errors import StoreError, WorldError
from inspector.service.background import Background
from inspector.service.checkpoints import Cut, Restored, chunk_bytes, restored, state_bytes
from inspector.service.errors import Moved
from inspector.service.files import Files
from inspector.service.roster import Roster
from inspector.service.running import Running
from inspector.stores.base import AbstractStore
from inspector.stores.errors import AlreadyConcluded, NotOwner
from inspector.stores.records import StoredInspection

SAVE_SECONDS = 1.0
"""How much of an inspection a process takes with it when it is killed; lines send it once more."""
_LOOK_SECONDS = 0.25
"""How often it is looked what is to be saved."""
_HANDED_SECONDS, _ASK_SECONDS = 0.5, 0.02
"""How long a process that is there is waited for, and how often it is asked whether it is done."""
_STILL_SECONDS, _DOUBT_SECONDS = 3.0, 1.0
"""How long an inspection stands still before it is asked whose it is, and how often that is looked for."""
_log = structlog.get_logger("inspector")


class HandOver(Protocol):
    """Asks a process to hand over an inspection."""

    def __call__(self, node_id: str, *, inspection_id: str) -> bool:
        """False where there is no such process."""
        ...


class Moving:
    """Saves, gives, claims and drops. Used from the event loop; the store is asked in threads."""

    def __init__(
        self, store: AbstractStore, files: Files, roster: Roster, background: Background, *, node_id: str, ask: HandOver
    ) -> None:
        self._store, self._files, self._roster, self._background = store, files, roster, background
        self._node, self._ask = node_id, ask

    async def save_loop(self) -> None:
        """What runs here is saved about once a second, each beside the others."""
        while True:
            await asyncio.sleep(_LOOK_SECONDS)
            for running in self._roster:
                if _due(running):
                    self._background.keep(self.save(running))

    async def doubt_loop(self) -> None:
        """What stands still may have been taken while nobody could say so: it is asked whose it is."""
        while True:
            await asyncio.sleep(_DOUBT_SECONDS)
            now = time.monotonic()
            for running in self._roster:
                if running.phase == "open" and now - max(running.touched, running.asked_at) > _STILL_SECONDS:
                    running.asked_at = now
                    with suppress(WorldError):
                        await self._drop_if_taken(running)

    async def save(self, running: Running) -> None:
        """All that was said of it so far is in the store when this returns; what cannot be stored is with the next."""
        try:
            async with running.ledger.turn:
                if running.phase == "open" and running.ledger.due:
                    await self._save(running, await running.cut())
        except (NotOwner, Moved) as error:
            await self.drop(running, running.lost_because or str(error))
        except WorldError as error:
            _log.warning("inspection not saved", **running.facts, error=str(error))

    async def give(self, running: Running) -> None:
        """Another process may have it from now on, at the last frame that came; or at the last save, if that fails."""
        try:
            async with running.ledger.turn:
                if running.phase == "open":
                    await self._give(running)
        except WorldError as error:
            _log.warning("inspection not handed over", **running.facts, error=str(error))
        if running.phase == "moved":
            self._roster.remove(running)

    async def claim(self, inspection_id: str) -> tuple[StoredInspection, Path, Restored]:
        """An inspection in processing is this process's from now on; who has it hands it over, where it can.

        The answer has the place of its appearance here. Raises NoSuchInspection, AlreadyConcluded, StoreFailed, and
        what `local_appearance` raises: then it is left to whoever has it.
        """
        stored = await asyncio.to_thread(self._store.inspection, inspection_id)
        if stored.state != "processing" or stored.source != "live":
            raise AlreadyConcluded(inspection_id, stored.state)
        appearance = await asyncio.to_thread(self._files.local_appearance, stored.appearance_id)
        if stored.node not in (None, self._node) and self._ask(stored.node, inspection_id=inspection_id):
            owner, until = stored.node, time.monotonic() + _HANDED_SECONDS
            while stored.node == owner and time.monotonic() < until:
                await asyncio.sleep(_ASK_SECONDS)
                stored = await asyncio.to_thread(self._store.inspection, inspection_id)
        taken, checkpoint = await asyncio.to_thread(self._store.take_inspection, inspection_id, self._node)
        return taken, appearance, restored(checkpoint, taken.takes)

    async def drop(self, running: Running, why: str) -> None:
        """It is another process's, or its scorer is gone: whoever is sent the next frame goes on from the last save."""
        if running.phase == "moved":
            return
        was, running.phase = running.phase, "moved"
        if was == "open" and running.lost_because is None:
            with suppress(WorldError):
                await running.release()
        with suppress(StoreError):
            await self._release(running)
        running.move()
        self._roster.remove(running)
        _log.warning("inspection dropped", **running.facts, why=why)

    async def _give(self, running: Running) -> None:
        """Raises StoreError, Moved."""
        running.phase = "moved"
        running.wake()
        try:
            cut, _ = await asyncio.gather(running.cut(), running.release())
            await self._save(running, cut)
            await asyncio.to_thread(self._publish, running)
            await self._release(running)
        finally:
            running.move()

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

    async def _release(self, running: Running) -> None:
        release = self._store.release_inspection
        await asyncio.to_thread(release, running.inspection_id, self._node, time.time_ns())

    async def _drop_if_taken(self, running: Running) -> None:
        stored = await asyncio.to_thread(self._store.inspection, running.inspection_id)
        if stored.state != "processing" or stored.node != self._node:
            await self.drop(running, "another process has taken it over")

    def _publish(self, running: Running) -> None:
        """The share of the recording that was made here, for whoever concludes it."""
        inspection_id, take = running.inspection_id, running.row.takes
        tape = self._files.tape(inspection_id, take)
        if self._files.common and tape.exists():
            try:
                self._files.publish(tape, "part", f"{inspection_id}.{take}")
            except WorldError as error:
                # It stays here; this service's next start tries again.
                _log.warning("recording", inspection_id=inspection_id, state="not handed on", error=str(error))


def _due(running: Running) -> bool:
    """Whether it is time to save it."""
    ledger = running.ledger
    late = time.monotonic() - ledger.saved_at > SAVE_SECONDS
    return late and ledger.due and running.phase == "open" and not ledger.turn.locked()
