"""A real defect moves with the part: what is seen at one place of the sweep only is noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

PLACES = 5
"""How many places must agree."""
_TRAVEL = 0.019
"""Places lie this share of the picture's width apart: a standstill adds none."""
_FEW = np.array([np.inf, 3.0, 2.0, 1.5, 1.2, 1.0], np.float32)
"""What has been seen at fewer places must be that much stronger."""
_UNSEEN = -1.0
_GROW = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False)
class Sight:
    """The score of one place, and where the picture stood."""

    point: Float[np.ndarray, "2"]
    """Displacement of the frame along the reference sweep, in pixels."""
    place: float
    grid: Float[np.ndarray, "2"]
    """Displacement of the reference picture that the score is laid on."""
    score: Float[np.ndarray, "rows cols 2"]
    """Grown by one cell; below 0 where nothing was seen."""


def persist(
    sights: tuple[Sight, ...],
    score: Float[np.ndarray, "rows cols 2"],
    hidden: Bool[np.ndarray, "rows cols"],
    sight: tuple[float, Float[np.ndarray, "2"], Float[np.ndarray, "2"]],
    cell: int,
) -> tuple[tuple[Sight, ...], Float[np.ndarray, "rows cols 2"]]:
    """The last places with this one added, newest last, and the score that all of them agree on.

    `sight` is the place, the displacement of the frame, and the displacement of the reference picture that `score`
    is laid on, which the answer is laid on, too. Cells in `hidden` are not seen.
    """
    place, point, grid = sight
    agreed = score.copy()
    agreed[hidden] = _UNSEEN
    grown = cv2.dilate(agreed, _GROW)
    grown[hidden] = _UNSEEN
    rows, cols = hidden.shape
    stays = bool(sights) and abs(sights[-1].place - place) < 1.0
    if stays and np.hypot(*(sights[-1].point - point)) < _TRAVEL * cols * cell:
        others = sights[:-1]
        newest = Sight(sights[-1].point, sights[-1].place, grid, grown)
    else:
        others = sights[-(PLACES - 1) :]
        newest = Sight(point, place, grid, grown)
    count = np.ones((rows, cols), np.int8)
    for other in others:
        moved = _moved(other.score, (grid - other.grid) / cell)
        seen = moved[:, :, 0] >= 0
        count += seen
        np.minimum(agreed, moved, out=agreed, where=seen[:, :, None])
    agreed /= _FEW[count][:, :, None]
    agreed[hidden] = 0
    return (*others, newest), agreed


def _moved(score: Float[np.ndarray, "rows cols 2"], by: Float[np.ndarray, "2"]) -> Float[np.ndarray, "rows cols 2"]:
    """The map moved by so many cells, to the nearest; what comes in from outside is not seen."""
    m = np.array([[1.0, 0.0, by[0]], [0.0, 1.0, by[1]]])
    size = (score.shape[1], score.shape[0])
    border = (_UNSEEN, _UNSEEN)
    return cv2.warpAffine(score, m, size, flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=border)
