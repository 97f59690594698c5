"""Where along a sweep whose picture changes otherwise than by moving: turntables, corridors. The eigenspace leads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from models.position import Places

_SAYS = 1.5
"""What a look says against a place: so many times the logarithm of its squared distance, over that of the nearest."""
_CAP, _LOST = 16.0, 24.0
"""What one frame may say against a place, and what a chain may be worse than a fresh start."""
_FLOOR = 0.02
"""Of a step between neighbours: looks closer than this are the same."""
_BACK, _AHEAD = 1, 5
"""Places that a frame may lie behind and, beyond the nominal pace, ahead of the one before."""
_PACE, _BACKWARDS = 0.7, 6.0
"""Standard deviation of the pace, as a share of the nominal one, and the cost of going back."""
_STRANGE, _FOREIGN = 2.0, 8.0
"""Steps (as squared distances) off the curve from which on looks are no longer the part's, and say no place either."""
_FOLLOWS = 0.25


@dataclass(frozen=True, eq=False)
class Turn:
    """The learnt curve through the looks of the reference sweep."""

    z: Float[np.ndarray, "n k"]
    spare: float
    """Squared distance from the eigenspace that its own pictures have."""

    @cached_property
    def step(self) -> float:
        """Squared distance from a place to the next, as a rule."""
        return max(float(np.median(np.square(np.diff(self.z, axis=0)).sum(axis=1))), 1e-9)

    @cached_property
    def _square(self) -> Float[np.ndarray, " n"]:
        return np.einsum("nk,nk->n", self.z, self.z)

    def away(self, z: Float[np.ndarray, " k"], off: float) -> Float[np.ndarray, " n"]:
        """Squared distance of a look from each place, in steps; `off` is its own from the eigenspace."""
        inside = np.maximum(z @ z - 2 * (self.z @ z) + self._square, 0.0)
        return (inside + max(off - self.spare, 0.0)) / self.step


def follow(places: Places, away: Float[np.ndarray, " n"], elapsed: float) -> Places:
    """One frame further, `elapsed` nominal frame intervals after the one before.

    Forward min-sum over whole places. Looks of one sweep err together (another lamp, another lane of the corridor), so
    each says little by itself and the pace much: only how much farther the others are counts, and by its logarithm.
    """
    n = len(away)
    steps = np.arange(-_BACK, _AHEAD + int(np.ceil(elapsed)))
    index: np.ndarray = np.arange(n)
    origin = index[:, None] - steps[None, :]
    inside: np.ndarray = (origin >= 0) & (origin < n)
    off = np.abs(steps - elapsed) / (_PACE * max(elapsed, 1.0))
    pace_cost = np.where(off < 2, 0.5 * off * off, 2 * off - 2) + np.where(steps < 0, _BACKWARDS, 0.0)
    cost = np.where(inside, places.cost[np.clip(origin, 0, n - 1)] + pace_cost, np.inf).min(axis=1)
    look = _SAYS * np.log((away + _FLOOR) / (away.min() + _FLOOR))
    total = np.minimum(cost, float(places.cost.min()) + _LOST) + np.minimum(look, _CAP)
    return Places(total - total.min(), index.astype(float), np.ones(n))


def strangeness(before: float | None, away: float) -> float:
    """How far the sweep is from the curve, of late, in steps; given what was before, and the frame's own."""
    return away if before is None else before + _FOLLOWS * (away - before)


def belongs(strange: float, away: float) -> bool:
    """Whether a frame shows the part that was learnt: pictures between two places are less than a step from either."""
    return strange <= _STRANGE and away <= 2 * _STRANGE


def resembles(strange: float) -> bool:
    """Whether looks, though not the part's, still say where along the sweep: a room on another day, the part's like."""
    return strange <= _FOREIGN
