"""Shapes known by their signed distance, so that edges, bevels and sub-pixel shifts come out exact at any scale.

Lengths in px of a 320 wide picture ("units"). A distance is negative inside the shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Protocol

import numpy as np


class Shape(Protocol):
    """Something that can be painted or raised."""

    @property
    def reach(self) -> float:
        """Radius about the origin that holds the shape."""
        ...

    def distance(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Signed distance of points from the outline."""
        ...


@dataclass(frozen=True)
class Disc:
    """A full circle."""

    radius: float

    @property
    def reach(self) -> float:
        """See Shape."""
        return self.radius

    def distance(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """See Shape."""
        return np.hypot(x, y) - np.float32(self.radius)


@dataclass(frozen=True)
class Box:
    """A rectangle with rounded corners; with `corner` of half its height it is a slot."""

    width: float
    height: float
    corner: float = 0.0

    @property
    def reach(self) -> float:
        """See Shape."""
        return hypot(self.width, self.height) / 2

    def distance(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """See Shape."""
        dx = np.abs(x) - np.float32(self.width / 2 - self.corner)
        dy = np.abs(y) - np.float32(self.height / 2 - self.corner)
        outside = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0))
        return outside + np.minimum(np.maximum(dx, dy), 0) - np.float32(self.corner)


@dataclass(frozen=True)
class Hexagon:
    """A regular hexagon by the radius of its inscribed circle, as spanners are named."""

    radius: float

    @property
    def reach(self) -> float:
        """See Shape."""
        return self.radius * 2 / sqrt(3)

    def distance(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """See Shape. The largest distance to a side: exact inside, a little short beyond the corners."""
        ax, ay = np.abs(x), np.abs(y)
        return np.maximum(ax, np.float32(0.5) * ax + np.float32(sqrt(3) / 2) * ay) - np.float32(self.radius)


@dataclass(frozen=True)
class Ring:
    """What lies between two circles."""

    inner: float
    outer: float

    @property
    def reach(self) -> float:
        """See Shape."""
        return self.outer

    def distance(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """See Shape."""
        r = np.hypot(x, y)
        return np.maximum(r - np.float32(self.outer), np.float32(self.inner) - r)
