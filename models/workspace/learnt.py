"""One object of a workspace: its own eigenspace, its manifold in it, and how pictures stray from that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64

from models.eigenspace import Eigenspace
from models.errors import AppearanceError
from models.manifold import Manifold
from models.sealed import under

ASKED = 60
"""Samples by which it is told how exactly an object can be placed."""


@dataclass(frozen=True, eq=False)
class LearntObject:
    """What is known of one object."""

    name: str
    space: Eigenspace
    """Of this object's pictures alone."""
    manifold: Manifold
    """Over q, in that eigenspace."""
    noise: Float64[np.ndarray, "k k"]
    """Covariance of how pictures that were left out lay off the manifold of the others, in that eigenspace."""
    off: float
    """Squared distance from the eigenspace that its own pictures have."""
    limit: float
    """Distance from the manifold from which on a picture is not of this object."""

    @cached_property
    def spacing(self) -> Float64[np.ndarray, " m"]:
        """From sample to sample, the widest, per parameter."""
        axes = zip(self.manifold.axes, self.manifold.periods, strict=True)
        return np.array([np.diff(axis, append=[] if end is None else axis[0] + end).max() for axis, end in axes])

    def seen(self, x: Float32[np.ndarray, " p"]) -> tuple[Float64[np.ndarray, " k"], float]:
        """A picture in the eigenspace, and its squared distance from that."""
        z = self.space.project(x)
        return z.astype(np.float64), self.space.distance(x, z) ** 2

    @cached_property
    def whiten(self) -> Float64[np.ndarray, "k k"]:
        """From z to coordinates in which the noise is 1 everywhere, those that tell most of q first.

        Directions in which pictures stray anyway (how they were cropped, what moves by more than itself from sample to
        sample) count the less: Fisher's discriminant, on a manifold.
        """
        values, axes = np.linalg.eigh(self.noise)
        white = axes / np.sqrt(values)
        flat = self.manifold.samples.reshape(-1, self.manifold.k).astype(np.float64) @ white
        _, turn = np.linalg.eigh(np.cov(flat.T).reshape(len(values), -1))
        return white @ turn[:, ::-1]

    @cached_property
    def white(self) -> Manifold:
        """The manifold in those coordinates."""
        g = self.manifold
        return Manifold(g.axes, g.samples.astype(np.float64) @ self.whiten, g.periods)

    @cached_property
    def unwhiten(self) -> Float64[np.ndarray, "k k"]:
        """The way back."""
        return np.linalg.inv(self.whiten)

    @cached_property
    def expected(self) -> float:
        """Error of q to be expected, in shares of the spacing: the worst parameter's, at the usual sample."""
        places = np.stack(np.meshgrid(*self.manifold.axes, indexing="ij"), axis=-1).reshape(-1, self.manifold.m)
        slopes = [self.white.jet(q).slopes for q in places[:: -(-len(places) // ASKED)]]
        return float(np.median([(np.diag(inverse(each @ each.T)) ** 0.5 / self.spacing).max() for each in slopes]))

    def to_header(self) -> dict[str, Any]:
        """What is not an array."""
        return {"name": self.name, "off": self.off, "limit": self.limit, "manifold": self.manifold.to_header()}

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything else."""
        return {
            **{f"space.{name}": array for name, array in self.space.arrays().items()},
            **{f"manifold.{name}": array for name, array in self.manifold.arrays().items()},
            "noise": self.noise,
        }

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> LearntObject:
        """What `to_header` and `arrays` gave. Raises AppearanceError where they do not make an object."""
        space = Eigenspace.from_arrays(under("space.", arrays))
        manifold = Manifold.from_parts(header["manifold"], under("manifold.", arrays))
        noise = arrays["noise"]
        if manifold.k != space.k or noise.shape != (space.k, space.k):
            raise AppearanceError(
                f"object {header['name']}: {space.k} dimensions, manifold {manifold.k}, {noise.shape}"
            )
        finite = all(np.isfinite(each).all() for each in (header["off"], header["limit"], *arrays.values()))
        if not finite or np.linalg.eigvalsh(noise)[0] <= 0:
            raise AppearanceError(f"object {header['name']}: its numbers cannot be; allowed are finite, noise above 0")
        return cls(str(header["name"]), space, manifold, noise, float(header["off"]), float(header["limit"]))


def left_out(
    samples: Float[np.ndarray, "*r k"], axes: tuple[Float64[np.ndarray, " r"], ...], periods: tuple[float | None, ...]
) -> Float64[np.ndarray, "n k"]:
    """How far each sample lies from the spline through the others along one axis: (n, k), over all axes.

    Ends of an axis without a period are not left out: nothing is known beyond them.
    """
    found: list[Float64[np.ndarray, "n k"]] = []
    for number, (axis, period) in enumerate(zip(axes, periods, strict=True)):
        inner = range(axis.size) if period is not None else range(1, axis.size - 1)
        if axis.size < 3:
            continue
        lines = np.moveaxis(samples, number, 0).astype(np.float64)
        for i in inner:
            others = np.arange(axis.size) != i
            flat = lines[others].reshape(axis.size - 1, -1)
            guess = Manifold.over(axis[others], flat, period).at(float(axis[i])).reshape(lines[i].shape)
            found.append((lines[i] - guess).reshape(-1, samples.shape[-1]))
    return np.concatenate(found) if found else np.zeros((0, samples.shape[-1]))


def shrunk(strays: Float64[np.ndarray, "n k"], floor: float) -> Float64[np.ndarray, "k k"]:
    """Their covariance about 0, drawn towards a ball by what so few can tell, plus `floor` in each direction.

    Oracle approximating shrinkage (Chen, Wiesel, Eldar, Hero, IEEE Trans. Signal Processing 58(10), 2010).
    """
    n, k = strays.shape
    unit = np.eye(k)
    if not n:
        return floor * unit
    found = strays.T @ strays / n
    trace, square = float(np.trace(found)), float(np.square(found).sum())
    ball = square - trace**2 / k
    by = 1.0 if ball <= 0 else min(1.0, ((1 - 2 / k) * square + trace**2) / ((n + 1 - 2 / k) * ball))
    return (1 - by) * found + (by * trace / k + floor) * unit


def inverse(square: Float64[np.ndarray, "m m"]) -> Float64[np.ndarray, "m m"]:
    """Infinite where there is none: a parameter that changes nothing, of which nothing is known."""
    try:
        return np.linalg.inv(square)
    except np.linalg.LinAlgError:
        return np.full_like(square, np.inf)
