"""Where along the sweep: an on-line filter over s that knows pace and says when it does not know."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

_STEPS = np.arange(-2, 9)
"""How many places a frame may lie from the one before: two back, eight ahead."""
_RIVALS = 3
_LOST = 24.0
"""Cost of a jump to anywhere: what a chain may be worse than a fresh start."""
_CAP = 16.0
"""What one frame may say against a place: one picture with a defect in it moves nobody."""
_NEAR, _AWAY, _LOOK_UP = 40, 12.0, 8
"""Only places this near the best one are in the running while all others are this much worse; for so many frames."""
_SPREAD = np.array([5.0, 5.0, 0.012, 0.15, 0.15])
"""How far the picture may be shifted (pixels), turned (radians) and shaded (share) at a place."""
_MISFIT_PX = 0.3
"""Good parts differ from the golden one as if every edge stood this far off, in pixels."""
_DIMENSIONS = 8.0
"""Coordinates that speak independently: what good parts have in common with each other ties the k together."""


@dataclass(frozen=True, eq=False)
class _Known:
    """Derived from a track once, so that a frame costs a few products."""

    scale: Float[np.ndarray, " n"]
    """Expected squared distance of z from a place."""
    log: Float[np.ndarray, " n"]
    """Logarithm of the variance of a coordinate."""
    square: Float[np.ndarray, " n"]
    flat: Float[np.ndarray, "5n k"]
    offset: Float[np.ndarray, "n 5"]
    solve: Float[np.ndarray, "n 5 5"]
    length: Float[np.ndarray, " n"]
    """Squared length of the motion."""


@dataclass(frozen=True, eq=False)
class Track:
    """The learnt curve with what the filter needs at each of its n places (one per reference picture)."""

    z: Float[np.ndarray, "n k"]
    slope: Float[np.ndarray, "n 5 k"]
    """How z moves with the picture: per pixel of shift in x and in y, per radian, per unit of shading in x and y."""
    motion: Float[np.ndarray, "n 2"]
    """How far the picture moves to the next place, in pixels."""
    noise: float
    """Standard deviation of z per coordinate at a known place, from sensor noise alone."""

    @cached_property
    def known(self) -> _Known:
        """What follows from the above alone."""
        n, j, k = self.slope.shape
        variance = self.noise**2 + _MISFIT_PX**2 * np.square(self.slope[:, :2]).sum(axis=(1, 2)) / k
        gram = self.slope @ self.slope.transpose(0, 2, 1)
        gram += (variance[:, None] / _SPREAD**2)[:, :, None] * np.eye(j)
        return _Known(
            k * variance,
            np.log(variance),
            np.einsum("nk,nk->n", self.z, self.z),
            self.slope.reshape(n * j, k),
            np.einsum("njk,nk->nj", self.slope, self.z),
            np.asarray(np.linalg.inv(gram), float),
            np.square(self.motion).sum(axis=1).clip(1.0),
        )

    def misfit(self, place: int, z: Float[np.ndarray, " k"]) -> float:
        """Distance of z from the curve about a place, shift, turn and shading taken out; about 1 on a good part."""
        known, away = self.known, z - self.z[place]
        slopes = self.slope[place] @ away
        left = max(float(away @ away - slopes @ known.solve[place] @ slopes), 0.0)
        return float(np.sqrt(left / known.scale[place]))

    def looks(
        self, z: Float[np.ndarray, " k"], near: slice[int, int, None]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 5"]]:
        """Cost of seeing z at each place of `near`, and the shift, turn and shading that explain it best."""
        known = self.known
        away = z @ z - 2 * (self.z[near] @ z) + known.square[near]
        offset = known.offset[near]
        j = offset.shape[1]
        slopes = (known.flat[near.start * j : near.stop * j] @ z).reshape(offset.shape) - offset
        fit = np.matmul(known.solve[near], slopes[:, :, None])[:, :, 0]
        left = (away - (slopes * fit).sum(axis=1)).clip(0)
        share = left / known.scale[near]
        # a heavy tail: beyond twice the noise a look is a defect or another place, not ever more unlikely
        tail = share.clip(4)
        misfit = share.clip(max=4) + 4 * np.log(tail / 4)
        return 0.5 * _DIMENSIONS * (misfit + known.log[near]), fit


@dataclass(frozen=True, eq=False)
class Places:
    """What the filter believes after a frame: a cost for every place, and what each one carries."""

    cost: Float[np.ndarray, " n"]
    at: Float[np.ndarray, " n"]
    """Where, in reference frames, the hypothesis of each place stands: its index and a fraction."""
    pace: Float[np.ndarray, " n"]
    """Reference frames per nominal frame interval, along the path of each hypothesis."""
    unseen: int = 0
    """Frames since all places were looked at."""


@dataclass(frozen=True)
class Standing:
    """The filter's answer: the best place, and how far behind the best other place is."""

    index: int
    at: float
    pace: float
    margin: float
    """Cost by which every place further than three frames away is worse."""
    others: tuple[int, ...]
    """Rival places, best first."""


