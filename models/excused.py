"""Don't-care regions of the part: drawn on one reference picture, and excused wherever the sweep sees them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool

from models.appearance import Appearance
from models.errors import LearningError
from models.ignored import touched
from models.registration import shrink_by
from models.spread import pack, unpack_cells

_GROW = np.ones((3, 3), np.uint8)


def excused(appearance: Appearance, place: int, region: Bool[np.ndarray, "h w"]) -> Appearance:
    """A new appearance that tolerates everything in a region of the part: labels, serial numbers, manual solder.

    `region` lies on the reference picture of the key place `place`, and moves with the part from there. A cell about
    it is excused, too. Raises LearningError for a place without a picture, a region of another size, and where the
    picture does not move along the sweep.
    """
    width, height = appearance.size
    if place not in appearance.keys:
        raise LearningError(
            f"place {place} has no reference picture to draw on; allowed are {appearance.keys.tolist()}"
        )
    if region.shape != (height, width):
        raise LearningError(f"the region is {region.shape[1]}x{region.shape[0]}, the picture {width}x{height}")
    if not appearance.shifts:
        raise LearningError("the picture does not move along this sweep: nobody knows where a region of it would go")
    rows, cols, channels = appearance.references.cells
    by, path, tolerance = shrink_by(appearance.size), appearance.path, list[bytes]()
    for key, data in zip(appearance.keys.tolist(), appearance.tolerance, strict=True):
        dx, dy = by * (path.at(key) - path.at(place))
        moved = cv2.warpAffine(region.astype(np.uint8), np.array([[1, 0, dx], [0, 1, dy]]), (width, height))
        cells = cv2.dilate(touched(moved, appearance.references.cell).view(np.uint8), _GROW) > 0
        shown = unpack_cells(data, (rows, cols, channels)) if data else np.zeros((rows, cols, channels), np.float32)
        shown[cells] = np.inf
        tolerance.append(pack(shown) if cells.any() else data)
    return replace(appearance, tolerance=tuple(tolerance))
