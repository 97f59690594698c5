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
_DEPTHS = np.dtype(np.uint8), np.dtype(np.uint16)


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
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        picture = None
    if picture is None or picture.dtype not in _DEPTHS or picture.shape[2:] not in ((), (3,)):
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
        kept = unpack(self._pictures[index])
        if kind_of(kept) != self.kind:
            raise AppearanceError(f"reference picture {index} is {kind_of(kept)}, the first one is {self.kind}")
        picture = levels(kept)
        excess = self.excess(index) if self._excess[index] else None
        try:
            template = Template.of(smooth(picture), self._points[index])
        except np.linalg.LinAlgError as error:
            raise AppearanceError(f"the points of reference picture {index} cannot tell shift from light") from error
        return Reference(picture, template, Band.of(picture, excess, self.cell), self.cell)

    def excess(self, index: int) -> UInt8[np.ndarray, "2 h w *c"]:
        """What golden sweeps showed beyond the band of a place, bright and dark, in grey levels."""
        if not self._excess[index]:
            return np.zeros((2, *self.shape), np.uint8)
        kept = unpack(self._excess[index])
        h, *rest = self.shape
        if kept.shape != (2 * h, *rest) or kept.dtype != np.uint8:
            raise AppearanceError(f"the tolerance of place {index} is {kind_of(kept)}, its picture is {self.kind}")
        return kept.reshape(2, *self.shape)