def start(track: Track) -> Places:
    """Before the first frame: the sweep begins in the first tenth, or, less likely, anywhere."""
    n = len(track.z)
    i = np.arange(n, dtype=float)
    cost = np.minimum(np.maximum(0, i - max(n / 10, 3)), _LOST)
    return Places(cost, i.copy(), np.ones(n))


def move(
    track: Track, places: Places, z: Float[np.ndarray, " k"], elapsed: float, fixture: Float[np.ndarray, " 3"]
) -> Places:
    """One frame further: `elapsed` nominal frame intervals after the one before.

    Where only places about the best one are in the running, only they are looked at, and the others every few frames:
    the cost of a frame does not grow with the sweep.
    """
    n = len(track.z)
    near = _running(places)
    look, fit = track.looks(z.astype(float), near)
    fraction = ((fit[:, :2] - fixture[:2]) * track.motion[near]).sum(axis=1) / track.known.length[near]
    index: np.ndarray = np.arange(near.start, near.stop)
    at: np.ndarray = index + np.clip(fraction, -0.6, 0.6)

    origin: np.ndarray = index[:, None] - _STEPS[None, :]
    inside: np.ndarray = (origin >= 0) & (origin < n)
    origin = np.clip(origin, 0, n - 1)
    expected = np.maximum(places.pace[origin], 0.3) * elapsed
    travel: np.ndarray = at[:, None] - places.at[origin]
    off = np.abs(travel - expected) / (0.3 + 0.25 * expected)
    pace_cost: np.ndarray = np.where(off < 2, 0.5 * off * off, 2 * off - 2)
    still = 4.0 + 3.0 * np.square(travel / 0.5)
    cost = places.cost[origin] + np.minimum(pace_cost, still) + np.where(travel < -0.75, 6.0, 0.0)
    cost[~inside] = np.inf
    best = cost.argmin(axis=1)
    rows = np.arange(len(index))
    chain, origin, step = cost[rows, best], origin[rows, best], travel[rows, best]
    floor = float(places.cost.min()) + _LOST
    fresh = chain > floor
    old = places.pace[origin]
    moving: np.ndarray = step > 0.3 * old * elapsed
    pace = np.where(moving, old + 0.2 * (np.clip(step / elapsed, 0.2, 3.0) - old), old)
    total = np.where(fresh, floor, chain) + np.minimum(look - look.min(), _CAP)
    if near.stop - near.start == n:
        return Places(total - total.min(), at, np.where(fresh, 1.0, pace), 0)
    costs, ats, paces = np.full(n, floor + _CAP), places.at.copy(), np.ones(n)
    costs[near], ats[near], paces[near] = total, at, np.where(fresh, 1.0, pace)
    return Places(costs - costs.min(), ats, paces, places.unseen + 1)


def _running(places: Places) -> slice[int, int, None]:
    """The places that a frame is compared with."""
    n = len(places.cost)
    best = int(places.cost.argmin())
    near = slice(max(0, best - _NEAR), min(n, best + _NEAR))
    rest = min(places.cost[: near.start].min(initial=np.inf), places.cost[near.stop :].min(initial=np.inf))
    if n <= 3 * _NEAR or rest < _AWAY or places.unseen >= _LOOK_UP:
        return slice(0, n)
    return near


def standing(places: Places) -> Standing:
    """The best place and its rivals."""
    i = int(places.cost.argmin())
    rest = places.cost.copy()
    rest[max(0, i - 3) : i + 4] = np.inf
    others: list[int] = []
    margin = float(rest.min())
    for _ in range(_RIVALS):
        j = int(rest.argmin())
        if not np.isfinite(rest[j]):
            break
        others.append(j)
        rest[max(0, j - 3) : j + 4] = np.inf
    return Standing(i, float(places.at[i]), float(places.pace[i]), margin, tuple(others))


def vouch(places: Places, at: float, weight: float) -> Places:
    """The picture itself fits at `at`: places elsewhere become costlier by up to `weight`."""
    i = np.arange(len(places.cost))
    cost = places.cost + weight * np.minimum(np.square((i - at) / 2.0), 1.0)
    return replace(places, cost=cost - cost.min())
