"""Don't-care pixels, fixed in the picture: reflections, parts of the fixture, time stamps."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from models.errors import PictureError
from models.registration import affine, shrink_by

_RIM = 2
"""Pixels about them, in pictures some 320 wide, that compression and warping carry them into."""


@dataclass(frozen=True, eq=False)
class Ignored:
    """Pixels that say nothing, wherever the part is: no place, no defect, and no absence of one either."""

    mask: UInt8[np.ndarray, "h w"] | None
    """1 where nothing is said; None where there are no such pixels."""
    pixels: Int[np.ndarray, " n"]
    """The same as flat indices."""
    nearest: Int[np.ndarray, " n"]
    """Of each of them, the nearest pixel that is looked at."""

    @classmethod
    def of(cls, ignore: Bool[np.ndarray, "h w"] | None) -> Ignored:
        """From a mask that is True where nothing is said, and a little about that."""
        none = np.zeros(0, np.int64)
        if ignore is None or not ignore.any():
            return cls(None, none, none)
        rim = 2 * _RIM * shrink_by((ignore.shape[1], ignore.shape[0])) + 1
        mask = cv2.dilate(ignore.astype(np.uint8), np.ones((rim, rim), np.uint8))
        seen = np.flatnonzero(mask == 0)
        if not len(seen):
            raise PictureError(f"the don't-care mask leaves nothing of a picture of {mask.shape[1]}x{mask.shape[0]}")
        found = cv2.distanceTransformWithLabels(mask, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[1]
        label = found.reshape(-1).astype(np.int64)
        at = np.zeros(int(label.max()) + 1, np.int64)
        at[label[seen]] = seen
        pixels = np.flatnonzero(mask)
        return cls(mask, pixels, at[label[pixels]])

    def filled(self, picture: np.ndarray) -> np.ndarray:
        """The picture (h, w) or (h, w, 3) with what lies next to them in their place: nothing there to hold on to."""
        if self.mask is None:
            return picture
        flat = picture.reshape(self.mask.size, -1).copy()
        flat[self.pixels] = flat[self.nearest]
        return flat.reshape(picture.shape)

    def laid(
        self, expected: np.ndarray, seen: np.ndarray, pose: Float[np.ndarray, " 3"], cell: int
    ) -> tuple[np.ndarray, Bool[np.ndarray, "rows cols"] | None]:
        """A frame that was laid on its reference picture under `pose`, with what is expected where either says nothing.

        And the cells that such pixels lie in; None where there are no such pixels.
        """
        if self.mask is None:
            return seen, None
        h, w = self.mask.shape
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        moved = cv2.warpAffine(self.mask * np.uint8(255), affine(pose, (w, h)), (w, h), flags=flags)
        either = cv2.max(moved, self.mask)
        return cv2.copyTo(expected, either, seen.copy()), touched(either, cell)


def touched(mask: UInt8[np.ndarray, "h w"], cell: int) -> Bool[np.ndarray, "rows cols"]:
    """Which cells a mask has a pixel in."""
    h, w = mask.shape
    rows, cols = -(-h // cell), -(-w // cell)
    whole = np.zeros((rows * cell, cols * cell), np.uint8)
    whole[:h, :w] = mask
    return np.any(whole.reshape(rows, cell, cols, cell), axis=(1, 3))
