"""Service: everything that one `inspector serve` holds, opened in order, closed in the other."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import structlog

from inspector.service.access import Access
from inspector.service.batches import Batches
from inspector.service.desk import Desk
from inspector.service.events import Events
from inspector.service.files import Files
from inspector.service.folder import DataFolder
from inspector.service.inspections import Inspections
from inspector.service.jobs import Jobs
from inspector.service.learning import Learning
from inspector.service.locating import Locating
from inspector.service.mending import Mending
from inspector.service.metrics import Metrics
from inspector.service.peers import Peers
from inspector.service.pictures import Pictures
from inspector.service.publishing import Publishing
from inspector.service.recognising import Recognising
from inspector.service.replays import Replays
from inspector.service.retention import DAY_NS, Retention, remove_scores, tidy
from inspector.service.running import Bounds
from inspector.service.sweeps import Sweeps
from inspector.service.trends import Trends
from inspector.service.workspaces import Workspaces
from inspector.settings import CORES, Settings
from inspector.stores import AbstractStore, open_store
from inspector.stores.records import Json
from models.errors import InspectionError

log = structlog.get_logger("inspector")
HAND_OVER = "hand over"
"""Asked of the service that has an inspection, by the one that it goes on at."""
KILLED = "the service ended while this was being done"
_HOUSEKEEPING_SECONDS = 300.0


class Service:
    """What the routes ask. Nothing but `settings`, `metrics` and `events` is there before `start`."""

    folder: DataFolder
    files: Files
    publishing: Publishing
    mending: Mending
    store: AbstractStore
    peers: Peers
    access: Access
    jobs: Jobs
    sweeps: Sweeps
    learning: Learning
    replays: Replays
    batches: Batches
    pictures: Pictures
    trends: Trends
    workspaces: Workspaces
    locating: Locating
    inspections: Inspections

    def __init__(self, settings: Settings, now_ns: Callable[[], int] = time.time_ns) -> None:
        self.settings, self.now_ns = settings, now_ns
        self.metrics = Metrics()
        self.events = Events(settings.max_subscribers)
        self.started = False
        self._desks: tuple[Desk, ...] = ()
        self._stopping = asyncio.Event()
        self._housekeeper: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Open everything; a second call does nothing. Raises FolderInUse, FolderRefused, ObjectError, StoreError."""
        if self.started:
            return
        self.folder = await asyncio.to_thread(DataFolder, self.settings.data)
        try:
            self.files = await asyncio.to_thread(self._open_files)
            self.store = await asyncio.to_thread(open_store, self.settings.database_url)
            try:
                self.peers = Peers(self.store, self.events, now_ns=self.now_ns, facts=self._facts)
                await self._furnish()
            except BaseException:
                await self.peers.stop()
                await asyncio.to_thread(self.store.close)
                raise
        except BaseException:
            self.folder.close()
            raise
        self.started = True

    async def _furnish(self) -> None:
        await asyncio.to_thread(self._recover)
        self.events.start()
        await self.peers.start()
        if len(self.peers.nodes) > 1 and not self.files.common:
            log.warning("files", error="other services do not have what is kept in this data folder; set `files`")
        self.access = Access(self.store, self.settings.asks_for_tokens, self.now_ns)
        self._furnish_line(self._furnish_office())
        await asyncio.to_thread(self.publishing.start)
        await self.inspections.start()
        await self.locating.start()
        self._housekeeper = asyncio.create_task(self._keep_house())

    def _furnish_office(self) -> Recognising:
        """What people ask for, each at a desk; and what the line asks of one."""
        store, files, settings, now_ns = self.store, self.files, self.settings, self.now_ns
        learners = max(1, CORES // 2)
        # Apart: what somebody waits for does not wait for what takes minutes.
        learning, recording, looking, showing, naming, many = self._desks = (
            Desk(learners), Desk(4), Desk(2), Desk(1), Desk(1), Desk(1)
        )  # fmt: skip
        recognising = Recognising(store, files, naming)
        self.jobs = Jobs(
            store, files, self.events, self.metrics, learners=learners, node_id=self.peers.node_id, now_ns=now_ns
        )
        self.sweeps = Sweeps(
            store,
            files,
            looking=looking,
            recording=recording,
            cameras=settings.cameras,
            max_frames=settings.max_frames,
            max_pixels=settings.max_pixels,
            now_ns=now_ns,
        )
        self.learning = Learning(store, files, learning, now_ns, executor=settings.executor)
        self.replays = Replays(store, files, looking, recognising, now_ns)
        self.batches = Batches(
            store, files, self.replays, recognising, desk=many, executor=settings.executor, now_ns=now_ns
        )
        self.pictures = Pictures(store, files, showing)
        self.trends = Trends(store, looking)
        self.workspaces = Workspaces(
            store,
            files,
            looking=looking,
            learning=learning,
            max_bytes=settings.max_recording,
            max_pixels=settings.max_pixels,
            now_ns=now_ns,
        )
        return recognising

    def _furnish_line(self, recognising: Recognising) -> None:
        """What parts are inspected and located with, and what brings their recordings away."""
        store, files, settings = self.store, self.files, self.settings
        self.publishing = Publishing(store, files, self.metrics)
        self.mending = Mending(store, files, self.publishing)
        self.inspections = Inspections(
            store,
            files,
            self.events,
            self.metrics,
            recognising,
            publishing=self.publishing,
            scorers=settings.scorers,
            max_inspections=settings.max_inspections,
            max_pixels=settings.max_pixels,
            bounds=Bounds(window=settings.window, frames=settings.max_frames),
            idle_seconds=settings.idle_seconds,
            node_id=self.peers.node_id,
            hand_over=partial(self.peers.ask, kind=HAND_OVER),
        )
        self.peers.on(HAND_OVER, lambda asked: self.inspections.give_soon(asked["inspection_id"]))
        self.locating = Locating(store, files, self.inspections.pool, most=settings.max_inspections)
        self.inspections.station.beside = self.locating.loads

    def _open_files(self) -> Files:
        """In a thread: what cannot be had now is told before anything is inspected."""
        files = Files(self.folder, self.settings.files)
        files.check()
        return files

    def _recover(self) -> None:
        """In a thread: what a crash left behind. On a store that is shared, the others find out, or this one does."""
        if self.store.shared:
            return
        self.store.release_pending_claims()
        for job_id in self.store.fail_running_jobs(self.now_ns(), KILLED):
            log.warning("job", job_id=job_id, state="failed", error=KILLED)

    async def _keep_house(self) -> None:
        """Now and then until the service stops: what need not stay is removed."""
        while not self._stopping.is_set():
            try:
                await asyncio.to_thread(self._tidy_alone)
            except (InspectionError, OSError) as error:
                log.warning("housekeeping", error=str(error))
            with suppress(TimeoutError):
                await asyncio.wait_for(self._stopping.wait(), _HOUSEKEEPING_SECONDS)

    def _tidy_alone(self) -> None:
        self.mending.mend(self.now_ns(), self.settings.keep_days)
        with self.store.only_one("housekeeping") as mine:
            if mine:
                self._tidy()

    def _tidy(self) -> None:
        settings, now = self.settings, self.now_ns()
        self.store.forget_claims(now - DAY_NS)
        rules = Retention(
            settings.keep_ok_one_in, settings.keep_days, settings.keep_disk_share, settings.keep_bytes
        )  # fmt: skip
        done = tidy(self.store, self.files, rules, now, enough=self._stopping.is_set)
        for failure in done.failures:
            log.error("recording", state="kept", error=failure)
        if done.removed:
            log.info("recordings", state="removed", count=done.removed, bytes=done.bytes)
        if gone := remove_scores(self.store, settings.keep_scores_days, now, enough=self._stopping.is_set):
            log.info("scores", state="removed", inspections=gone)

    async def troubles(self) -> list[str]:
        """A sentence for each thing that keeps the service from its work."""
        if not self.started:
            return ["the service does not run"]
        dead = [scorer for scorer in self.inspections.pool.scorers if not scorer.alive]
        lame = [f"{len(dead)} of {self.settings.scorers} processes that score are being started again"] if dead else []
        return [*await asyncio.to_thread(self._troubles), *self.peers.troubles(), *lame]

    def hidden(self, said: str) -> str:
        """A sentence without the places of folders, for strangers."""
        return self.files.hidden(said) if hasattr(self, "files") else said

    def _facts(self) -> Json:
        """What other services are told of this one."""
        return self.inspections.station.facts if self.started else {}

    def _troubles(self) -> list[str]:
        said: list[str] = []
        for check in (self.store.ping, self.folder.check_writable):
            try:
                check()
            except InspectionError as error:
                said.append(self.files.hidden(str(error)))
        return said

    async def stop(self, why: str) -> None:
        """End what runs, and close everything; a second call does nothing."""
        if not self.started:
            return
        self.started = False
        log.info("stopping", why=why)
        self._stopping.set()
        self.locating.stop()
        await self.inspections.stop()
        if self._housekeeper is not None:
            await self._housekeeper
        self.events.close()
        await asyncio.to_thread(self._end_work)
        await self.peers.stop()
        await asyncio.to_thread(self.store.close)
        self.folder.close()

    def _end_work(self) -> None:
        for desk in self._desks:
            desk.close()
        self.jobs.close()
        self.publishing.close()
