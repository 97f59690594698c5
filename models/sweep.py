"""Sweep: the frames of one pass in order, readable again and again, and the facts of their order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from models.frame import Frame


@dataclass(frozen=True)
class Gap:
    """Frames that the camera counted but that never came."""

    index: int
    """Of the first frame after the gap, counted from 0."""
    lost: int


@dataclass(frozen=True)
class SweepFacts:
    """What times and sequence numbers of the frames of one pass say about it.

    >>> facts = SweepFacts.of_stamps([0, 40, 80, 160, 200, 200], [0, 1, 2, 4, 5, 6])
    >>> facts.frames, facts.lost, facts.gaps, facts.interval_ns, facts.disorder
    (6, 1, (Gap(index=3, lost=1),), 40, ('frame 5 has the time 200 of frame 4',))
    """

    frames: int
    duration_ns: int
    """From the first frame to the last."""
    interval_ns: int
    """Nominal time from frame to frame: the median over frames that follow each other in sequence; 0 where none do."""
    gaps: tuple[Gap, ...]
    disorder: tuple[str, ...]
    """A sentence for each frame whose time or sequence number does not follow that of the frame before."""

    @classmethod
    def of(cls, frames: Iterable[Frame]) -> SweepFacts:
        """Reads the frames once and keeps none of them."""
        stamps = [(frame.t_ns, frame.sequence) for frame in frames]
        return cls.of_stamps([t_ns for t_ns, _ in stamps], [sequence for _, sequence in stamps])

    @classmethod
    def of_stamps(cls, times_ns: list[int], sequences: list[int]) -> SweepFacts:
        """From the times and sequence numbers of the frames in the order in which they came."""
        pairs = list(enumerate(pairwise(zip(times_ns, sequences, strict=True)), start=1))
        gaps = tuple(Gap(i, now[1] - before[1] - 1) for i, (before, now) in pairs if now[1] > before[1] + 1)
        intervals = [now[0] - before[0] for _, (before, now) in pairs if now[1] == before[1] + 1 and now[0] > before[0]]
        disorder = tuple(said for i, (before, now) in pairs for said in _disorder(i, before, now))
        duration = times_ns[-1] - times_ns[0] if times_ns else 0
        return cls(len(times_ns), duration, int(np.median(intervals)) if intervals else 0, gaps, disorder)

    @property
    def lost(self) -> int:
        """Frames lost in all gaps."""
        return sum(gap.lost for gap in self.gaps)


def _disorder(i: int, before: tuple[int, int], now: tuple[int, int]) -> Iterator[str]:
    if now[0] == before[0]:
        yield f"frame {i} has the time {now[0]} of frame {i - 1}"
    if now[0] < before[0]:
        yield f"frame {i} is {before[0] - now[0]} ns older than frame {i - 1}"
    if now[1] <= before[1]:
        yield f"frame {i} has sequence number {now[1]} after {before[1]}"


@dataclass(frozen=True, eq=False)
class Sweep:
    """The frames of one pass of the camera over one part, in order; may be iterated again and again.

    >>> frames = [Frame(np.full((2, 2), i, np.uint8), t_ns=40 * i, sequence=i) for i in range(3)]
    >>> sweep = Sweep(lambda: frames)
    >>> [frame.t_ns for frame in sweep], sweep.facts.interval_ns
    ([0, 40, 80], 40)
    """

    read: Callable[[], Iterable[Frame]]
    """Opens the frames anew at each call; they are never held all at once."""

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.read())

    @cached_property
    def facts(self) -> SweepFacts:
        """Reads the frames once more, the first time it is asked for."""
        return SweepFacts.of(self)
