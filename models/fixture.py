"""Place, pace and fixture offset carried from frame to frame: what registration measures, filtered."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from math import hypot, sqrt

import cv2
import numpy as np
from jaxtyping import Float, Int

AT, PACE, OFFSET = 0, 1, slice(2, 5)
_AT_STD, _PACE_STD, _OFFSET_STD = 2.0, 0.25, np.array([3.0, 3.0, 0.01])
_WANDER = np.diag(np.square([0.15, 0.10, 0.12, 0.12, 0.0003]))
"""What may change from one frame to the next: place, pace, fixture offset (px, px, rad)."""
_SAME = np.eye(5)
_STILL_STD = 0.5
_ALONG_STD = 8.0


@dataclass(frozen=True, eq=False)
class Path:
    """How the picture moves along the reference sweep: a polyline of picture displacement over places.

    >>> path = Path(np.full((6, 2), (-4.0, 0.0)), np.array([0, 2, 5]))
    >>> [path.key(at) for at in (0.0, 0.9, 1.1, 3.4, 3.6)]
    [0, 0, 2, 2, 5]
    """

    motion: Float[np.ndarray, "n 2"]
    """From each place to the next, in pixels."""
    keys: Int[np.ndarray, " m"] | None = None
    """Places whose pictures are kept, increasing; None for all."""

    @cached_property
    def points(self) -> Float[np.ndarray, "n 2"]:
        """Displacement of the picture at each place from the first, in pixels."""
        return np.vstack([np.zeros(2), np.cumsum(self.motion[:-1], axis=0)])

    @cached_property
    def _keys(self) -> list[int]:
        return list(range(len(self.motion))) if self.keys is None else [int(key) for key in self.keys]

    def key(self, at: float) -> int:
        """The place with a picture that is nearest to `at` by travel, and where nothing moves, by number."""
        i = bisect_right(self._keys, at)
        if i in (0, len(self._keys)):
            return self._keys[max(i - 1, 0)]
        before, after = self._keys[i - 1], self._keys[i]
        since, left = hypot(*self.way(before, at)), hypot(*self.way(at, after))
        nearer = since < left if since != left else at - before < after - at
        return before if nearer else after

    def between(self, start: float, end: float) -> Float[np.ndarray, " 2"]:
        """Displacement of the picture from one place to another, in pixels."""
        return np.array(self.way(start, end))

    def way(self, start: float, end: float) -> tuple[float, float]:
        """The same as two numbers."""
        (x, y), (u, v) = self._at(start), self._at(end)
        return u - x, v - y

    def at(self, place: float) -> Float[np.ndarray, " 2"]:
        """Displacement of the picture from the first place, in pixels; held at the ends."""
        return np.array(self._at(place))

    def _at(self, place: float) -> tuple[float, float]:
        i = min(max(int(place), 0), len(self._listed) - 2)
        fraction = min(max(place - i, 0.0), 1.0)
        (x, y), (u, v) = self._listed[i], self._listed[i + 1]
        return x + fraction * (u - x), y + fraction * (v - y)

    @cached_property
    def _listed(self) -> list[list[float]]:
        """The points as Python's own numbers: ten times as fast one by one."""
        return self.points.tolist()

    def along(self, places: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 2"]:
        """The same for many places."""
        i = np.clip(places.astype(int), 0, len(self.points) - 2)
        fraction = np.clip(places - i, 0.0, 1.0)[:, None]
        return self.points[i] * (1.0 - fraction) + self.points[i + 1] * fraction

    def speed(self, at: float) -> Float[np.ndarray, " 2"]:
        """Displacement per place about `at`."""
        return self.motion[min(max(int(at), 0), len(self.motion) - 2)]


@dataclass(frozen=True, eq=False)
class Fixture:
    """A Gaussian over (place, pace, offset x, offset y, rotation)."""

    mean: Float[np.ndarray, " 5"]
    covariance: Float[np.ndarray, "5 5"]

    @classmethod
    def unknown(cls, at: float, pace: float = 1.0, offset: np.ndarray | None = None) -> Fixture:
        """Nothing measured yet but a rough place."""
        mean = np.concatenate([[at, pace], np.zeros(3) if offset is None else offset])
        return cls(mean, np.diag(np.square(np.concatenate([[_AT_STD, _PACE_STD], _OFFSET_STD]))))

    @property
    def at(self) -> float:
        """The place, in reference frames."""
        return float(self.mean[AT])

    def seen(self, path: Path) -> float:
        """The place that the picture shows: an offset along the path looks like travel, and cannot be told from it."""
        at, _, x, y, _ = self.mean.tolist()
        u, v = path.speed(at).tolist()
        return at + (u * x + v * y) / max(u * u + v * v, 1.0)

    @property
    def offset(self) -> Float[np.ndarray, " 3"]:
        """Shift in pixels and rotation of the part in its fixture, as the picture shows it."""
        return self.mean[OFFSET]

    @property
    def uncertainty(self) -> float:
        """Standard deviation of the place, in reference frames."""
        return sqrt(float(self.covariance[AT, AT]))

    def predict(self, elapsed: float, path: Path) -> Fixture:
        """`elapsed` nominal frame intervals later: the place moves on; a rotation turns travel into offset."""
        at, pace, x, y, turn = self.mean.tolist()
        then = min(max(at + elapsed * pace, -1.0), float(len(path.motion)))
        dx, dy = path.way(at, then)
        covariance = self.covariance + _WANDER * max(elapsed, 0.1)
        covariance[AT] += elapsed * self.covariance[PACE]
        covariance[:, AT] += elapsed * self.covariance[:, PACE]
        covariance[AT, AT] += elapsed**2 * self.covariance[PACE, PACE]
        return Fixture(np.array([then, pace, x + turn * dy, y - turn * dx, turn]), covariance)

    def halted(self) -> Fixture:
        """The same moment if the robot had not moved since the frame before."""
        cov = self.covariance + _WANDER
        cov[AT, AT] += _STILL_STD**2
        return Fixture(self.mean, cov)

    def _as_pose(self, reference: int, path: Path) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 5"]]:
        """Where a picture lies on `reference`: displacement along the path, turned, + offset; and its slopes."""
        at, _, x, y, turn = self.mean.tolist()
        (sx, sy), (dx, dy) = path.speed(at).tolist(), path.way(reference, at)
        slopes = np.array([[sx, 0, 1, 0, -dy], [sy, 0, 0, 1, dx], [0, 0, 0, 0, 1]])
        return np.array([x + dx - turn * dy, y + dy + turn * dx, turn]), slopes

    def pose(self, reference: int, path: Path) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
        """Where a picture would lie on `reference`, with its covariance."""
        expected, h = self._as_pose(reference, path)
        return expected, h @ self.covariance @ h.T

    def measure(self, reference: int, pose: np.ndarray, noise: np.ndarray, path: Path) -> Fixture:
        """What a registration to `reference` says."""
        expected, h = self._as_pose(reference, path)
        seen = h @ self.covariance
        gain = cv2.solve(seen @ h.T + noise, seen)[1].T
        mean = self.mean + gain @ (pose - expected)
        mean[PACE] = min(max(float(mean[PACE]), 0.0), 4.0)
        keep = _SAME - gain @ h
        return Fixture(mean, keep @ self.covariance @ keep.T + gain @ noise @ gain.T)

    def settled(self, path: Path) -> Fixture:
        """Pull the offset along the path, which no picture can tell from travel, gently to nothing."""
        at, _, x, y, _ = self.mean.tolist()
        u, v = path.speed(at).tolist()
        length = sqrt(u * u + v * v)
        if length < 0.5:
            return self
        u, v = u / length, v / length
        ph = u * self.covariance[2] + v * self.covariance[3]
        gain = ph / (u * float(ph[2]) + v * float(ph[3]) + _ALONG_STD**2)
        return Fixture(self.mean - gain * (u * x + v * y), self.covariance - gain[:, None] * ph)
