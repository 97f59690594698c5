"""Deviations: stretches out of tolerance, as a fold over scored frames; live and in the end it is the same fold."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Self

from models.verdict import Deviation, FrameState, Policy, ScoredFrame

KINDS = ("appearance", "position", "timing")
DIP = 4
"""Frames from one that is raised to the next, up to which they belong to the same deviation."""
FEW = 5
"""Fewer raised frames are no deviation of position or timing."""


@dataclass(frozen=True)
class Run:
    """Raised frames that belong together, so far."""

    first: int
    last: int
    count: int
    low: float
    high: float
    """The lowest and highest s of its frames."""
    peak: ScoredFrame

    def with_frame(self, frame: ScoredFrame, kind: str) -> Self:
        """One raised frame more; of equal peaks the first stays."""
        s = frame.s or 0.0
        peak = frame if height(frame, kind) > height(self.peak, kind) else self.peak
        low, high = min(self.low, s), max(self.high, s)
        return replace(self, last=frame.index, count=self.count + 1, low=low, high=high, peak=peak)


@dataclass(frozen=True)
class Deviations:
    """What is out of tolerance up to now. A value: `step` returns the next one, and what opened or closed with it."""

    policy: Policy
    place: float
    """How far along s one place of the reference sweep reaches."""
    runs: dict[str, Run] = field(default_factory=dict[str, Run])
    """The run that has not ended, by kind; it is a deviation once it has reached the threshold."""
    closed: tuple[Deviation, ...] = ()

    def step(self, frame: ScoredFrame) -> tuple[Deviations, tuple[Deviation, ...], tuple[Deviation, ...]]:
        """The frame taken in; the deviations that it opened, and those that ended before it."""
        runs, opened, closed = dict(self.runs), list[Deviation](), list[Deviation]()
        for kind in KINDS:
            run = runs.get(kind)
            if run is not None and frame.index - run.last > DIP:
                closed += self._told(run, kind)
                del runs[kind]
                run = None
            if frame.state is FrameState.SCORED and height(frame, kind) >= self.policy.hysteresis:
                s = frame.s or 0.0
                longer = run.with_frame(frame, kind) if run else Run(frame.index, frame.index, 1, s, s, frame)
                if run is None or not self._told(run, kind):
                    opened += self._told(longer, kind)
                runs[kind] = longer
        return replace(self, runs=runs, closed=(*self.closed, *closed)), tuple(opened), tuple(closed)

    @property
    def all(self) -> tuple[Deviation, ...]:
        """Ended or not, in the order of their first frame."""
        going = [told for kind, run in self.runs.items() for told in self._told(run, kind)]
        return tuple(sorted((*self.closed, *going), key=lambda d: (d.index_start, d.kind)))

    def _told(self, run: Run, kind: str) -> list[Deviation]:
        """The deviation that a run is, if it is one."""
        peak_score = height(run.peak, kind)
        if peak_score < 1.0 or (kind != "appearance" and run.count < FEW):
            return []
        end = min(1.0, run.high + self.place)
        regions = run.peak.regions if kind == "appearance" else ()
        return [
            Deviation(
                min(run.low, end - self.place),
                end,
                run.first,
                run.last + 1,
                kind,
                regions[0].polarity if regions else None,
                peak_score,
                run.peak.index,
                regions,
            )
        ]


def deviations(frames: Iterable[ScoredFrame], policy: Policy, place: float) -> tuple[Deviation, ...]:
    """Stretches out of tolerance, with hysteresis, each kind apart, in the order of their first frame.

    A dip of a few frames below the hysteresis does not end one.
    """
    found = Deviations(policy, place)
    for frame in frames:
        found, _, _ = found.step(frame)
    return found.all


def height(frame: ScoredFrame, kind: str) -> float:
    """The residual of that kind, 1.0 at its threshold."""
    return float(getattr(frame.residuals, kind))
