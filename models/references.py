"""The pictures that should be there, as the appearance keeps them, made ready when they are needed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Int, UInt8

from models.errors import AppearanceError
from models.frame import kind_of
from models.registration import Template, smooth
from models.tolerance import Band, cell_size, levels

_HELD_BYTES = 192 * 2**20


@dataclass(frozen=True, eq=False)
class Reference:
    """One reference picture with what registration and comparison need of it."""

    picture: np.ndarray
    """In grey levels 0..255: (h, w) or (h, w, 3)."""
    template: Template
    band: Band
    """What this place may look like."""
    cell: int


def unpack(data: bytes) -> np.ndarray:
    """The pixels of a picture that an appearance keeps, JPEG or PNG: (h, w) or (h, w, 3), uint8 or uint16."""
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if picture is None:
        raise AppearanceError(f"a picture of {len(data)} bytes cannot be decoded; allowed are JPEG and PNG")
    return picture


class References:
    """Reads reference pictures by index; holds the last ones, bounded in bytes.

    One of these belongs to one appearance; reading does not change what it gives.
    """

    def __init__(self, pictures: tuple[bytes, ...], points: Int[np.ndarray, "n m"], excess: tuple[bytes, ...]) -> None:
        self._pictures, self._points, self._excess = pictures, points, excess
        first = unpack(pictures[0])
        self.size = (first.shape[1], first.shape[0])
        self.template_size = smooth(levels(first)).shape[::-1]
        self.kind, self.shape = kind_of(first), first.shape
        self.cell = cell_size(self.size)
        # the picture and both ends of its band, and what golden sweeps showed beyond it
        each = levels(first).nbytes * (3 + 2 * any(excess)) + self._points.shape[1] * 48
        self.get = lru_cache(maxsize=max(4, _HELD_BYTES // each))(self._get)

    def _get(self, index: int) -> Reference:
        picture = levels(unpack(self._pictures[index]))
        excess = self.excess(index) if self._excess[index] else None
        template = Template.of(smooth(picture), self._points[index])
        return Reference(picture, template, Band.of(picture, excess, self.cell), self.cell)

    def excess(self, index: int) -> UInt8[np.ndarray, "2 h w *c"]:
        """What golden sweeps showed beyond the band of a place, bright and dark, in grey levels."""
        if not self._excess[index]:
            return np.zeros((2, *self.shape), np.uint8)
        return unpack(self._excess[index]).reshape(2, *self.shape)
