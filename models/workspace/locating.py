"""The closest manifold point over all objects and their whole q boxes: coarse search, then Newton on the spline."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float32, Float64

from models.eigenspace import Eigenspace
from models.errors import NumericError
from models.workspace.grid import Parameter
from models.workspace.learnt import LearntObject
from models.workspace.located import Located, Rival

POINTS = 16_000
"""Resampled points of all objects, about."""
DENSEST = 4
"""Resampled points per sample and parameter at most."""
OBJECTS = 5
"""How many objects are looked at closely."""
STARTS = 4
"""From how many places of each."""
_SIGMAS = 2.0
"""A rival that noise makes this likely is told."""


@dataclass(frozen=True, eq=False)
class Found:
    """A minimum of the distance: its object, q, and squared distance in all."""

    learnt: LearntObject
    q: Float64[np.ndarray, " m"]
    squared: float


@dataclass(frozen=True, eq=False)
class Coarse:
    """The resampled manifold of one object in the universal eigenspace."""

    q: Float64[np.ndarray, "n m"]
    counts: tuple[int, ...]
    start: int
    """Where its points begin among those of all objects."""

    def minima(self, away: Float[np.ndarray, " n"], periods: Sequence[float | None]) -> list[int]:
        """Points that are no farther than their neighbours along each axis, the closest first."""
        grid = away.reshape(self.counts)
        least = np.ones(self.counts, np.bool_)
        for axis, period in enumerate(periods):
            if period is None:
                ends = [(0, 0)] * grid.ndim
                ends[axis] = (1, 1)
                padded = np.moveaxis(np.pad(grid, ends, constant_values=np.inf), axis, 0)
                near = np.minimum(padded[:-2], padded[2:])
            else:
                near = np.moveaxis(np.minimum(np.roll(grid, 1, axis), np.roll(grid, -1, axis)), axis, 0)
            least &= grid <= np.moveaxis(near, 0, axis)
        found = np.flatnonzero(least)
        return sorted((int(i) for i in found), key=lambda i: float(away[i]))


@dataclass(frozen=True, eq=False)
class Search:
    """All objects, ready to be searched."""

    parameters: tuple[Parameter, ...]
    universal: Eigenspace
    learnt: tuple[LearntObject, ...]
    coarse: tuple[Coarse, ...]
    z: Float32[np.ndarray, "n k"]
    """The resampled points of all objects in the universal eigenspace."""

    @classmethod
    def of(cls, parameters: tuple[Parameter, ...], universal: Eigenspace, learnt: tuple[LearntObject, ...]) -> Search:
        """Resamples each manifold, as densely as POINTS allows."""
        samples = sum(int(np.prod(each.manifold.samples.shape[:-1])) for each in learnt)
        by = min(max((POINTS / samples) ** (1 / len(parameters)), 1.0), DENSEST)
        coarse: list[Coarse] = []
        points: list[np.ndarray] = []
        for each in learnt:
            g = each.manifold
            ends = [period is None for period in g.periods]
            counts = tuple(round((axis.size - end) * by) + end for axis, end in zip(g.axes, ends, strict=True))
            q, z = g.resample(counts)
            # Both eigenspaces are orthonormal: from one to the other is a small matrix and a shift.
            turn = universal.basis @ each.space.basis.T
            points.append(z @ turn.T + universal.project(each.space.mean))
            coarse.append(Coarse(q, counts, sum(len(other.q) for other in coarse)))
        return cls(parameters, universal, learnt, tuple(coarse), np.concatenate(points).astype(np.float32))

    @cached_property
    def _halves(self) -> Float32[np.ndarray, " n"]:
        return np.einsum("ij,ij->i", self.z, self.z) / 2

    def locate(self, x: Float32[np.ndarray, " p"]) -> Located:
        """Over everything."""
        away = self._halves - self.z @ self.universal.project(x)
        nearest = [float(away[each.start : each.start + len(each.q)].min()) for each in self.coarse]
        found: list[Found] = []
        for number in sorted(range(len(nearest)), key=nearest.__getitem__)[:OBJECTS]:
            coarse, learnt = self.coarse[number], self.learnt[number]
            mine = away[coarse.start : coarse.start + len(coarse.q)]
            starts = coarse.minima(mine, learnt.manifold.periods)[:STARTS]
            found += self._descended(x, learnt, [coarse.q[i] for i in starts], learnt.spacing)
        return self._told(found)

    def locate_near(
        self, x: Float32[np.ndarray, " p"], name: str, q: Float64[np.ndarray, " m"], reach: Float64[np.ndarray, " m"]
    ) -> Located:
        """Over one object, about q."""
        learnt = self.named(name)
        z, _ = learnt.seen(x)
        steps = np.linspace(-1, 1, 5 if len(q) < 3 else 3)
        about = q + reach * np.stack(np.meshgrid(*[steps] * len(q), indexing="ij"), axis=-1).reshape(-1, len(q))
        away = np.square(learnt.manifold.at(about) - z).sum(axis=1)
        return self._told(self._descended(x, learnt, [about[int(away.argmin())]], reach))

    def named(self, name: str) -> LearntObject:
        """What is known of an object. Raises NumericError where there is no such."""
        for each in self.learnt:
            if each.name == name:
                return each
        names = ", ".join(each.name for each in self.learnt)
        raise NumericError(f"no object {name} in the workspace; allowed are {names}")

    @staticmethod
    def _descended(
        x: Float32[np.ndarray, " p"], learnt: LearntObject, starts: Iterable[np.ndarray], reach: np.ndarray
    ) -> list[Found]:
        z, off = learnt.seen(x)
        ends = [learnt.descend(z, q, reach) for q in starts]
        return [Found(learnt, q, squared + off) for q, squared in ends]

    def _told(self, found: list[Found]) -> Located:
        found = sorted(found, key=lambda each: each.squared)
        best, rivals = found[0], list[Found]()
        for each in found[1:]:
            if all(self._apart(each, other) for other in (best, *rivals)):
                rivals.append(each)
        others = tuple(Rival(each.learnt.name, tuple(each.q.tolist()), each.squared**0.5) for each in rivals)
        distance = best.squared**0.5
        if distance > best.learnt.limit:
            first = Rival(best.learnt.name, tuple(best.q.tolist()), distance)
            return Located(None, None, None, distance, "unknown", (first, *others))
        likely = [each for each in rivals if _likely(best, each)]
        errors = best.learnt.errors(best.q)
        doubt = np.sqrt(np.square(errors).mean(axis=0)) if len(errors) else best.learnt.spacing
        doubt = doubt * max(1.0, (best.squared / best.learnt.typical) ** 0.5)
        for each in likely:
            if each.learnt is best.learnt:
                doubt = np.maximum(doubt, np.abs(self._difference(each.q, best.q)))
        state = "ambiguous" if likely else "known"
        q, uncertainty = tuple(best.q.tolist()), tuple(doubt.tolist())
        return Located(best.learnt.name, q, uncertainty, distance, state, others)

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


def _likely(best: Found, rival: Found) -> bool:
    """Whether the rival may be the truth, and noise made the best fit better."""
    more = rival.squared - best.squared
    if rival.learnt is not best.learnt:
        return rival.squared <= rival.learnt.limit**2 and more < best.learnt.typical
    step = best.learnt.manifold.at(best.q) - rival.learnt.manifold.at(rival.q)
    noise = np.square(best.learnt.strays @ step).mean() ** 0.5 if len(best.learnt.strays) else 0.0
    return float(more + step @ step) < 2 * _SIGMAS * float(noise)
