"""Manifold: the continuous appearance of a part, a spline through the projected frames over s or several parameters."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import pairwise
from math import factorial
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from jaxtyping import Float, Float64, Int

from models.errors import AppearanceError, LearningError

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline


@dataclass(frozen=True, eq=False)
class Jet:
    """g and how it moves, at one q: what a Newton step needs."""

    value: Float64[np.ndarray, " k"]
    slopes: Float64[np.ndarray, "m k"]
    """First derivatives."""
    bends: Float64[np.ndarray, "m m k"]
    """Second derivatives."""


@dataclass(frozen=True, eq=False)
class Manifold:
    """g(q) (k,): cubic splines through projected frames, over the sweep coordinate s or over m task parameters q.

    The appearance manifold of Nayar, Nene, Murase 1996, section III-B. The samples lie on a grid, the product of m
    axes, each evenly spaced or not, and each with a period or without. One axis: a cubic spline; several: the tensor
    product. An axis of three values gets parabolas, one of two straight lines. Without a period q is held inside its
    axis, as a cubic runs away outside its samples.

    >>> s = np.linspace(0, 1, 5)
    >>> curve = Manifold.over(s, np.stack([s**3, 1 - s], axis=1))
    >>> curve.at(0.3).round(6), curve.derivative(0.3).round(6)
    (array([0.027, 0.7  ]), array([ 0.27, -1.  ]))
    >>> turn = np.arange(0, 360, 45.0)
    >>> circle = Manifold.over(turn, np.stack([np.cos(np.radians(turn)), np.sin(np.radians(turn))], axis=1), period=360)
    >>> circle.at(400).round(3), np.allclose(circle.at(400), circle.at(40))
    (array([0.766, 0.643]), True)
    """

    axes: tuple[Float64[np.ndarray, " r"], ...]
    """Values of each parameter at the samples, increasing; a period's second end is not repeated."""
    samples: Float[np.ndarray, "*r k"]
    """Projected frames on the grid."""
    periods: tuple[float | None, ...]
    """Per axis: after how much the appearance repeats; None where it does not."""

    def __post_init__(self) -> None:
        axes = tuple(np.array(axis, np.float64) for axis in self.axes)
        samples = np.array(self.samples)
        for array in (*axes, samples):
            array.flags.writeable = False
        object.__setattr__(self, "axes", axes)
        object.__setattr__(self, "samples", samples)
        if samples.shape[:-1] != tuple(axis.size for axis in axes) or len(self.periods) != self.m or not self.m:
            counts = [axis.size for axis in axes]
            raise LearningError(f"samples of shape {samples.shape} and {len(self.periods)} periods on axes of {counts}")
        for number, (axis, period) in enumerate(zip(axes, self.periods, strict=True)):
            _check_axis(number, axis, period)

    @classmethod
    def over(
        cls, s: Float[np.ndarray, " r"], samples: Float[np.ndarray, "r k"], period: float | None = None
    ) -> Manifold:
        """The manifold of one parameter."""
        return cls((s,), samples, (period,))

    @property
    def m(self) -> int:
        """Number of parameters."""
        return len(self.axes)

    @property
    def k(self) -> int:
        """Number of dimensions that it lies in."""
        return self.samples.shape[-1]

    def at(self, q: Float[np.ndarray, "*n m"] | float) -> Float64[np.ndarray, "*n k"]:
        """g (k,) at one q (m,), or (n, k) at many (n, m); a number will do for q where m is 1."""
        return self.differentiate(q, (0,) * self.m)

    def derivative(self, q: Float[np.ndarray, "*n m"] | float, axis: int = 0) -> Float64[np.ndarray, "*n k"]:
        """How g changes per unit of the parameter `axis`, at one q (m,) or many (n, m).

        Outside an axis without a period: the slope with which the curve arrives at its end.
        """
        return self.differentiate(q, tuple(int(axis == number) for number in range(self.m)))

    def differentiate(self, q: Float[np.ndarray, "*n m"] | float, orders: Sequence[int]) -> Float64[np.ndarray, "*n k"]:
        """The partial derivative of the given order (0 to 3) along each axis; (0, ..., 0) is g itself."""
        if isinstance(q, float) and self.m == 1:
            return self._point(q, orders[0])
        q = np.atleast_1d(np.asarray(q, np.float64))
        if q.shape[-1] != self.m or q.ndim > 2:
            raise LearningError(f"parameters of shape {q.shape}, allowed are ({self.m},) and (n, {self.m})")
        if self.m > 1:
            return self._spline(self.wrap(q), nu=np.array(orders))
        return self._point(float(q[0]), orders[0]) if q.ndim == 1 else self._curve(self.wrap(q)[:, 0], orders[0])

    def jet(self, q: Float64[np.ndarray, " m"]) -> Jet:
        """g with all first and second derivatives at one q (m,), for a tenth of what asking for each would cost.

        >>> s = np.linspace(0, 1, 5)
        >>> jet = Manifold.over(s, (s**3)[:, None]).jet(np.array([0.5]))
        >>> jet.value.round(6), jet.slopes.round(6), jet.bends.round(6)
        (array([0.125]), array([[0.75]]), array([[[3.]]]))
        """
        products: np.ndarray | None = None
        block: list[slice] = []
        for value, period, (knots, pieces) in zip(q.tolist(), self.periods, self._bases, strict=True):
            first, last = knots[0], knots[-1]
            at = min(max(value, first), last) if period is None else first + (value - first) % period
            piece = min(max(bisect_right(knots, at) - 1, 0), len(knots) - 2)
            t = at - knots[piece]
            powers = np.array(((t * t * t, t * t, t, 1.0), (3 * t * t, 2 * t, 1.0, 0.0), (6 * t, 2.0, 0.0, 0.0)))
            count = len(pieces[piece])
            basis = powers[:, 4 - count :] @ pieces[piece]
            block.append(slice(piece, piece + count))
            products = basis if products is None else _products(products, basis)
        weights = self._weights[tuple(block)].reshape(-1, self.k)
        rows, bends = _orders(self.m)
        found = cast(np.ndarray, products)[rows] @ weights
        return Jet(found[0], found[1 : self.m + 1], found[bends])

    def wrap(self, q: Float64[np.ndarray, "*n m"]) -> Float64[np.ndarray, "*n m"]:
        """The same q, a period counted from the start of its axis, other parameters held inside their axis."""
        columns = [
            np.clip(q[..., i], axis[0], axis[-1]) if period is None else axis[0] + (q[..., i] - axis[0]) % period
            for i, (axis, period) in enumerate(zip(self.axes, self.periods, strict=True))
        ]
        return np.stack(columns, axis=-1)

    def resample(self, counts: int | Sequence[int]) -> tuple[Float64[np.ndarray, "n m"], Float64[np.ndarray, "n k"]]:
        """(q (n, m), g (n, k)) at evenly spaced parameters, last axis fastest.

        Both ends of an axis are included; of a period its start, not its end.
        """
        counts = [counts] * self.m if isinstance(counts, int) else list(counts)
        lines: list[Float64[np.ndarray, " r"]] = [
            np.linspace(axis[0], axis[-1] if period is None else axis[0] + period, count, endpoint=period is None)
            for axis, period, count in zip(self.axes, self.periods, counts, strict=True)
        ]
        q = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, self.m)
        return q, self.at(q)

    def _closed(self, number: int, values: np.ndarray) -> tuple[Float64[np.ndarray, " r"], np.ndarray]:
        """An axis and the values along it, with the second end of a period added."""
        axis, period = self.axes[number], self.periods[number]
        if period is None:
            return axis, values.astype(np.float64)
        first = np.take(values, [0], axis=number)
        return np.append(axis, axis[0] + period), np.concatenate([values, first], axis=number).astype(np.float64)

    @cached_property
    def _pieces(self) -> tuple[list[float], Float64[np.ndarray, "r 4 k"]]:
        """Where the cubics begin (and the last one ends), and their coefficients, highest power first."""
        from scipy.interpolate import CubicSpline  # noqa: PLC0415 (half a second; only where a curve is evaluated)

        axis, values = self._closed(0, self.samples)
        end = "not-a-knot" if self.periods[0] is None else "periodic"
        return axis.tolist(), np.ascontiguousarray(CubicSpline(axis, values, bc_type=end).c.transpose(1, 0, 2))

    def _point(self, s: float, order: int) -> Float64[np.ndarray, " k"]:
        """One point of one parameter, ten times faster than SciPy's call: inspection asks for it frame by frame."""
        knots, pieces = self._pieces
        period = self.periods[0]
        s = min(max(s, knots[0]), knots[-1]) if period is None else knots[0] + (s - knots[0]) % period
        piece = min(max(bisect_right(knots, s) - 1, 0), len(knots) - 2)
        t = s - knots[piece]
        weights = (
            (t * t * t, t * t, t, 1.0),
            (3 * t * t, 2 * t, 1.0, 0.0),
            (6 * t, 2.0, 0.0, 0.0),
            (6.0, 0.0, 0.0, 0.0),
        )
        return np.array(weights[order]) @ pieces[piece]

    def _curve(self, s: Float64[np.ndarray, " n"], order: int) -> Float64[np.ndarray, "n k"]:
        knots, pieces = self._pieces
        piece = np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(knots) - 2)
        step = (s - np.array(knots)[piece])[:, None]
        value = np.zeros((s.size, self.k))
        for power in range(3, order - 1, -1):
            factor = np.prod(np.arange(power - order + 1, power + 1))
            value = value * step + factor * pieces[piece, 3 - power]
        return value

    @cached_property
    def _spline(self) -> NdBSpline:
        from scipy.interpolate import NdBSpline  # noqa: PLC0415

        knots, degrees, weights = self._tensor
        return NdBSpline(tuple(knots), weights, tuple(degrees))

    @property
    def _weights(self) -> Float64[np.ndarray, "*c k"]:
        return self._tensor[2]

    @cached_property
    def _bases(self) -> list[tuple[list[float], Float64[np.ndarray, "r d d"]]]:
        """Per axis: where the pieces begin (and the last one ends), and the B-splines not zero there as polynomials."""
        from scipy.interpolate import BSpline  # noqa: PLC0415

        found: list[tuple[list[float], np.ndarray]] = []
        for knots, degree in zip(*self._tensor[:2], strict=True):
            count = knots.size - degree - 1
            starts, splines = knots[degree:count], BSpline(knots, np.eye(count), degree)
            powers = np.stack([splines(starts, nu=power) / factorial(power) for power in range(degree, -1, -1)])
            pieces = [powers[:, piece, piece : piece + degree + 1] for piece in range(count - degree)]
            found.append((knots[degree : count + 1].tolist(), np.stack(pieces)))
        return found

    @cached_property
    def _tensor(self) -> tuple[list[np.ndarray], list[int], np.ndarray]:
        """Knots and degree of each axis, and the weights (*c, k) of the tensor-product B-splines."""
        from scipy.interpolate import make_interp_spline  # noqa: PLC0415

        knots: list[np.ndarray] = []
        degrees: list[int] = []
        weights: np.ndarray = self.samples
        for number, period in enumerate(self.periods):
            axis, values = self._closed(number, weights)
            degree = min(3, axis.size - 1) if period is None else 3
            end = None if period is None else "periodic"
            spline = make_interp_spline(axis, values, k=degree, axis=number, bc_type=end)
            # BSpline keeps the interpolation axis first.
            weights = np.moveaxis(spline.c, 0, number)
            knots.append(spline.t)
            degrees.append(degree)
        return knots, degrees, np.ascontiguousarray(weights, np.float64)

    def to_header(self) -> dict[str, Any]:
        """What is not an array."""
        return {"periods": list(self.periods)}

    def arrays(self) -> dict[str, np.ndarray]:
        """Samples, and each axis as `axis0`, `axis1`, ..."""
        return {"samples": self.samples} | {f"axis{i}": axis for i, axis in enumerate(self.axes)}

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Manifold:
        """What `to_header` and `arrays` gave. Raises AppearanceError where they do not make a manifold."""
        try:
            periods = tuple(None if period is None else float(period) for period in header["periods"])
            axes = tuple(arrays[f"axis{i}"] for i in range(len(periods)))
            return cls(axes, arrays["samples"], periods)
        except (KeyError, TypeError, ValueError, LearningError) as error:
            raise AppearanceError(f"the manifold in the file cannot be used: {error}") from error


