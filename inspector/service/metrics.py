"""What Prometheus reads: one registry per service. Never labelled by the id of an inspection or a part."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, generate_latest


class Metrics:
    """The figures of one service."""

    content_type = "text/plain; version=0.0.4; charset=utf-8"
    """Of `exposition`."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "inspector_requests", "Requests answered", ["method", "route", "status"], registry=self.registry
        )
        """By method, route as documented, and status."""
        self.jobs = Counter("inspector_jobs", "Jobs ended", ["kind", "state"], registry=self.registry)
        """By kind and state."""

    def exposition(self) -> bytes:
        """All figures, in Prometheus' text format."""
        return generate_latest(self.registry)
