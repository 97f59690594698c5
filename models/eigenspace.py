"""Eigenspace: mean and orthonormal basis of the frames as vectors, and the distance from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from models.errors import AppearanceError, LearningError
from models.principal import Choice, principal_directions

UNTHREADED = 400_000
"""Larger matrices OpenBLAS shares out among threads, after which last bits depend on how many there are."""


@dataclass(frozen=True, eq=False)
class Eigenspace:
    """Where frames lie: x is near mean + basis.T @ z, with z = basis @ (x - mean) of a few dimensions.

    Leading eigenvectors of the covariance of the frames (Nayar, Nene, Murase 1996, section III-A; Murakami and Kumar
    1982 for the Gram matrix). Unlike there, the basis also comes from frames that do not fit in memory.

    >>> frames = np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0], [2, 0, 1]], np.float32)
    >>> space = fit_eigenspace(frames, k=1)
    >>> abs(space.basis.round(3)), space.eigenvalues.round(4), round(space.energy, 4)
    (array([[1., 0., 0.]], dtype=float32), array([2.]), 0.9143)
    >>> z = space.project(np.array([3, 0, 5], np.float32))
    >>> z, round(space.distance(np.array([3, 0, 5], np.float32), z), 4)
    (array([1.], dtype=float32), 4.75)
    """

    mean: Float32[np.ndarray, " p"]
    basis: Float32[np.ndarray, "k p"]
    """Orthonormal rows, leading first; the component of largest magnitude of each is positive."""
    eigenvalues: Float64[np.ndarray, " k"]
    """Mean square of each coordinate over the frames learnt from, descending; in squared units of x."""
    total_variance: float
    """Mean squared distance of the frames from their mean: what all p eigenvalues together would sum to."""

    def __post_init__(self) -> None:
        for name, kind in (("mean", np.float32), ("basis", np.float32), ("eigenvalues", np.float64)):
            array = np.array(getattr(self, name), kind, order="C")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        k, p = self.basis.shape
        if self.mean.shape != (p,) or self.eigenvalues.shape != (k,):
            shapes = f"mean {self.mean.shape}, basis {self.basis.shape}, eigenvalues {self.eigenvalues.shape}"
            raise AppearanceError(f"eigenspace of {shapes}, allowed are (p,), (k, p), (k,)")

    @property
    def k(self) -> int:
        """Number of dimensions."""
        return self.basis.shape[0]

    @property
    def p(self) -> int:
        """Length of x."""
        return self.basis.shape[1]

    @property
    def energy(self) -> float:
        """Share of the variance of the frames learnt from that the k dimensions hold, in [0, 1]."""
        return min(1.0, float(self.eigenvalues.sum()) / self.total_variance)

    @cached_property
    def _offset(self) -> Float32[np.ndarray, " k"]:
        return (self.basis.astype(np.float64) @ self.mean.astype(np.float64)).astype(np.float32)

    def project(self, x: Float32[np.ndarray, " p"]) -> Float32[np.ndarray, " k"]:
        """z (k,) = basis @ (x - mean). Scoring projects with this and nothing else; equal bytes by any thread count."""
        step = max(1, UNTHREADED // self.k)
        z = self.basis[:, :step] @ x[:step]
        for start in range(step, self.p, step):
            z += self.basis[:, start : start + step] @ x[start : start + step]
        return z - self._offset

    def project_many(self, xs: Float32[np.ndarray, "n p"]) -> Float32[np.ndarray, "n k"]:
        """z of many frames at once; differs from `project` in the last bits, as BLAS sums in another order."""
        return xs @ self.basis.T - self._offset

    def reconstruct(self, z: Float32[np.ndarray, " k"]) -> Float32[np.ndarray, " p"]:
        """The point of the eigenspace at z, as x (p,)."""
        return self.mean + z @ self.basis

    def distance(self, x: Float32[np.ndarray, " p"], z: Float32[np.ndarray, " k"]) -> float:
        """Distance of x from the eigenspace, z being its projection: by Pythagoras, without reconstructing.

        Below some 3e-4 of ||x - mean|| rounding to float32 decides.
        """
        from_mean, along = cv2.norm((x - self.mean).reshape(1, -1)), cv2.norm(z.reshape(1, -1))
        return float(np.sqrt(max(0.0, from_mean**2 - along**2)))

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything, as arrays that can be saved."""
        total = np.array([self.total_variance])
        return {"mean": self.mean, "basis": self.basis, "eigenvalues": self.eigenvalues, "total_variance": total}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Eigenspace:
        """What `arrays` gave. Raises AppearanceError where the arrays do not make an eigenspace."""
        try:
            mean, basis, eigenvalues = (arrays[name] for name in ("mean", "basis", "eigenvalues"))
            return cls(mean, basis, eigenvalues, float(arrays["total_variance"][0]))
        except (KeyError, ValueError, IndexError, TypeError) as error:
            raise AppearanceError(f"the eigenspace in the file cannot be used: {error}") from error


Frames = Iterable[Float32[np.ndarray, " p"]]


def fit_eigenspace(
    xs: Frames | Callable[[], Frames],
    *,
    k: int | None = None,
    energy: float | None = 0.95,
    k_max: int = 64,
    memory: int = 256 * 2**20,
) -> Eigenspace:
    """The eigenspace of frames x (p,) that need not fit in memory.

    `xs` can be read more than once: an array (n, p), a list, or a function that opens the frames anew; more than
    `memory` bytes of them are never held. `k` fixes the dimensions; without it they are the fewest that hold the share
    `energy` of the variance, `k_max` at most. Fewer come where the frames span fewer. Deterministic.

    Up to 2048 frames within `memory` the result is exact (Gram matrix in float64); beyond, block Krylov iteration reads
    the frames about five times; see `models.principal` for what it promises.

    Raises LearningError where the frames span nothing: fewer than two, or all alike.
    """
    if k is not None and k < 1:
        raise LearningError(f"an eigenspace of {k} dimensions, allowed is at least 1")
    if k is None and not (energy is not None and 0 < energy <= 1):
        raise LearningError(f"share of the variance to hold is {energy}, allowed are 0 < energy <= 1")
    found = principal_directions(
        xs if callable(xs) else lambda: xs, Choice(k, energy or 1.0, k_max if k is None else k), memory
    )
    return Eigenspace(found.mean.astype(np.float32), found.rows.astype(np.float32), found.values, found.total)
