"""What Prometheus reads: one registry per service. Labelled by product, never by the id of an inspection or a part."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

_STAGES = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.0075, 0.01, 0.02, 0.03, 0.05, 0.075, 0.1, 0.2, 0.5, 1.0, 2.0)
_HELD = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5)
_LOOK_SECONDS = 0.01


class Metrics:
    """The figures of one service."""

    content_type = "text/plain; version=0.0.4; charset=utf-8"
    """Of `exposition`."""

    def __init__(self) -> None:
        at = self.registry = CollectorRegistry()
        self.requests = Counter("inspector_requests", "Requests answered", ["method", "route", "status"], registry=at)
        """By method, route as documented, and status."""
        self.jobs = Counter("inspector_jobs", "Jobs ended", ["kind", "state"], registry=at)
        """By kind and state."""
        self.frames = Counter("inspector_frames", "Frames answered", ["product", "outcome"], registry=at)
        """By product and outcome: `scored`, `dropped`, `refused`."""
        self.verdicts = Counter("inspector_verdicts", "Verdicts given", ["product", "verdict"], registry=at)
        """By product and verdict."""
        self.ended = Counter("inspector_inspections", "Inspections ended", ["product", "state"], registry=at)
        """By product and state."""
        self.refused = Counter("inspector_inspections_refused", "Inspections for which there was no room", registry=at)
        self.stages = Histogram("inspector_frame_seconds", "Time of a frame", ["stage"], buckets=_STAGES, registry=at)
        """By stage: `wait` for its turn, `decode`, `score`, `record`, and `total`, last byte in to score out."""
        self.running = Gauge("inspector_inspections_running", "Inspections in processing", registry=at)
        self.waiting = Gauge("inspector_frames_waiting", "Frames that wait for their turn", ["scorer"], registry=at)
        self.restarts = Gauge("inspector_scorer_restarts", "Scorers that had to be started again", registry=at)
        self.listeners = Gauge("inspector_event_listeners", "Listeners to events", registry=at)
        self.held = Histogram("inspector_event_loop_held_seconds", "The event loop held", buckets=_HELD, registry=at)

    def exposition(self) -> bytes:
        """All figures, in Prometheus' text format."""
        return generate_latest(self.registry)

    async def watch_loop(self, clock: Callable[[], float]) -> None:
        """How late a sleep wakes up is how long something else held the loop."""
        while True:
            before = clock()
            await asyncio.sleep(_LOOK_SECONDS)
            self.held.observe(max(0.0, clock() - before - _LOOK_SECONDS))
