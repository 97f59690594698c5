"""The life of inspections: begun, fed, concluded or aborted, stored; none is forgotten, none is stored twice."""

from __future__ import annotations

import asyncio
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from typing import Any, TypeVar

import structlog

from inspector.errors import StoreError, WorldError
from inspector.scorers.pool import Pool, Scorer
from inspector.scorers.wire import Head
from inspector.service.endings import Endings
from inspector.service.errors import AtCapacity, Moved, NoRecipe, NotOpen, ResumeFrom, ScorerLost, Stopping
from inspector.service.events import Events
from inspector.service.files import Files
from inspector.service.folder import new_id
from inspector.service.load import Ration, Turns, no_time
from inspector.service.metrics import Metrics
from inspector.service.moving import HandOver, Moving, restored
from inspector.service.naming import Naming
from inspector.service.publishing import Publishing
from inspector.service.recognising import Recognising
from inspector.service.running import Around, Bounds, Ended, Running
from inspector.stores.base import AbstractStore, AlreadyConcluded, IdTaken, NoSuchInspection, NotOwner
from inspector.stores.records import Recipe, StoredInspection
from models.verdict import Policy

T = TypeVar("T")
_BRIEF_SECONDS = 0.25
_ABANDON_SECONDS = 2.0
_STILL_SECONDS = 3.0
_TICK_SECONDS = 1.0
_FINISH_SECONDS = 5.0
"""How long what is being concluded may take when the service is stopped."""
_FACTS = "inspection_id", "product_id", "part_id", "recipe_id", "appearance_id"
_REMEMBERED = 64
"""Inspections whose messages are kept after their end, for connections that break just then."""


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
        self.stopping = False
        self.beside: Callable[[], Iterable[tuple[Scorer, float]]] = tuple
        """What else needs a share of the scorers' time."""
        self._store, self._files, self._events, self._metrics = store, files, events, metrics
        self._naming = Naming(recognising, files, self._keep)
        self._max, self._idle_seconds = max_inspections, idle_seconds
        self._around = Around(bounds, events, metrics, lambda: self.pool.waiting_bytes, store.shared)
        self._node_id = node_id
        self._moving = Moving(store, files, node_id, hand_over)
        self._endings = Endings(store, files, publishing, node_id)
        self._taken: dict[str, asyncio.Task[Running]] = {}
        """Inspections that are being taken over."""
        self._running: dict[str, Running] = {}
        self._ended: OrderedDict[str, Running] = OrderedDict()
        self._beginning = 0
        self._turns = Turns()
        self._tasks: set[asyncio.Task[Any]] = set()
        self._finishing: set[asyncio.Task[Any]] = set()
        self._log = structlog.get_logger("inspector")

    async def start(self) -> None:
        """Inspections that a crash left in processing are aborted; then the scorers begin, with what is active."""
        if not self._store.shared:
            await in_thread(self._endings.recover)
        await self.pool.start()
        for appearance_id in await in_thread(self._active):
            self.load(appearance_id)
        self._keep(self._tick())
        self._keep(self._tell())
        if self._store.shared:
            self._keep(self._abandon())
        self._keep(self._metrics.watch_loop(time.perf_counter))

    async def stop(self) -> None:
        """What waits is scored; what runs is aborted and says so, or, on a store that others share, saved for them.

        Files are closed. A second call does nothing.
        """
        if self.stopping:
            return
        self.stopping = True
        self._events.publish("station", **self.station)
        if self._store.shared:
            await asyncio.gather(*map(self.give, self._running))
        for running in [*self._running.values()]:
            with suppress(WorldError):
                await self._end(running, reason="the service was stopped")
        # What is being concluded just now, and then recordings in parts.
        until = time.monotonic() + _FINISH_SECONDS
        while self._finishing and time.monotonic() < until:
            await asyncio.wait(self._finishing, timeout=until - time.monotonic())
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.pool.stop()

    def load(self, appearance_id: str) -> None:
        """Have it ready in every scorer: it will be needed. And where there are several, to tell them apart."""
        self._keep(self._prepare(appearance_id))

    @property
    def state(self) -> str:
        """Of the station: `ready`, `inspecting`, `at capacity`, `stopping`."""
        if self.stopping:
            return "stopping"
        if self._no_capacity() is not None:
            return "at capacity"
        return "inspecting" if self._running else "ready"

    @property
    def station(self) -> dict[str, object]:
        """What the event `station` tells."""
        return {"state": self.state, "running": len(self._running)}

    @property
    def running(self) -> tuple[Running, ...]:
        """Those in processing."""
        return tuple(self._running.values())

    async def make_way(self) -> None:
        """For a request that only reads: frames go first."""
        if self._running:
            await self._turns.wait()

    def find(self, inspection_id: str) -> Running | None:
        """The inspection, if it runs, or ended a short while ago."""
        return self._running.get(inspection_id) or self._ended.get(inspection_id)

    def observe(self) -> None:
        """Bring the gauges up to date."""
        self._metrics.running.set(len(self._running))
        self._metrics.listeners.set(self._events.listeners)
        self._metrics.restarts.set(sum(scorer.restarts for scorer in self.pool.scorers))
        for scorer in self.pool.scorers:
            self._metrics.waiting.labels(str(scorer.number)).set(scorer.waiting)

    async def begin(
        self, product_id: str, part_id: str, recipe_id: str | None = None, inspection_id: str | None = None
    ) -> StoredInspection:
        """A new inspection, ready for frames; the one that has that id already, where it is of the same part and runs.

        Raises Stopping, AtCapacity, NoRecipe, NoSuchProduct, NoSuchRecipe, IdTaken, ScorerLost.
        """
        if self.stopping:
            raise Stopping
        if inspection_id is not None and (begun := await self._begun(inspection_id)) is not None:
            if (begun.product_id, begun.part_id) != (product_id, part_id):
                raise IdTaken("inspection", inspection_id)
            await self.open(inspection_id)
            return begun
        if (why := self._no_capacity()) is not None:
            self._metrics.refused.inc()
            raise AtCapacity(why)
        self._beginning += 1
        try:
            return await self._begin(product_id, part_id, recipe_id, inspection_id or new_id())
        finally:
            self._beginning -= 1

    async def conclude(self, inspection_id: str, *, stopped: bool = False, last_sequence: int | None = None) -> bytes:
        """The result, as JSON with frames, after it was stored. Raises NoSuchInspection, AlreadyConcluded, ScorerLost.

        Where the store fails, the result is kept, and a further call tries to store it once more. `last_sequence` is
        the number of the last frame that was sent: ResumeFrom where that was lost with another process.
        """
        running = await self._open(inspection_id)
        if last_sequence is not None and running.ledger.kept.starts and running.next_sequence <= last_sequence:
            raise ResumeFrom(inspection_id, running.next_sequence, last_sequence)
        return (await self._end(running, stopped=stopped)).full

    async def abort(self, inspection_id: str, reason: str) -> bytes:
        """The same, without a verdict on the part: it is never OK."""
        return (await self._end(await self._open(inspection_id), reason=reason)).full

    async def attach(self, inspection_id: str) -> Running:
        """The inspection, to hear what is said of it; also one that has just ended here. Raises as `open` does."""
        return self.find(inspection_id) or await self._open(inspection_id)

    async def open(self, inspection_id: str) -> Running:
        """The inspection, to feed it; taken over where another process has it, on a store that both share.

        Raises NoSuchInspection, AlreadyConcluded, NotOpen, Moved, Stopping, AppearanceError, CheckpointError.
        """
        running = await self._open(inspection_id)
        if running.phase == "moved":
            raise Moved(inspection_id)
        if running.phase != "open":
            raise NotOpen(inspection_id)
        return running

    def give_soon(self, inspection_id: str) -> None:
        """The same as `give`, and nobody waits for it."""
        self._keep(self.give(inspection_id))

    async def give(self, inspection_id: str) -> None:
        """Another process may have it from now on; what cannot be saved any more is taken from the last time it was."""
        running = self._running.get(inspection_id)
        if running is None:
            return
        try:
            await self._moving.give(running)
        except WorldError as error:
            self._log.warning("inspection not handed over", **running.facts, error=str(error))
        if running.phase == "moved":
            self._forget(running)

    async def _open(self, inspection_id: str) -> Running:
        """The inspection; taken over where it is in processing elsewhere."""
        running = self._running.get(inspection_id)
        if running is not None:
            return running
        if not self._store.shared:
            stored = await in_thread(self._store.inspection, inspection_id)
            raise AlreadyConcluded(inspection_id, stored.state)
        if self.stopping:
            raise Stopping
        if inspection_id not in self._taken:
            self._taken[inspection_id] = self._keep(self._take(inspection_id))
            self._taken[inspection_id].add_done_callback(lambda _: self._taken.pop(inspection_id))
        return await asyncio.shield(self._taken[inspection_id])

    async def _take(self, inspection_id: str) -> Running:
        stored, checkpoint = await self._moving.claim(inspection_id)
        kept, lines, resume, body = restored(stored, checkpoint)
        running = self._opened(stored)
        running.restore(kept, lines)
        running.ledger.chunks = len(checkpoint.added) if checkpoint else 0
        await self._ready(running, stored, resume, body)
        self._log.info("inspection", **running.facts, state="taken over", next_sequence=kept.next)
        return running

    async def _begun(self, inspection_id: str) -> StoredInspection | None:
        with suppress(NoSuchInspection):
            return await in_thread(self._store.inspection, inspection_id)
        return None

    async def _begin(
        self, product_id: str, part_id: str, recipe_id: str | None, inspection_id: str
    ) -> StoredInspection:
        recipe = await in_thread(self._recipe, product_id, recipe_id)
        await in_thread(self._files.local_appearance, recipe.appearance_id)
        policy = Policy(**recipe.policy)
        if self.pool.least() is None:
            raise AtCapacity("the processes that score are being started")
        begin = partial(
            self._store.begin_inspection, part_id=part_id, recipe_id=recipe.recipe_id, policy=asdict(policy)
        )
        stored = await in_thread(
            begin,
            inspection_id,
            product_id,
            appearance_id=recipe.appearance_id,
            begun_ns=time.time_ns(),
            node=self._node_id,
        )
        running = self._opened(stored)
        await self._ready(running, stored)
        self._events.publish("begun", **running.facts)
        return stored

    def _opened(self, stored: StoredInspection) -> Running:
        facts = {name: getattr(stored, name) for name in _FACTS}
        # Chosen now, and pinned before anybody else has a turn.
        scorer = self.pool.least() or self.pool.scorers[0]
        running = Running(facts, scorer, self._around)
        running.doubted = partial(self._naming.ask, running)
        return running

    async def _ready(
        self, running: Running, stored: StoredInspection, resume: Head | None = None, body: bytes = b""
    ) -> None:
        """The scorer is ready for its frames. Raises AppearanceError, CheckpointError, ScorerLost, Moved."""
        path = await in_thread(self._files.local_appearance, stored.appearance_id)
        names = {name: value for name, value in running.facts.items() if name != "appearance_id"}
        head: Head = {
            "do": "begin",
            "id": running.inspection_id,
            "appearance_id": stored.appearance_id,
            "path": str(path),
            "policy": stored.policy,
            "names": names | {"result_id": new_id()},
            "record_to": str(self._files.tape(running.inspection_id, stored.takes)),
        }
        # Nobody finds it before the scorer was told of it.
        self._running[running.inspection_id] = running
        running.begin(head | (resume or {}), body)
        try:
            await running.begun
        except ScorerLost:
            await self._bereave(running)

    def _recipe(self, product_id: str, recipe_id: str | None) -> Recipe:
        if recipe_id is not None:
            return self._store.recipe(recipe_id)
        recipe = self._store.active_recipe(product_id)
        if recipe is None:
            raise NoRecipe(product_id)
        return recipe

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
        return await asyncio.shield(self._wait_for(self._finish(running, reason)))

    def _wait_for(self, work: Any) -> asyncio.Task[Any]:
        """A task that the end of the service waits for."""
        task = self._keep(work)
        self._finishing.add(task)
        task.add_done_callback(self._finishing.discard)
        return task

    async def _finish(self, running: Running, reason: str | None) -> Ended:
        try:
            ended = running.stored = running.stored or await self._naming.named(running, await running.ended)
        except Moved:
            await self._drop(running, running.lost_because or "")
            raise
        except WorldError as error:
            await self._lose(running, str(error))
            raise
        try:
            kept = running.ledger.kept
            stored = await in_thread(self._endings.conclude, running.inspection_id, ended, kept, reason)
        except NotOwner as error:
            await self._drop(running, str(error))
            raise Moved(running.inspection_id) from error
        except StoreError:
            running.phase = "unsaved"
            raise
        self._retire(running, ended.full, stored)
        if kept.starts:
            self._wait_for(in_thread(self._endings.join, stored, kept, ended.recording["note"]))
        return ended

    async def _prepare(self, appearance_id: str) -> None:
        with suppress(WorldError):
            path = await in_thread(self._files.local_appearance, appearance_id)
            self.pool.load(appearance_id, str(path))
            await self._naming.prepare()

    async def _bereave(self, running: Running) -> None:
        """Its scorer is gone: it goes on from what was saved, or failed. Raises Moved, ScorerLost."""
        why = running.lost_because or ""
        if self._store.shared and not running.impossible:
            await self._drop(running, why)
            raise Moved(running.inspection_id)
        await self._lose(running, why)
        raise ScorerLost(running.inspection_id, why)

    async def _saved(self, running: Running) -> None:
        """What cannot be stored now is with the next time."""
        try:
            await self._moving.save(running)
        except NotOwner as error:
            await self._drop(running, str(error))
        except Moved:
            await self._drop(running, running.lost_because or "")
        except WorldError as error:
            self._log.warning("inspection not saved", **running.facts, error=str(error))

    async def _drop(self, running: Running, why: str) -> None:
        """It is another process's, or its scorer is gone: whoever is sent the next frame goes on from the last save."""
        if running.phase == "moved":
            return
        was, running.phase = running.phase, "moved"
        if was == "open" and running.lost_because is None:
            with suppress(WorldError):
                await running.release()
        with suppress(StoreError):
            await in_thread(self._store.release_inspection, running.inspection_id, self._node_id, time.time_ns())
        running.move()
        self._forget(running)
        self._log.warning("inspection dropped", **running.facts, why=why)

    def _forget(self, running: Running) -> None:
        if self._running.get(running.inspection_id) is running:
            del self._running[running.inspection_id]

    async def _lose(self, running: Running, why: str) -> None:
        """The scorer is gone: what is on the disk stays, a verdict there is none."""
        running.phase = "ending"
        try:
            stored = await in_thread(self._endings.lose, running.inspection_id, why)
        except StoreError as error:
            # The next start of the service will find it in processing, and abort it.
            self._log.error("inspection lost and not stored", **running.facts, why=why, error=str(error))
            stored = None
        self._retire(running, None, stored, why)

    def _retire(self, running: Running, full: bytes | None, stored: StoredInspection | None, why: str = "") -> None:
        """It runs no more: all who listen are told, and it is remembered for a while."""
        state = stored.state if stored else "failed"
        reason = stored.reason if stored else why
        kind = "verdict" if state == "completed" else "aborted"
        running.tell_briefs()
        running.leave(kind, full, reason)
        self._running.pop(running.inspection_id, None)
        self._ended[running.inspection_id] = running
        while len(self._ended) > _REMEMBERED:
            self._ended.popitem(last=False)
        result = (stored.result if stored else None) or {}
        verdict = stored.verdict if stored else None
        facts = {name: result.get(name) for name in ("coverage", "frames_scored", "frames_dropped", "digest")}
        names = running.facts | {"state": state, "verdict": verdict, "reason": reason}
        self._metrics.ended.labels(running.product_id, state).inc()
        if verdict is not None and state == "completed":
            self._metrics.verdicts.labels(running.product_id, verdict).inc()
        self._events.publish(kind, **names, **facts, deviations=result.get("deviations", []))
        seconds = round(time.monotonic() - running.since, 3)
        self._log.info("inspection", **names, **facts, seconds=seconds)

    def _no_capacity(self) -> str | None:
        count = len(self._running) + self._beginning
        if count >= self._max:
            return f"{count} are running, {self._max} are allowed"
        shares = [(running.scorer, running.load.share) for running in self._running.values()]
        return no_time(count, shares, self.beside(), self.pool.scorers)

    async def _tick(self) -> None:
        """Once a second: what is idle is aborted, what could not be stored is tried again."""
        while True:
            await asyncio.sleep(_TICK_SECONDS)
            now = time.monotonic()
            await self._ask_whose(now)
            for running in [*self._running.values()]:
                idle = running.phase == "open" and not running.waiting and now - running.touched > self._idle_seconds
                if running.phase == "open" and running.lost_because is not None:
                    with suppress(WorldError):
                        await self._bereave(running)
                elif idle or running.phase == "unsaved":
                    with suppress(WorldError):
                        await self._end(running, reason=f"no frame came for {self._idle_seconds:g} s")

    async def _ask_whose(self, now: float) -> None:
        """Whether what stands still is this process's yet: it may have been taken while nobody could say so."""
        for running in [*self._running.values()] if self._store.shared else ():
            if running.phase == "open" and now - max(running.touched, running.asked_at) > _STILL_SECONDS:
                running.asked_at = now
                with suppress(WorldError):
                    stored = await in_thread(self._store.inspection, running.inspection_id)
                    if stored.state != "processing" or stored.node != self._node_id:
                        await self._drop(running, "another process has taken it over")

    async def _abandon(self) -> None:
        """On a store that others share: what died with a process, and was taken over by nobody, is aborted and told."""
        while True:
            await asyncio.sleep(_ABANDON_SECONDS)
            try:
                ended = await in_thread(self._endings.abandon, self._idle_seconds)
            except WorldError as error:
                self._log.warning("abandoned inspections", error=str(error))
                continue
            for stored in ended:
                facts = {name: getattr(stored, name) for name in (*_FACTS, "state", "verdict", "reason")}
                self._metrics.ended.labels(stored.product_id, stored.state).inc()
                self._events.publish("aborted", **facts, deviations=[])
                self._log.warning("inspection", **facts)

    async def _tell(self) -> None:
        """A few times a second: the latest scores and pictures, and how the station is when that changes."""
        station: dict[str, object] = {}
        ration = Ration()
        while True:
            await asyncio.sleep(_BRIEF_SECONDS)
            ration.refill(_BRIEF_SECONDS)
            # Whose picture was not told for longest comes first.
            for running in sorted(self._running.values(), key=lambda each: each.shown_at):
                running.tell_briefs()
                running.tell_picture(ration)
                if self._moving.due(running):
                    self._keep(self._saved(running))
            if station != (station := self.station):
                self._events.publish("station", **station)

    def _active(self) -> list[str]:
        products = self._store.products(limit=200).items
        recipes = [self._store.active_recipe(product.product_id) for product in products]
        return [recipe.appearance_id for recipe in recipes if recipe is not None][:8]

    def _keep(self, work: Any) -> asyncio.Task[Any]:
        """A task that is not lost while it runs."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task


async def in_thread(function: Callable[..., T], *arguments: Any, **named: Any) -> T:
    """What blocks, away from the event loop."""
    return await asyncio.to_thread(function, *arguments, **named)
