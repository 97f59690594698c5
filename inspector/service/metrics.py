"""What Prometheus reads: one registry per service. Labelled by product, never by the id of an inspection or a part."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from math import inf

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.samples import Sample

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
        self.unpublished = Gauge("inspector_recordings_unpublished", "Recordings that wait on the disk", registry=at)
        """Closed, and not yet where they are kept."""
        self.listeners = Gauge("inspector_event_listeners", "Listeners to events", registry=at)
        self.services = Gauge("inspector_services", "Services on the database, this one too", registry=at)
        self.held = Histogram("inspector_event_loop_held_seconds", "The event loop held", buckets=_HELD, registry=at)

    def exposition(self) -> bytes:
        """All figures, in Prometheus' text format."""
        return generate_latest(self.registry)

    def frames_by_outcome(self) -> dict[str, int]:
        """Of all products."""
        counts: dict[str, int] = {}
        for sample in self._samples(self.frames, "_total"):
            counts[sample.labels["outcome"]] = counts.get(sample.labels["outcome"], 0) + int(sample.value)
        return counts

    def latency(self, share: float) -> float | None:
        """Seconds within which that share of the frames had their score, evenly within a bucket; None without any.

        Beyond the last bucket it is that bucket's end.
        """
        buckets = [
            (float(sample.labels["le"]), sample.value)
            for sample in self._samples(self.stages, "_bucket")
            if sample.labels["stage"] == "total"
        ]
        if not buckets or not (wanted := share * buckets[-1][1]):
            return None
        low, before = 0.0, 0.0
        for end, count in buckets:
            if count >= wanted:
                return low if end == inf else low + (end - low) * (wanted - before) / (count - before)
            low, before = end, count
        return low

    def _samples(self, metric: Counter | Histogram, ending: str) -> Iterator[Sample]:
        for family in metric.collect():
            yield from (sample for sample in family.samples if sample.name.endswith(ending))

    async def watch_loop(self, clock: Callable[[], float]) -> None:
        """How late a sleep wakes up is how long something else held the loop."""
        while True:
            before = clock()
            await asyncio.sleep(_LOOK_SECONDS)
            self.held.observe(max(0.0, clock() - before - _LOOK_SECONDS))
