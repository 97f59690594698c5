"""The life of inspections: begun, fed, concluded or aborted, stored; none is forgotten, none is stored twice."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from itertools import islice
from pathlib import Path

import structlog

from inspector.errors import StoreError, WorldError
from inspector.scorers.pool import Pool
from inspector.service.background import Background
from inspector.service.checkpoints import Restored
from inspector.service.endings import Endings
from inspector.service.errors import AtCapacity, Moved, NotOpen, ResumeFrom, ScorerLost, Stopping
from inspector.service.events import Events
from inspector.service.files import Files
from inspector.service.folder import new_id
from inspector.service.metrics import Metrics
from inspector.service.moving import HandOver, Moving
from inspector.service.naming import Naming
from inspector.service.publishing import Publishing
from inspector.service.recipes import active_recipes, recipe_of
from inspector.service.recognising import Recognising
from inspector.service.roster import Roster
from inspector.service.running import Around, Bounds, Ended, Running
from inspector.service.station import Station
from inspector.stores.base import AbstractStore
from inspector.stores.errors import AlreadyConcluded, IdTaken, NoSuchInspection, NotOwner
from inspector.stores.records import StoredInspection
from models.verdict import Policy

_LOADED = 8
"""Appearances that scorers load at the start: those of the newest products."""
_IDLE_LOOK_SECONDS, _ABANDON_SECONDS = 1.0, 2.0
_log = structlog.get_logger("inspector")


class Inspections:
    """All inspections that run in this process. Used from the event loop; the store is asked in threads."""

    def __init__(
        self,
        store: AbstractStore,
        files: Files,
        events: Events,
        metrics: Metrics,
        recognising: Recognising,
        *,
        publishing: Publishing,
        scorers: int,
        max_inspections: int,
        max_pixels: int,
        bounds: Bounds,
        idle_seconds: float,
        node_id: str,
        hand_over: HandOver,
    ) -> None:
        """`node_id` names this process to others that share the store; `hand_over` asks one of them for an inspection,
        and returns False where it is not there.
        """
        self.pool = Pool(scorers, max_pixels)
        self.roster = Roster()
        self.station = Station(self.roster, self.pool, events, metrics, max_inspections)
        self._store, self._files, self._events, self._metrics = store, files, events, metrics
        self._idle_seconds, self._node_id = idle_seconds, node_id
        self._around = Around(bounds, events, metrics, lambda: self.pool.waiting_bytes, store.shared)
        self._background = Background()
        self._naming = Naming(recognising, files, self._background.keep)
        self._moving = Moving(store, files, self.roster, self._background, node_id=node_id, ask=hand_over)
        self._endings = Endings(store, files, publishing, node_id)
        self._taken: dict[str, asyncio.Task[Running]] = {}
        """Inspections that are being taken over."""

    async def start(self) -> None:
        """Inspections that a crash left in processing are aborted; then the scorers begin, with what is active."""
        if not self._store.shared:
            await asyncio.to_thread(self._endings.recover)
        await self.pool.start()
        for recipe in await asyncio.to_thread(lambda: [*islice(active_recipes(self._store), _LOADED)]):
            self.load(recipe.appearance_id)
        loops = [self._idle_loop(), self.station.tell_loop(), self._metrics.watch_loop(time.perf_counter)]
        if self._store.shared:
            loops += [self._moving.save_loop(), self._moving.doubt_loop(), self._abandon_loop()]
        for loop in loops:
            self._background.keep(loop)

    async def stop(self) -> None:
        """What waits is scored; what runs is aborted and says so, or, on a store that others share, saved for them.

        Files are closed. A second call does nothing.
        """
        if self.station.stopping:
            return
        self.station.stop()
        if self._store.shared:
            await asyncio.gather(*map(self._moving.give, self.roster))
        for running in self.roster:
            with suppress(WorldError):
                await self._end(running, reason="the service was stopped")
        # What is being concluded just now, and then recordings in parts.
        await self._background.stop()
        await self.pool.stop()

    def load(self, appearance_id: str) -> None:
        """Have it ready in every scorer: it will be needed. And where there are several, to tell them apart."""
        self._background.keep(self._prepare(appearance_id))

    async def _prepare(self, appearance_id: str) -> None:
        with suppress(WorldError):
            path = await asyncio.to_thread(self._files.local_appearance, appearance_id)
            self.pool.load(appearance_id, str(path))
            await self._naming.prepare()

    def find(self, inspection_id: str) -> Running | None:
        """The inspection, if it runs here, or ended here a short while ago."""
        return self.roster.find(inspection_id)

    # From the begin on.

    async def begin(
        self, product_id: str, part_id: str, recipe_id: str | None = None, inspection_id: str | None = None
    ) -> StoredInspection:
        """A new inspection, ready for frames; the one that has that id already, where it is of the same part and runs.

        Raises Stopping, AtCapacity, NoRecipe, NoSuchProduct, NoSuchRecipe, IdTaken, ScorerLost.
        """
        if self.station.stopping:
            raise Stopping
        if inspection_id is not None and (begun := await self._begun(inspection_id)) is not None:
            if (begun.product_id, begun.part_id) != (product_id, part_id):
                raise IdTaken("inspection", inspection_id)
            await self.open(inspection_id)
            return begun
        with self.station.room():
            return await self._begin(product_id, part_id, recipe_id, inspection_id or new_id())

    async def _begun(self, inspection_id: str) -> StoredInspection | None:
        with suppress(NoSuchInspection):
            return await asyncio.to_thread(self._store.inspection, inspection_id)
        return None

    async def _begin(
        self, product_id: str, part_id: str, recipe_id: str | None, inspection_id: str
    ) -> StoredInspection:
        recipe = await asyncio.to_thread(recipe_of, self._store, product_id, recipe_id)
        appearance = await asyncio.to_thread(self._files.local_appearance, recipe.appearance_id)
        if self.pool.least() is None:
            raise AtCapacity("the processes that score are being started")
        stored = await asyncio.to_thread(
            self._store.begin_inspection,
            inspection_id,
            product_id,
            part_id=part_id,
            recipe_id=recipe.recipe_id,
            appearance_id=recipe.appearance_id,
            policy=asdict(Policy(**recipe.policy)),
            begun_ns=time.time_ns(),
            node=self._node_id,
        )
        running = await self._run(stored, appearance)
        self._events.publish("begun", **running.facts)
        return stored

    async def _run(self, stored: StoredInspection, appearance: Path, restored: Restored | None = None) -> Running:
        """A scorer is ready for its frames, from the beginning or from where it is. Raises ScorerLost, Moved."""
        # Chosen now, and pinned before anybody else has a turn.
        running = Running(stored, self.pool.least() or self.pool.scorers[0], self._around)
        running.doubted = partial(self._naming.ask, running)
        running.begin(appearance, self._files.tape(stored.inspection_id, stored.takes), restored)
        # Nobody finds it before the scorer was told of it.
        self.roster.add(running)
        try:
            await running.begun
        except ScorerLost:
            await self._bereave(running)
        return running

    # While it runs, here or elsewhere.

    async def attach(self, inspection_id: str) -> Running:
        """The inspection, to hear what is said of it; also one that has just ended here. Raises as `open` does."""
        return self.find(inspection_id) or await self._here(inspection_id)

    async def open(self, inspection_id: str) -> Running:
        """The inspection, to feed it; taken over where another process has it, on a store that both share.

        Raises NoSuchInspection, AlreadyConcluded, NotOpen, Moved, Stopping, ScorerLost.
        """
        running = await self._here(inspection_id)
        if running.phase == "moved":
            raise Moved(inspection_id)
        if running.phase != "open":
            raise NotOpen(inspection_id)
        return running

    async def _here(self, inspection_id: str) -> Running:
        """The inspection; taken over where it is in processing elsewhere."""
        if (running := self.roster.running(inspection_id)) is not None:
            return running
        if not self._store.shared:
            stored = await asyncio.to_thread(self._store.inspection, inspection_id)
            raise AlreadyConcluded(inspection_id, stored.state)
        if self.station.stopping:
            raise Stopping
        if inspection_id not in self._taken:
            self._taken[inspection_id] = self._background.keep(self._take(inspection_id))
            self._taken[inspection_id].add_done_callback(lambda _: self._taken.pop(inspection_id))
        return await asyncio.shield(self._taken[inspection_id])

    async def _take(self, inspection_id: str) -> Running:
        stored, appearance, restored = await self._moving.claim(inspection_id)
        running = await self._run(stored, appearance, restored)
        _log.info("inspection", **running.facts, state="taken over", next_sequence=restored.kept.next)
        return running

    def give_soon(self, inspection_id: str) -> None:
        """Another process asks for it, and may have it."""
        if (running := self.roster.running(inspection_id)) is not None:
            self._background.keep(self._moving.give(running))

    # To the verdict.

    async def conclude(self, inspection_id: str, *, stopped: bool = False, last_sequence: int | None = None) -> bytes:
        """The result, as JSON with frames, after it was stored. Raises NoSuchInspection, AlreadyConcluded, ScorerLost.

        Where the store fails, the result is kept, and a further call tries to store it once more. `last_sequence` is
        the number of the last frame that was sent: ResumeFrom where that was lost with another process.
        """
        running = await self._here(inspection_id)
        if last_sequence is not None and running.row.takes and running.next_sequence <= last_sequence:
            raise ResumeFrom(inspection_id, running.next_sequence, last_sequence)
        return (await self._end(running, stopped=stopped)).full

    async def abort(self, inspection_id: str, reason: str) -> bytes:
        """The same, without a verdict on the part: it is never OK."""
        return (await self._end(await self._here(inspection_id), reason=reason)).full

    async def _end(self, running: Running, *, stopped: bool = False, reason: str | None = None) -> Ended:
        """Conclude or abort, store, tell. Goes on when the one who asked is gone."""
        if running.phase == "moved":
            raise Moved(running.inspection_id)
        if running.phase in ("ending", "ended"):
            raise AlreadyConcluded(running.inspection_id, running.phase)
        if running.phase == "open" and running.lost_because is not None:
            await self._bereave(running)
        if running.phase == "open":
            running.end(stopped=stopped, reason=reason)
        running.phase = "ending"
        return await asyncio.shield(self._background.finish(self._finish(running)))

    async def _finish(self, running: Running) -> Ended:
        try:
            ended = running.made = running.made or await self._naming.named(running, await running.ended)
        except Moved:
            await self._moving.drop(running, running.lost_because or "")
            raise
        except WorldError as error:
            await self._lose(running, str(error))
            raise
        inspection_id, kept = running.inspection_id, running.ledger.kept
        try:
            stored = await asyncio.to_thread(self._endings.conclude, inspection_id, ended, kept, running.reason)
        except NotOwner as error:
            await self._moving.drop(running, str(error))
            raise Moved(inspection_id) from error
        except StoreError:
            running.phase = "unsaved"
            raise
        self._retire(running, stored, ended.full)
        if kept.starts:
            self._background.finish(asyncio.to_thread(self._endings.join, stored, kept, ended.recording["note"]))
        return ended

    def _retire(self, running: Running, stored: StoredInspection, full: bytes | None = None) -> None:
        """It runs no more: all who listen are told, and it is remembered for a while."""
        running.tell_briefs()
        running.leave("verdict" if stored.state == "completed" else "aborted", full, stored.reason)
        self.roster.retire(running)
        self.station.ended(stored)

    # Without one.

    async def _bereave(self, running: Running) -> None:
        """Its scorer is gone: it goes on from what was saved, or failed. Raises Moved, ScorerLost."""
        why = running.lost_because or ""
        if self._store.shared and not running.impossible:
            await self._moving.drop(running, why)
            raise Moved(running.inspection_id)
        await self._lose(running, why)
        raise ScorerLost(running.inspection_id, why)

    async def _lose(self, running: Running, why: str) -> None:
        """The scorer is gone: what is on the disk stays, a verdict there is none."""
        running.phase = "ending"
        try:
            stored = await asyncio.to_thread(self._endings.lose, running.inspection_id, why)
        except StoreError as error:
            # The next start of the service will find it in processing, and abort it.
            _log.error("inspection lost and not stored", **running.facts, why=why, error=str(error))
            stored = replace(running.row, state="failed", reason=why)
        self._retire(running, stored)

    async def _idle_loop(self) -> None:
        """What nobody feeds is aborted, what could not be stored is tried again, what has no scorer is seen to."""
        while True:
            await asyncio.sleep(_IDLE_LOOK_SECONDS)
            now = time.monotonic()
            for running in self.roster:
                idle = running.lost_because is not None or (
                    not running.waiting and now - running.touched > self._idle_seconds
                )
                if running.phase == "unsaved" or (running.phase == "open" and idle):
                    with suppress(WorldError):
                        await self._end(running, reason=f"no frame came for {self._idle_seconds:g} s")

    async def _abandon_loop(self) -> None:
        """On a store that others share: what died with a process, and was taken over by nobody, is aborted and told."""
        while True:
            await asyncio.sleep(_ABANDON_SECONDS)
            try:
                ended = await asyncio.to_thread(self._endings.abandon, self._idle_seconds)
            except WorldError as error:
                _log.warning("abandoned inspections", error=str(error))
                continue
            for stored in ended:
                self.station.ended(stored)
