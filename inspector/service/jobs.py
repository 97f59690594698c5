"""Jobs: long work that somebody asked for and comes back to; its state is in the store, and survives.

inspector.errors.WorldError
└── TooMuchToDo              more long work than may wait
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar

import structlog

from inspector.errors import StoreError, WorldError
from inspector.service.errors import Stopping
from inspector.service.events import Events
from inspector.service.files import Files
from inspector.service.folder import new_id
from inspector.service.metrics import Metrics
from inspector.stores.base import AbstractStore
from inspector.stores.errors import JobEnded
from inspector.stores.records import Job, JobKind, JobState, Json
from models.errors import InspectionError

T = TypeVar("T")
Progress = Callable[[float], object]
Work = Callable[[Progress], Json]
_WAITING = 32
"""Pieces of work that may wait, of those that are done at once and of each kind of job."""
_SAID = 20
"""Sentences that an event holds."""
_log = structlog.get_logger("inspector")


class TooMuchToDo(WorldError):
    """More long work than may wait."""

    retry_after = 10

    def __init__(self, waiting: int) -> None:
        super().__init__(f"{waiting} pieces of long work wait already, and no more may; try again later")


class _Queue:
    """Threads that wait for the desk, and no more work than may wait for them."""

    def __init__(self, threads: int, name: str) -> None:
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix=name)
        self._waiting = 0

    def check(self) -> None:
        """Raises TooMuchToDo where `put` would."""
        if self._waiting >= _WAITING:
            raise TooMuchToDo(self._waiting)

    def put(self, work: Callable[[], T]) -> asyncio.Future[T]:
        """From the event loop. Raises Stopping after `close`."""
        try:
            future = asyncio.get_running_loop().run_in_executor(self._pool, work)
        except RuntimeError as error:
            raise Stopping from error
        self._waiting += 1
        future.add_done_callback(self._taken)
        return future

    def _taken(self, future: asyncio.Future[Any]) -> None:
        self._waiting -= 1

    def close(self) -> None:
        """Blocks until what was begun has ended."""
        self._pool.shutdown(cancel_futures=True)


class Jobs:
    """Begins jobs, and tells the store what becomes of them. Used from the event loop."""

    def __init__(
        self,
        store: AbstractStore,
        files: Files,
        events: Events,
        metrics: Metrics,
        *,
        learners: int = 1,
        node_id: str | None = None,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._store, self._files, self._events, self._metrics = store, files, events, metrics
        self._node_id, self._now_ns = node_id, now_ns
        threads: dict[JobKind, int] = {"learn": learners, "record": 4, "replay": 1, "batch": 1, "workspace": 1}
        self._queues = {kind: _Queue(count, kind) for kind, count in threads.items()}
        self._at_once, self._shown = _Queue(4, "desk"), _Queue(2, "show")

    async def begin(self, kind: JobKind, product_id: str | None, request: Json, work: Work) -> Job:
        """A job that runs, or waits for its turn. Raises TooMuchToDo."""
        self._queues[kind].check()
        add = partial(self._store.add_job, node=self._node_id)
        job = await asyncio.to_thread(add, new_id(), kind, product_id, request, self._now_ns())
        self._queues[kind].put(lambda: self._run(job, work))
        return job

    async def at_once(self, work: Callable[[], T]) -> T:
        """What comes of long work that somebody waits for. Goes on when they do not. Raises TooMuchToDo, Stopping."""
        self._at_once.check()
        return await asyncio.shield(self._at_once.put(work))

    async def shown(self, work: Callable[[], T]) -> T:
        """The same for what somebody looks at, which does not wait for replays. Raises TooMuchToDo, Stopping."""
        self._shown.check()
        return await asyncio.shield(self._shown.put(work))

    async def cancel(self, job_id: str, actor: str) -> Job:
        """A job that runs or waits, at whatever service, fails; what it has done by then stays.

        Whoever does it finds out when it next tells how far it is. Raises NoSuchJob, JobEnded.
        """
        error = f"it was cancelled by {actor}"
        change = self._store.update_job
        job = await asyncio.to_thread(change, job_id, state="failed", ended_ns=self._now_ns(), error=error)
        self._tell_end(job, "failed", error)
        return job

    def close(self) -> None:
        """After the desks were closed. Blocks until every job has said how it ended."""
        for queue in (*self._queues.values(), self._at_once, self._shown):
            queue.close()

    def _run(self, job: Job, work: Work) -> None:
        """In a thread."""
        try:
            if self._ended(job):
                return
            outcome = work(lambda share: self._tell(job, share))
        except InspectionError as error:
            self._end(job, error=self._files.hidden(str(error)))
        except Exception:
            _log.exception("job broke", job_id=job.job_id)
            self._end(job, error="something unexpected went wrong; the log of the service says what")
        else:
            self._end(job, outcome=outcome)

    def _ended(self, job: Job) -> bool:
        """Before its turn came."""
        try:
            return self._store.job(job.job_id).state != "running"
        except StoreError:
            return False

    def _tell(self, job: Job, share: float) -> None:
        self._store.update_job(job.job_id, progress=share)
        self._events.publish_soon("job", job_id=job.job_id, state="running", progress=round(share, 3))

    def _end(self, job: Job, outcome: Json | None = None, error: str | None = None) -> None:
        state: JobState = "done" if error is None else "failed"
        try:
            self._store.update_job(
                job.job_id,
                state=state,
                ended_ns=self._now_ns(),
                outcome=outcome,
                error=error,
                progress=1.0 if error is None else None,
            )
        except JobEnded:
            # It was cancelled meanwhile, or this service was taken for gone: that has been told.
            _log.info("job left", job_id=job.job_id, work=job.kind)
            return
        except InspectionError as trouble:
            # The next start finds the job running, and fails it; or other services did that already.
            _log.error("job not stored", job_id=job.job_id, state=state, error=str(trouble))
        self._tell_end(job, state, error, outcome)

    def _tell_end(self, job: Job, state: JobState, error: str | None, outcome: Json | None = None) -> None:
        """To the log, the figures and dashboards."""
        names = {"work": job.kind, "job_id": job.job_id, "product_id": job.product_id}
        _log.info("job", **names, state=state, error=error, seconds=round((self._now_ns() - job.created_ns) / 1e9, 3))
        self._metrics.jobs.labels(job.kind, state).inc()
        # A batch may have a thousand sentences for whoever asks.
        told = {name: value for name, value in (outcome or {}).items() if not (name == "said" and len(value) > _SAID)}
        self._events.publish_soon("job", **names, state=state, error=error, **told)
