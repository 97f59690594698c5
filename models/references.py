"""The pictures that should be there, as the appearance keeps them, made ready when they are needed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from jaxtyping import Int

from models.errors import AppearanceError
from models.registration import Template, smooth
from models.tolerance import Band, cell_size, levels

_HELD_BYTES = 192 * 2**20


@dataclass(frozen=True, eq=False)
class Reference:
    """One reference picture with what registration and comparison need of it."""

    picture: np.ndarray
    """In grey levels 0..255: (h, w) or (h, w, 3)."""
    template: Template
    excess: np.ndarray | None
    cell: int

    @cached_property
    def band(self) -> Band:
        """What this place may look like."""
        return Band.of(self.picture, self.excess, self.cell)


class References:
    """Reads reference pictures by index; holds the last ones, bounded in bytes.

    One of these belongs to one appearance; reading does not change what it gives.
    """

    def __init__(self, pictures: tuple[bytes, ...], points: Int[np.ndarray, "n m"], excess: tuple[bytes, ...]) -> None:
        self._pictures, self._points, self._excess = pictures, points, excess
        first = self._decoded(0)
        self.size = (first.shape[1], first.shape[0])
        self.colour = first.ndim == 3
        self.cell = cell_size(self.size)
        each = first.nbytes * (3 + 2 * any(excess)) + self._points.shape[1] * 48
        self.get = lru_cache(maxsize=max(4, _HELD_BYTES // each))(self._get)

    def _decoded(self, index: int) -> np.ndarray:
        picture = cv2.imdecode(np.frombuffer(self._pictures[index], np.uint8), cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise AppearanceError(f"reference picture {index} cannot be decoded; allowed are JPEG and PNG")
        return levels(picture)

    def _get(self, index: int) -> Reference:
        picture = self._decoded(index)
        excess = None
        if self._excess and self._excess[index]:
            stacked = cv2.imdecode(np.frombuffer(self._excess[index], np.uint8), cv2.IMREAD_UNCHANGED)
            excess = stacked.reshape(2, *picture.shape)
        return Reference(picture, Template.of(smooth(picture), self._points[index]), excess, self.cell)
