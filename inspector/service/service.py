"""Service: everything that one `inspector serve` holds, opened in order, closed in the other."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import structlog

from inspector import stores
from inspector.service.access import Access
from inspector.service.events import Events
from inspector.service.folder import DataFolder
from inspector.service.inspections import Inspections
from inspector.service.metrics import Metrics
from inspector.service.running import Bounds
from inspector.settings import Settings
from inspector.stores import AbstractStore
from models.errors import InspectionError

log = structlog.get_logger(__name__)
DAY_NS = 86_400_000_000_000
KILLED = "the service ended without being stopped"


class Service:
    """What the routes ask. Nothing but `settings` and `metrics` is there before `start`."""

    folder: DataFolder
    store: AbstractStore
    access: Access
    inspections: Inspections

    def __init__(self, settings: Settings, now_ns: Callable[[], int] = time.time_ns) -> None:
        self.settings, self.now_ns = settings, now_ns
        self.metrics = Metrics()
        self.events = Events(settings.max_subscribers)
        self.started = False
        self.stopping = asyncio.Event()
        """Set when the service begins to stop: whoever holds a connection open lets go."""

    async def start(self) -> None:
        """Open everything; a second call does nothing. Raises FolderInUse, FolderRefused, StoreError."""
        if self.started:
            return
        self.folder = await asyncio.to_thread(DataFolder, self.settings.data)
        try:
            await asyncio.to_thread(self._open)
        except BaseException:
            self.folder.close()
            raise
        self.events.start()
        self.inspections = self._inspections()
        await self.inspections.start()
        self.started = True

    def _inspections(self) -> Inspections:
        settings = self.settings
        return Inspections(
            self.store,
            self.folder,
            self.events,
            self.metrics,
            scorers=settings.scorers,
            max_inspections=settings.max_inspections,
            max_pixels=settings.max_pixels,
            bounds=Bounds(settings.window, frames=settings.max_frames),
            idle_seconds=settings.idle_seconds,
        )

    def _open(self) -> None:
        store: AbstractStore = stores.open_store(self.settings.database_url)  # pyright: ignore
        self.store = store
        now = self.now_ns()
        self.store.release_pending_claims()
        self.store.forget_claims(now - DAY_NS)
        for job_id in self.store.fail_running_jobs(now, KILLED):
            log.warning("job failed", job_id=job_id, why=KILLED)
        self.access = Access(self.store, self.settings.asks_for_tokens, self.now_ns)

    async def troubles(self) -> list[str]:
        """A sentence for each thing that keeps the service from its work."""
        if not self.started:
            return ["the service does not run"]
        dead = [scorer for scorer in self.inspections.pool.scorers if not scorer.alive]
        lame = [f"{len(dead)} of {self.settings.scorers} processes that score are being started again"] if dead else []
        return [*await asyncio.to_thread(self._troubles), *lame]

    def _troubles(self) -> list[str]:
        said: list[str] = []
        for check in (self.store.ping, self.folder.check_writable):
            try:
                check()
            except InspectionError as error:
                said.append(self.folder.hidden(str(error)))
        return said

    async def stop(self, why: str) -> None:
        """End what runs, and close everything; a second call does nothing."""
        if not self.started:
            return
        self.started = False
        self.stopping.set()
        log.info("stopping", why=why)
        await self.inspections.stop()
        self.events.close()
        await asyncio.to_thread(self._close)

    def _close(self) -> None:
        self.store.close()
        self.folder.close()
