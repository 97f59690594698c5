"""Since when scores have moved: a change point in the order of the parts, for each stretch of the sweep apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_FEWEST = 20
"""Parts below which nothing is said."""
_CHANCE = 0.01
"""Probability, over all stretches together, of a change where there is none."""
_LEAST = 0.05
"""Of the limit: smaller steps are found among many parts, and mean nothing."""


@dataclass(frozen=True)
class Change:
    """A stretch s_start <= s < s_end whose scores went from one level to another, and stayed there."""

    s_start: float
    s_end: float
    since: int
    """The first part of the other level, counted from 0, the oldest."""
    before: float
    """Median score before; 1.0 is at the threshold."""
    after: float


def changes(profiles: Float[np.ndarray, "n bins"]) -> tuple[Change, ...]:
    """Where and since when the profiles of parts, oldest first, have moved; NaN where a part was not seen.

    By ranks, so that single bad parts weigh no more than others: Pettitt, A Non-Parametric Approach to the
    Change-Point Problem, Applied Statistics 28 (1979). It is assumed that parts are independent but for one change in
    each bin; of several, the one that divides best is told. Neighbouring bins that went the same way are one stretch,
    since when the largest of them is.

    >>> profiles = np.tile(np.linspace(0.2, 0.3, 10), (40, 1)) + 0.01 * np.sin(np.arange(40.0))[:, None]
    >>> profiles[25:, 3:5] += 0.4
    >>> [(each.s_start, each.s_end, each.since) for each in changes(profiles)]
    [(0.3, 0.5, 25)]
    """
    n, bins = profiles.shape
    found = [_change(profiles[:, bin], bin, bins) for bin in range(bins)] if n >= _FEWEST else []
    return tuple(_joined(found))


def _change(scores: Float[np.ndarray, " n"], bin: int, bins: int) -> Change | None:
    seen = np.flatnonzero(np.isfinite(scores))
    n = len(seen)
    if n < _FEWEST:
        return None
    t = np.arange(1, n)
    known = scores[seen]
    u = 2 * np.cumsum(_ranks(known))[:-1] - t * (n + 1)
    chance = 2 * float(np.exp(-6 * float(np.abs(u).max()) ** 2 / (n**3 + n**2)))
    # The highest of u lies too far to the middle. Each part is nearer to the one level or the other: that tells when.
    before, after = _levels(known, int(np.argmax(np.abs(u) / np.sqrt(t * (n - t)))) + 1)
    at = int(np.argmin(np.cumsum(np.abs(known - before) - np.abs(known - after))[:-1])) + 1
    before, after = _levels(known, at)
    if chance * bins > _CHANCE or abs(after - before) < _LEAST:
        return None
    return Change(bin / bins, (bin + 1) / bins, int(seen[at]), before, after)


def _levels(scores: Float[np.ndarray, " n"], at: int) -> tuple[float, float]:
    return float(np.median(scores[:at])), float(np.median(scores[at:]))


def _ranks(scores: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """From 1; equal ones share the mean of theirs."""
    _, which, counts = np.unique(scores, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - (counts - 1) / 2)[which]


def _joined(found: list[Change | None]) -> Iterator[Change]:
    run: list[Change] = []
    for each in [*found, None]:
        if run and (each is None or (each.after > each.before) != (run[-1].after > run[-1].before)):
            most = max(run, key=lambda one: abs(one.after - one.before))
            yield Change(run[0].s_start, run[-1].s_end, most.since, most.before, most.after)
            run = []
        if each is not None:
            run.append(each)
