"""The pictures that should be there, as the appearance keeps them, made ready when they are needed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Int, UInt, UInt8

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
    """Reads reference pictures by their place; holds the last ones, bounded in bytes.

    One of these belongs to one appearance; reading does not change what it gives.
    """

    def __init__(
        self,
        pictures: tuple[bytes, ...],
        points: UInt[np.ndarray, "m p"],
        excess: tuple[bytes, ...],
        keys: Int[np.ndarray, " m"] | None = None,
    ) -> None:
        """`keys` are the places of the pictures; without them they are counted from 0."""
        self._pictures, self._points, self._excess = pictures, points, excess
        self._index = {int(place): i for i, place in enumerate(range(len(pictures)) if keys is None else keys)}
        first = unpack(pictures[0])
        self.size = (first.shape[1], first.shape[0])
        self.template_size = smooth(levels(first)).shape[::-1]
        self.kind, self.shape = kind_of(first), first.shape
        self.cell = cell_size(self.size)
        # the picture and both ends of its band, and what golden sweeps showed beyond it
        each = levels(first).nbytes * (3 + 2 * any(excess)) + self._points.shape[1] * 48
        self.get = lru_cache(maxsize=max(4, _HELD_BYTES // each))(self._get)

    def _get(self, place: int) -> Reference:
        index = self._index[place]
        kept = unpack(self._pictures[index])
        if kind_of(kept) != self.kind:
            raise AppearanceError(
                f"the reference picture of place {place} is {kind_of(kept)}, the first one is {self.kind}"
            )
        picture = levels(kept)
        excess = self.excess(place) if self._excess[index] else None
        try:
            template = Template.of(smooth(picture), self._points[index])
        except np.linalg.LinAlgError as error:
            raise AppearanceError(f"the points of place {place} cannot tell shift from light") from error
        return Reference(picture, template, Band.of(picture, excess, self.cell), self.cell)

    def excess(self, place: int) -> UInt8[np.ndarray, "2 h w *c"]:
        """What golden sweeps showed beyond the band of a place, bright and dark, in grey levels."""
        index = self._index[place]
        if not self._excess[index]:
            return np.zeros((2, *self.shape), np.uint8)
        kept = unpack(self._excess[index])
        h, *rest = self.shape
        if kept.shape != (2 * h, *rest) or kept.dtype != np.uint8:
            raise AppearanceError(f"the tolerance of place {place} is {kind_of(kept)}, its picture is {self.kind}")
        return kept.reshape(2, *self.shape)