def _products(a: Float64[np.ndarray, "o w"], b: Float64[np.ndarray, "3 d"]) -> Float64[np.ndarray, "o*3 w*d"]:
    return (a[:, None, :, None] * b[:, None, :]).reshape(len(a) * len(b), -1)


@cache
def _orders(m: int) -> tuple[Int[np.ndarray, " o"], Int[np.ndarray, "m m"]]:
    """Which of all 3**m products of derivatives a jet has: value, slopes, second ones; where these are in it."""
    unit = np.eye(m, dtype=int)
    pairs = [(i, j) for i in range(m) for j in range(i, m)]
    wanted = np.array([0 * unit[0], *unit, *(unit[i] + unit[j] for i, j in pairs)])
    bends = [[1 + m + pairs.index((min(i, j), max(i, j))) for j in range(m)] for i in range(m)]
    return wanted @ 3 ** np.arange(m - 1, -1, -1), np.array(bends)


def _check_axis(number: int, axis: Float64[np.ndarray, " r"], period: float | None) -> None:
    if axis.ndim != 1 or axis.size < 2 or not np.isfinite(axis).all():
        raise LearningError(f"axis {number} has shape {axis.shape}, allowed are two or more finite values")
    for i, (before, after) in enumerate(pairwise(axis.tolist()), start=1):
        if after <= before:
            raise LearningError(f"axis {number} is {before} and then {after} at index {i}: must increase")
    if period is not None and not period > axis[-1] - axis[0]:
        raise LearningError(f"axis {number} spans {axis[-1] - axis[0]}, its period is {period}: must be longer")
