"""The closest manifold point over all objects and their whole q boxes: coarse search, then Newton on the spline."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int

from models.eigenspace import Eigenspace
from models.errors import NumericError
from models.nearest import refine
from models.workspace.grid import Parameter
from models.workspace.learnt import LearntObject, inverse
from models.workspace.located import Located, Rival

POINTS = 17_500
"""Resampled points of all objects, about."""
DENSEST = 4
"""Resampled points per sample and parameter at most."""
OBJECTS = 5
"""How many objects are looked at closely."""
STARTS = 5
"""From how many places of each at most."""
REACH = 2.0
"""Spacings that a minimum may lie off the coarse one. Valleys are long and aslant: the points beside one mislead."""
LOOKED_AT = 6
"""Of the coarse minima: which of them to begin from is told by these."""
SCANNED = 16
"""Whitened coordinates that are compared with all points; the rest joins in when descending."""
FARTHER = 4.0
"""Times the closest squared distance so far: an object whose eigenspace alone is as far is not looked at closely."""
SIGMAS = 4.0
"""Standard deviations by which a place must be less likely than the best one in order not to be told with it."""
BEYOND = 1.5
"""Times an object's limit that a picture may be away if no other object comes within twice that picture's distance."""
ALIKE = 1.2
"""Another object whose squared distance is less than this times the closest may be the truth."""
CLOSE = 1e-3
"""Of the way from sample to sample: places are not looked for more finely."""
QUIET = 0.6
"""Of the noise learnt, as a variance: pictures are not taken to be quieter. What they were labelled with errs, too."""


@dataclass(frozen=True, eq=False)
class Found:
    """A place where a picture fits best round about."""

    learnt: LearntObject
    q: Float64[np.ndarray, " m"]
    covariance: Float64[np.ndarray, "m m"]
    """Of q, where every whitened coordinate is off by 1."""
    strays: float
    """Squared distance in standard deviations of the object's own noise."""
    squared: float
    """Squared distance as pictures differ, that from the eigenspace included."""


@dataclass(frozen=True, eq=False)
class Resampled:
    """The resampled manifold of one object."""

    learnt: LearntObject
    q: Float64[np.ndarray, "n m"]
    counts: tuple[int, ...]
    step: Float64[np.ndarray, " m"]
    """From point to point."""

    @classmethod
    def of(cls, learnt: LearntObject, by: float) -> Resampled:
        """So many points per sample and parameter."""
        g = learnt.manifold
        ends = [period is None for period in g.periods]
        counts = tuple(round((axis.size - end) * by) + end for axis, end in zip(g.axes, ends, strict=True))
        spans = [
            axis[-1] - axis[0] if period is None else period for axis, period in zip(g.axes, g.periods, strict=True)
        ]
        step = np.array(spans) / (np.array(counts) - ends)
        return cls(learnt, g.resample(counts)[0], counts, step)

    @cached_property
    def _points(self) -> tuple[Float32[np.ndarray, "n k"], Float32[np.ndarray, " n"]]:
        """Whitened, and half the square of each."""
        y = np.ascontiguousarray(self.learnt.white.at(self.q)[:, :SCANNED], np.float32)
        return y, np.einsum("ij,ij->i", y, y) / 2

    @cached_property
    def _neighbours(self) -> list[tuple[int, Bool[np.ndarray, " a"], Int[np.ndarray, " b"], Int[np.ndarray, " b"]]]:
        """Of each axis: how far neighbours lie apart in memory, whether a point has one so far before it, and the first
        and last points of its lines where it has a period."""
        found: list[tuple[int, np.ndarray, np.ndarray, np.ndarray]] = []
        for axis, period in enumerate(self.learnt.manifold.periods):
            count, apart = self.counts[axis], int(np.prod(self.counts[axis + 1 :]))
            at = np.arange(len(self.q)) // apart % count
            first = np.flatnonzero(at == 0) if period is not None else np.empty(0, np.int64)
            found.append((apart, at[apart:] != 0, first, first + (count - 1) * apart))
        return found

    def minima(self, y: Float64[np.ndarray, " k"]) -> list[tuple[Float64[np.ndarray, " m"], float]]:
        """Where to begin to descend: q, and about how far from y it leads, squared; the closest first.

        Points that are no farther from y than their neighbours along each axis. How far down is left between the points
        is told by a parabola along each axis, in the coordinates scanned; in all of them it is no less.
        """
        points, halves = self._points
        away = halves - points @ y[:SCANNED].astype(np.float32)
        grid = away.reshape(self.counts)
        least = np.ones(away.size, np.bool_)
        for apart, within, first, last in self._neighbours:
            # In memory order: a tenth of the cost of going along each axis. What is beside but not near is left out.
            rising = away[apart:] >= away[:-apart]
            least[:-apart] &= rising | ~within
            least[apart:] &= ~(rising & within)
            seam = away[first] >= away[last]
            least[last] &= seam
            least[first] &= ~seam
        found = np.flatnonzero(least)
        found = found[np.argsort(away[found], kind="stable")[:LOOKED_AT]]
        square = float(y[:SCANNED] @ y[:SCANNED])
        starts = [
            (self.q[i] + step, max(square + 2 * low, 0.0))
            for i in found.tolist()
            for step, low in [self._vertex(grid, i)]
        ]
        return sorted(starts, key=lambda start: start[1])

    def _vertex(self, grid: Float32[np.ndarray, "*n"], index: int) -> tuple[Float64[np.ndarray, " m"], float]:
        """How far off, and how low, parabolas through a point and its neighbours along each axis have their bottom."""
        at = np.unravel_index(index, self.counts)
        middle = bottom = float(grid[at])
        step = np.zeros(len(self.counts))
        for axis, period in enumerate(self.learnt.manifold.periods):
            i, count = int(at[axis]), self.counts[axis]
            if period is None and not 0 < i < count - 1:
                continue
            before, after = (float(grid[(*at[:axis], j % count, *at[axis + 1 :])]) for j in (i - 1, i + 1))
            bend = before + after - 2 * middle
            if bend > 0:
                bottom -= (after - before) ** 2 / (8 * bend)
                step[axis] = self.step[axis] * (before - after) / (2 * bend)
        return step, bottom


