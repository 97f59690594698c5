"""The station as a whole: whether it has room for one more inspection, and what is told of those that it has."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager

import structlog

from inspector.scorers.pool import Pool, Scorer
from inspector.service.errors import AtCapacity
from inspector.service.events import Events
from inspector.service.load import Ration, Turns, no_time
from inspector.service.metrics import Metrics
from inspector.service.roster import Roster
from inspector.service.running import FACTS
from inspector.stores.records import Json, StoredInspection

_TELL_SECONDS = 0.25
_FIGURES = "coverage", "frames_scored", "frames_dropped", "digest"
"""Of a result, what dashboards are told at its end, beside its deviations."""
_log = structlog.get_logger("inspector")


class Station:
    """Of one process. Used from the event loop."""

    def __init__(self, roster: Roster, pool: Pool, events: Events, metrics: Metrics, most: int) -> None:
        """`most` inspections may run at once."""
        self.stopping = False
        """Whether nothing new is taken any more."""
        self.beside: Callable[[], Iterable[tuple[Scorer, float]]] = tuple
        """What else needs a share of the scorers' time."""
        self._roster, self._pool, self._events, self._metrics, self._most = roster, pool, events, metrics, most
        self._beginning = 0
        self._turns = Turns()

    @property
    def state(self) -> str:
        """`ready`, `inspecting`, `at capacity`, `stopping`."""
        if self.stopping:
            return "stopping"
        if self._full() is not None:
            return "at capacity"
        return "inspecting" if self._roster else "ready"

    @property
    def facts(self) -> Json:
        """What the event `station` tells."""
        return {"state": self.state, "running": len(self._roster)}

    @contextmanager
    def room(self) -> Generator[None]:
        """For an inspection that is being begun. Raises AtCapacity."""
        if (why := self._full()) is not None:
            self._metrics.refused.inc()
            raise AtCapacity(why)
        self._beginning += 1
        try:
            yield
        finally:
            self._beginning -= 1

    async def make_way(self) -> None:
        """For a request that only reads: frames go first."""
        if self._roster:
            await self._turns.wait()

    def stop(self) -> None:
        """Nothing new is taken from now on, and all are told."""
        self.stopping = True
        self._events.publish("station", **self.facts)

    def ended(self, stored: StoredInspection) -> None:
        """Dashboards, the figures and the log are told of an end."""
        result = stored.result or {}
        told = {name: getattr(stored, name) for name in (*FACTS, "state", "verdict", "reason")}
        told |= {name: result.get(name) for name in _FIGURES}
        completed = stored.state == "completed"
        self._metrics.ended.labels(stored.product_id, stored.state).inc()
        if completed and stored.verdict is not None:
            self._metrics.verdicts.labels(stored.product_id, stored.verdict).inc()
        self._events.publish("verdict" if completed else "aborted", **told, deviations=result.get("deviations", []))
        _log.info("inspection", **told, seconds=round((time.time_ns() - stored.begun_ns) / 1e9, 3))

    def observe(self) -> None:
        """Bring the gauges up to date."""
        self._metrics.running.set(len(self._roster))
        self._metrics.listeners.set(self._events.listeners)
        self._metrics.restarts.set(sum(scorer.restarts for scorer in self._pool.scorers))
        for scorer in self._pool.scorers:
            self._metrics.waiting.labels(str(scorer.number)).set(scorer.waiting)

    async def tell_loop(self) -> None:
        """A few times a second: the latest scores and pictures, and how the station is when that changes."""
        told: Json = {}
        ration = Ration()
        while True:
            await asyncio.sleep(_TELL_SECONDS)
            ration.refill(_TELL_SECONDS)
            # Whose picture was not told for longest comes first.
            for running in sorted(self._roster, key=lambda each: each.shown_at):
                running.tell_briefs()
                running.tell_picture(ration)
            if told != (told := self.facts):
                self._events.publish("station", **told)

    def _full(self) -> str | None:
        """Why there is no room for one more; None where there is."""
        count = len(self._roster) + self._beginning
        if count >= self._most:
            return f"{count} are running, {self._most} are allowed"
        shares = [(running.scorer, running.load.share) for running in self._roster]
        return no_time(count, shares, self.beside(), self._pool.scorers)
