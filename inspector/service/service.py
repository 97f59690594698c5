"""Service: everything that one `inspector serve` holds, opened in order, closed in the other."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import structlog

from inspector import stores
from inspector.service.access import Access
from inspector.service.folder import DataFolder
from inspector.service.metrics import Metrics
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

    def __init__(self, settings: Settings, now_ns: Callable[[], int] = time.time_ns) -> None:
        self.settings, self.now_ns = settings, now_ns
        self.metrics = Metrics()
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
        self.started = True

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
        return await asyncio.to_thread(self._troubles)

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
        await asyncio.to_thread(self._close)

    def _close(self) -> None:
        self.store.close()
        self.folder.close()
