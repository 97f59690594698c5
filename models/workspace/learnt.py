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
from models.nearest import refine


@dataclass(frozen=True, eq=False)
class LearntObject:
    """What is known of one object."""

    name: str
    space: Eigenspace
    """Of this object's pictures alone."""
    manifold: Manifold
    """Over q, in that eigenspace."""
    strays: Float32[np.ndarray, "n k"]
    """How pictures that were left out lay off the manifold of the others: the noise that q is found in."""
    off: float
    """Squared distance from the eigenspace that its own pictures have."""
    limit: float
    """Distance from the manifold from which on a picture is not of this object."""

    @cached_property
    def spacing(self) -> Float64[np.ndarray, " m"]:
        """From sample to sample, the widest, per parameter."""
        axes = zip(self.manifold.axes, self.manifold.periods, strict=True)
        return np.array([np.diff(axis, append=[] if end is None else axis[0] + end).max() for axis, end in axes])

    @cached_property
    def typical(self) -> float:
        """Squared distance that a picture of this object has, as a rule."""
        within = float(np.median(np.square(self.strays).sum(axis=1))) if len(self.strays) else 0.0
        return max(within + self.off, 1e-9)

    def seen(self, x: Float32[np.ndarray, " p"]) -> tuple[Float64[np.ndarray, " k"], float]:
        """A picture in the eigenspace, and its squared distance from that."""
        z = self.space.project(x)
        return z.astype(np.float64), self.space.distance(x, z) ** 2

    def descend(
        self, z: Float64[np.ndarray, " k"], q: Float64[np.ndarray, " m"], reach: Float64[np.ndarray, " m"]
    ) -> tuple[Float64[np.ndarray, " m"], float]:
        """The closest point of the manifold downhill from q: q, and the squared distance within the eigenspace."""
        found, distance = refine(self.manifold, z, q, reach)
        return found, distance**2

    def errors(self, q: Float64[np.ndarray, " m"]) -> Float64[np.ndarray, "n m"]:
        """By how much each of the strays would move q."""
        slopes = self.manifold.jet(q).slopes
        return self.strays @ np.linalg.pinv(slopes)

    def to_header(self) -> dict[str, Any]:
        """What is not an array."""
        return {"name": self.name, "off": self.off, "limit": self.limit, "manifold": self.manifold.to_header()}

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything else."""
        return {
            **{f"space.{name}": array for name, array in self.space.arrays().items()},
            **{f"manifold.{name}": array for name, array in self.manifold.arrays().items()},
            "strays": self.strays,
        }

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> LearntObject:
        """What `to_header` and `arrays` gave. Raises AppearanceError where they do not make an object."""
        space = Eigenspace.from_arrays(_under("space.", arrays))
        manifold = Manifold.from_parts(header["manifold"], _under("manifold.", arrays))
        strays = arrays["strays"]
        if manifold.k != space.k or strays.ndim != 2 or strays.shape[1] != space.k:
            raise AppearanceError(
                f"object {header['name']}: {space.k} dimensions, manifold {manifold.k}, {strays.shape}"
            )
        return cls(str(header["name"]), space, manifold, strays, float(header["off"]), float(header["limit"]))


def _under(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {key.removeprefix(prefix): value for key, value in arrays.items() if key.startswith(prefix)}


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
