"""The closest manifold point: exact on the resampled manifold, then refined on the spline."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, Float64

from models.manifold import Jet, Manifold

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

SCAN = 5000
"""Up to as many points a scan is faster than any tree (measured)."""
STEPS = 12
"""Newton steps at most; three or four are usual."""
CLOSE = 1e-7
"""A step shorter than this share of the spacing ends refining."""


@dataclass(frozen=True, eq=False)
class Nearest:
    """The point of the manifold closest to a z."""

    q: Float64[np.ndarray, " m"]
    """Where on the manifold; a period counts from the start of its axis."""
    distance: float
    """||z - g(q)||."""
    index: int
    """The closest of the resampled points, from which q was refined."""


@dataclass(frozen=True, eq=False)
class NearestPoint:
    """Finds the q that minimises ||z - g(q)||, or says that none is near.

    The paper (Nayar, Nene, Murase 1996, section III-C) keeps sorted lists per dimension and trims a hypercube; one
    matrix-vector product over all points now is faster, up to some 5,000 points, and a k-d tree beyond. The closest of
    the resampled points is exact; refining then goes downhill on the spline from there and never ends farther away.
    Another branch of the manifold may come closer only between resampled points: resample densely.

    >>> turn = np.radians(np.arange(0, 360, 10.0))
    >>> circle = Manifold.over(turn, np.stack([np.cos(turn), np.sin(turn)], axis=1), period=2 * np.pi)
    >>> closest = NearestPoint.of(circle, 72)
    >>> found = closest.find(np.array([2 * np.cos(1), 2 * np.sin(1)]))
    >>> found.q.round(4), round(found.distance, 4), found.index
    (array([1.]), 1.0, 11)
    >>> closest.find(np.array([0.0, 3.0]), within=1.5) is None
    True
    """

    manifold: Manifold
    q: Float64[np.ndarray, "n m"]
    """Parameters of the resampled points."""
    z: Float32[np.ndarray, "n k"]
    """The resampled points."""
    spacing: Float64[np.ndarray, " m"]
    """Distance between resampled points per parameter: how far refining may go."""

    def __post_init__(self) -> None:
        for array in (self.q, self.z, self.spacing):
            array.flags.writeable = False

    @classmethod
    def of(cls, manifold: Manifold, counts: int | Sequence[int]) -> NearestPoint:
        """Resamples the manifold at so many evenly spaced values of each parameter."""
        q, z = manifold.resample(counts)
        numbers = np.broadcast_to(np.asarray(counts), manifold.m)
        spans = [
            axis[-1] - axis[0] if period is None else period
            for axis, period in zip(manifold.axes, manifold.periods, strict=True)
        ]
        gaps = [count - (period is None) for count, period in zip(numbers, manifold.periods, strict=True)]
        return cls(manifold, q, z.astype(np.float32), np.array(spans) / np.maximum(gaps, 1))

    @cached_property
    def _halves(self) -> Float32[np.ndarray, " n"]:
        """Half of each squared length."""
        return (np.einsum("ij,ij->i", self.z, self.z, dtype=np.float64) / 2).astype(np.float32)

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree  # noqa: PLC0415 (only where there are many points)

        return cKDTree(self.z)

    def find(
        self, z: Float[np.ndarray, " k"], *, within: float | None = None, window: tuple[int, int] | None = None
    ) -> Nearest | None:
        """The closest point to z (k,); None where none is within the distance `within`.

        `window` looks only at the resampled points start <= index < end (one parameter: a stretch of the sweep).
        """
        start, end = (0, len(self.z)) if window is None else (max(0, window[0]), min(window[1], len(self.z)))
        if start >= end:
            return None
        z = z.astype(np.float64)
        many = end - start > SCAN and window is None
        index = int(self._tree.query(z)[1]) if many else self._scan(z, start, end)
        if self.manifold.m == 1:
            q, distance = self._refined_on_curve(z, float(self.q[index, 0]))
        else:
            q, distance = self._refined(z, self.q[index])
        return None if within is not None and distance > within else Nearest(q, distance, index)

    def _scan(self, z: Float64[np.ndarray, " k"], start: int, end: int) -> int:
        """Equal to brute force in float64: what float32 cannot tell apart is compared again."""
        points, halves = self.z[start:end], self._halves[start:end]
        heights = halves - points @ z.astype(np.float32)
        # Rounding of k products in float32, of two of them, at its worst.
        doubt = (self.z.shape[1] + 4) * 6e-8 * (float(z @ z) + 2 * float(halves.max()))
        close = np.flatnonzero(heights <= heights.min() + doubt)
        if close.size > 1:
            apart = points[close].astype(np.float64) - z
            close = close[[np.einsum("ij,ij->i", apart, apart).argmin()]]
        return start + int(close[0])

    def _refined_on_curve(self, z: Float64[np.ndarray, " k"], s: float) -> tuple[Float64[np.ndarray, " m"], float]:
        """`_refined` for one parameter, in a fraction of the time."""
        g, spacing = self.manifold, float(self.spacing[0])
        low, high = (float(end[0]) for end in self._box(np.array([s])))
        apart = g.at(s) - z
        squared, shortest = float(apart @ apart), CLOSE * spacing
        for _ in range(STEPS):
            slope, bend = g.differentiate(s, (1,)), g.differentiate(s, (2,))
            gradient, gauss = float(slope @ apart), float(slope @ slope)
            curvature = gauss + float(bend @ apart)
            curvature = curvature if curvature > 1e-9 * gauss else max(gauss, 1e-300)
            step = min(max(s - gradient / curvature, low), high) - s
            while abs(step) > shortest:
                moved = g.at(s + step) - z
                if float(moved @ moved) < squared:
                    break
                step /= 4
            else:
                break
            s, apart, squared = s + step, moved, float(moved @ moved)
        return g.wrap(np.array([s])), squared**0.5

    def _refined(
        self, z: Float64[np.ndarray, " k"], q: Float64[np.ndarray, " m"]
    ) -> tuple[Float64[np.ndarray, " m"], float]:
        return refine(self.manifold, z, q, self.spacing)

    def _box(self, q: Float64[np.ndarray, " m"]) -> tuple[Float64[np.ndarray, " m"], Float64[np.ndarray, " m"]]:
        return _box(self.manifold, q, self.spacing)


def refine(
    g: Manifold,
    z: Float64[np.ndarray, " k"],
    q: Float64[np.ndarray, " m"],
    reach: Float64[np.ndarray, " m"],
    close: float = CLOSE,
) -> tuple[Float64[np.ndarray, " m"], float]:
    """(q, ||z - g(q)||) downhill from q, no farther than `reach` from it per parameter: never worse than q.

    Newton on ||z - g(q)||^2 / 2, a step shortened until it goes down; one shorter than `close` of the reach ends it.
    """
    box = low, high = _box(g, q, reach)
    jet, shortest = g.jet(q), close * reach
    apart = jet.value - z
    squared = float(apart @ apart)
    for _ in range(STEPS):
        step = np.minimum(np.maximum(q + _newton(jet, q, apart, box, reach), low), high) - q
        while (np.abs(step) > shortest).any():
            moved = g.jet(q + step)
            left = moved.value - z
            if float(left @ left) < squared:
                break
            step = step / 4
        else:
            break
        q, jet, apart, squared = q + step, moved, left, float(left @ left)
    return g.wrap(q), squared**0.5


def _box(
    g: Manifold, q: Float64[np.ndarray, " m"], reach: Float64[np.ndarray, " m"]
) -> tuple[Float64[np.ndarray, " m"], Float64[np.ndarray, " m"]]:
    """`reach` about q, inside the axes that have ends."""
    ends = [
        (float(axis[0]), float(axis[-1])) if period is None else (-np.inf, np.inf)
        for axis, period in zip(g.axes, g.periods, strict=True)
    ]
    low, high = np.array(ends).T
    return np.maximum(q - reach, low), np.minimum(q + reach, high)


def _newton(
    jet: Jet,
    q: Float64[np.ndarray, " m"],
    apart: Float64[np.ndarray, " k"],
    box: tuple[Float64[np.ndarray, " m"], Float64[np.ndarray, " m"]],
    reach: Float64[np.ndarray, " m"],
) -> Float64[np.ndarray, " m"]:
    """The Newton step, parameters that push against their bound held still.

    Where the true curvature does not lead downhill, Gauss's approximation of it; where that is singular, a
    step as far as allowed along the gradient.
    """
    (low, high), gradient = box, jet.slopes @ apart
    held = (q <= low) & (gradient > 0) | (q >= high) & (gradient < 0)
    if held.any():
        free = np.flatnonzero(~held)
        step = np.zeros_like(q)
        slopes, bends = jet.slopes[free], jet.bends[np.ix_(free, free)]
        if free.size:
            step[free] = _downhill(slopes, bends, gradient[free], apart, reach[free])
        return step
    return _downhill(jet.slopes, jet.bends, gradient, apart, reach)


def _downhill(
    slopes: Float64[np.ndarray, "m k"],
    bends: Float64[np.ndarray, "m m k"],
    gradient: Float64[np.ndarray, " m"],
    apart: Float64[np.ndarray, " k"],
    reach: Float64[np.ndarray, " m"],
) -> Float64[np.ndarray, " m"]:
    gauss = slopes @ slopes.T
    least = 1e-9 * float(gauss.trace())
    for curvature in (gauss + bends @ apart, gauss):
        with suppress(np.linalg.LinAlgError):
            if least > 0 and (np.linalg.cholesky(curvature).diagonal() ** 2 > least).all():
                return -np.linalg.solve(curvature, gradient)
    return -np.sign(gradient) * reach
