"""The pictures that should be there, as the appearance keeps them, made ready when they are needed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int, UInt

from models.errors import AppearanceError
from models.frame import kind_of
from models.ignored import Ignored
from models.limits import Limits
from models.registration import Template, smooth
from models.spread import ALL, unpack_cells
from models.tolerance import Band, Coarse, cell_size, levels

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
    coarse: Coarse | None
    """The same at a coarser scale, where golden sweeps have told what to expect of that."""
    thresholds: tuple[Float[np.ndarray, "rows cols"], ...]
    """Evidence at the assumed limit, per scale, in grey levels."""
    allowed: Float32[np.ndarray, "rows cols c"] | None
    """How far the limits lie above the assumed ones by what golden sweeps showed, bright and dark of each scale."""
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
        limits: tuple[Limits, ...],
        tolerance: tuple[bytes, ...],
        keys: Int[np.ndarray, " m"] | None = None,
        *,
        ignored: Ignored | None = None,
    ) -> None:
        """`limits` are those of each scale; `keys` the places of the pictures, without them counted from 0."""
        self._pictures, self._points, self._limits, self._tolerance = pictures, points, limits, tolerance
        self._index = {int(place): i for i, place in enumerate(range(len(pictures)) if keys is None else keys)}
        self._ignored = ignored or Ignored.of(None)
        first = unpack(pictures[0])
        self.size = (first.shape[1], first.shape[0])
        self.template_size = smooth(levels(first)).shape[::-1]
        self.kind = kind_of(first)
        self.cell = cell_size(self.size)
        self.cells = (-(-first.shape[0] // self.cell), -(-first.shape[1] // self.cell), 2 * len(limits))
        # the picture and both ends of its band; the points; the coarse band and maps of cells
        each = levels(first).nbytes * (3 + (len(limits) - 1) // 2) + self._points.shape[1] * 48
        each += 4 * self.cells[0] * self.cells[1] * (3 + self.cells[2])
        self.get = lru_cache(maxsize=max(4, _HELD_BYTES // each))(self._get)

    def _get(self, place: int) -> Reference:
        index = self._index[place]
        kept = unpack(self._pictures[index])
        if kind_of(kept) != self.kind:
            raise AppearanceError(
                f"the reference picture of place {place} is {kind_of(kept)}, the first one is {self.kind}"
            )
        picture = levels(kept)
        try:
            template = Template.of(smooth(self._ignored.filled(picture)), self._points[index])
        except np.linalg.LinAlgError as error:
            raise AppearanceError(f"the points of place {place} cannot tell shift from light") from error
        band = Band.of(picture, self.cell)
        coarse = Coarse.of(picture) if len(self._limits) > 1 else None
        thresholds = tuple(limits.threshold(band.contrast) for limits in self._limits)
        return Reference(picture, template, band, coarse, thresholds, self._allowed(place), self.cell)

    def _allowed(self, place: int) -> Float32[np.ndarray, "rows cols c"] | None:
        data = self._tolerance[self._index[place]]
        if not data:
            return None
        try:
            shown = unpack_cells(data, self.cells)
        except ValueError as error:
            raise AppearanceError(f"the tolerance of place {place} cannot be read: {error}") from error
        return np.where(shown < ALL, 1 + shown, np.float32(np.inf))