@dataclass(frozen=True, eq=False)
class Search:
    """All objects, ready to be searched."""

    parameters: tuple[Parameter, ...]
    universal: Eigenspace
    learnt: tuple[LearntObject, ...]
    resampled: tuple[Resampled, ...]

    @classmethod
    def of(cls, parameters: tuple[Parameter, ...], universal: Eigenspace, learnt: tuple[LearntObject, ...]) -> Search:
        """Resamples each manifold, as densely as POINTS allows."""
        samples = sum(int(np.prod(each.manifold.samples.shape[:-1])) for each in learnt)
        by = min(max((POINTS / samples) ** (1 / len(parameters)), 1.0), DENSEST)
        return cls(parameters, universal, learnt, tuple(Resampled.of(each, by) for each in learnt))

    @cached_property
    def _points(self) -> tuple[Float32[np.ndarray, "n k"], Float32[np.ndarray, " n"], list[int]]:
        """The points of all objects in the universal eigenspace, half the square of each, where each object begins."""
        points: list[np.ndarray] = []
        for each in self.resampled:
            # Both eigenspaces are orthonormal: from one to the other is a small matrix and a shift.
            space = each.learnt.space
            turn = self.universal.basis @ space.basis.T
            points.append(each.learnt.manifold.at(each.q) @ turn.T + self.universal.project(space.mean))
        z = np.concatenate(points).astype(np.float32)
        starts = np.cumsum([0, *(len(each.q) for each in self.resampled[:-1])]).tolist()
        return z, np.einsum("ij,ij->i", z, z) / 2, starts

    def _candidates(self, x: Float32[np.ndarray, " p"]) -> Iterable[Resampled]:
        """Objects that are worth a closer look, the likeliest first."""
        if len(self.resampled) == 1:
            return self.resampled
        z, halves, starts = self._points
        nearest = np.minimum.reduceat(halves - z @ self.universal.project(x), starts)
        return [self.resampled[int(i)] for i in np.argsort(nearest, kind="stable")[:OBJECTS]]

    def locate(self, x: Float32[np.ndarray, " p"]) -> Located:
        """Over everything."""
        found: list[Found] = []
        for each in self._candidates(x):
            z, off = each.learnt.seen(x)
            if all(off < FARTHER * other.squared for other in found):
                found += self._descended(each, z, off)
        return self._told(found)

    def locate_near(
        self, x: Float32[np.ndarray, " p"], name: str, q: Float64[np.ndarray, " m"], reach: Float64[np.ndarray, " m"]
    ) -> Located:
        """Over one object, about q."""
        learnt = self.named(name)
        z, off = learnt.seen(x)
        steps = np.linspace(-1, 1, 5 if len(q) < 3 else 3)
        about = q + reach * np.stack(np.meshgrid(*[steps] * len(q), indexing="ij"), axis=-1).reshape(-1, len(q))
        away = np.square(learnt.white.at(about) - z @ learnt.whiten).sum(axis=1)
        return self._told([_descended(learnt, z, off, about[int(away.argmin())], reach)])

    def named(self, name: str) -> LearntObject:
        """What is known of an object. Raises NumericError where there is no such."""
        for each in self.learnt:
            if each.name == name:
                return each
        names = ", ".join(each.name for each in self.learnt)
        raise NumericError(f"no object {name} in the workspace; allowed are {names}")

    def _descended(self, resampled: Resampled, z: Float64[np.ndarray, " k"], off: float) -> list[Found]:
        """From wherever it may lead to the likeliest place, or to one that is likely, too."""
        found: list[Found] = []
        learnt = resampled.learnt
        for q, promised in resampled.minima(z @ learnt.whiten):
            best = min(found, key=lambda each: each.strays, default=None)
            if best and promised > best.strays + 2 * self._slack(best):
                break
            found.append(_descended(learnt, z, off, q, REACH * learnt.spacing))
            if len(found) == STARTS:
                break
        return found

    def _told(self, found: list[Found]) -> Located:
        nearest = min(found, key=lambda each: each.squared)
        best = min((each for each in found if each.learnt is nearest.learnt), key=lambda each: each.strays)
        rivals = list[Found]()
        for each in sorted(found, key=lambda each: (each.learnt is not best.learnt, each.strays)):
            if each is not best and all(self._apart(each, other) for other in (best, *rivals)):
                rivals.append(each)
        rivals.sort(key=lambda each: each.squared)
        others = tuple(Rival(each.learnt.name, tuple(each.q.tolist()), each.squared**0.5) for each in rivals)
        distance = best.squared**0.5
        alone = len(self.learnt) > 1 and all(
            each.learnt is best.learnt or each.squared > FARTHER * best.squared for each in found
        )
        if distance > best.learnt.limit * (BEYOND if alone else 1.0):
            first = Rival(best.learnt.name, tuple(best.q.tolist()), distance)
            return Located(None, None, None, distance, "unknown", (first, *others))
        unit = self._unit(best)
        doubt = np.sqrt(np.diag(best.covariance) * unit)
        likely = [each for each in rivals if self._likely(best, each)]
        for each in likely:
            if each.learnt is best.learnt:
                doubt = np.maximum(doubt, np.abs(self._difference(each.q, best.q)))
        state = "ambiguous" if likely or (doubt > best.learnt.spacing).any() else "known"
        return Located(best.learnt.name, tuple(best.q.tolist()), tuple(doubt.tolist()), distance, state, others)

    def _unit(self, best: Found) -> float:
        """Variance of the whitened noise in this picture, by what is left of it where it fits best."""
        return max(best.strays / max(best.learnt.white.k - len(self.parameters), 1), QUIET)

    def _slack(self, best: Found) -> float:
        """By how much more a place of the same object may stray and still be the truth.

        Noise of the picture, and that of the samples: were two places alike but for that, the difference of what is
        left at each would have a variance of 4 k.
        """
        return self._unit(best) * (SIGMAS**2 + SIGMAS * best.learnt.white.k**0.5)

    def _likely(self, best: Found, rival: Found) -> bool:
        """Whether the rival may be the truth, and noise made the best fit better."""
        if rival.learnt is best.learnt:
            return rival.strays - best.strays < self._slack(best)
        return rival.squared < min(rival.learnt.limit**2, ALIKE * best.squared)

    def _difference(self, a: Float64[np.ndarray, " m"], b: Float64[np.ndarray, " m"]) -> Float64[np.ndarray, " m"]:
        """The shorter way round where there is a period."""
        apart = a - b
        for i, parameter in enumerate(self.parameters):
            if parameter.period is not None:
                apart[i] = (apart[i] + parameter.period / 2) % parameter.period - parameter.period / 2
        return apart

    def _apart(self, a: Found, b: Found) -> bool:
        near = np.abs(self._difference(a.q, b.q)) < a.learnt.spacing / 4
        return a.learnt is not b.learnt or not near.all()


def _descended(
    learnt: LearntObject, z: Float64[np.ndarray, " k"], off: float, start: Float64[np.ndarray, " m"], reach: np.ndarray
) -> Found:
    y = z @ learnt.whiten
    q, _ = refine(learnt.white, y, start, reach, CLOSE)
    jet = learnt.white.jet(q)
    apart = jet.value - y
    within = apart @ learnt.unwhiten
    covariance = inverse(jet.slopes @ jet.slopes.T)
    return Found(learnt, q, covariance, float(apart @ apart), float(within @ within) + off)
