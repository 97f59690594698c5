"""A real defect moves with the part: what is seen at one place of the sweep only is noise."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

PLACES = 5
"""How many places must agree."""
_TRAVEL = 0.019
"""Places lie this share of the picture's width apart: a standstill adds none."""
_FEW = np.ones(256, np.float32)
_FEW[: PLACES + 1] = 1 / np.array([np.inf, 3.0, 2.0, 1.5, 1.2, 1.0])
"""What has been seen at fewer places must be that much stronger."""
_UNSEEN = np.float32(1e9)
_GROW = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False)
class Sight:
    """The score of one place, and where the picture stood."""

    point: Float[np.ndarray, " 2"]
    """Displacement of the frame along the reference sweep, in pixels."""
    place: float
    grid: Float[np.ndarray, " 2"]
    """Displacement of the reference picture that the score is laid on."""
    score: Float[np.ndarray, "rows cols 2"]
    """Grown by one cell; beyond all bounds where nothing was seen."""


def persist(
    sights: tuple[Sight, ...],
    score: Float[np.ndarray, "rows cols 2"],
    hidden: Bool[np.ndarray, "rows cols"],
    sight: tuple[float, Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]],
    cell: int,
) -> tuple[tuple[Sight, ...], Float[np.ndarray, "rows cols 2"]]:
    """The last places with this one added, newest last, and the score that all of them agree on.

    `sight` is the place, the displacement of the frame, and the displacement of the reference picture that `score`
    is laid on, which the answer is laid on, too. Cells in `hidden` are not seen.
    """
    place, point, grid = sight
    agreed = score.copy()
    grown = cv2.dilate(agreed, _GROW)
    masked = hidden.view(np.uint8)
    cv2.copyTo(np.full_like(grown, _UNSEEN), masked, grown)
    rows, cols = hidden.shape
    stays = bool(sights) and abs(sights[-1].place - place) < 1.0
    if stays and np.hypot(*(sights[-1].point - point)) < _TRAVEL * cols * cell:
        others = sights[:-1]
        newest = Sight(sights[-1].point, sights[-1].place, grid, grown)
    else:
        others = sights[-(PLACES - 1) :]
        newest = Sight(point, place, grid, grown)
    count = np.ones((rows, cols), np.uint8)
    for other in others:
        _agree(agreed, count, other.score, (grid - other.grid) / cell)
    few = cv2.LUT(count, _FEW)
    cv2.multiply(agreed, cv2.merge([few, few]), agreed)
    cv2.copyTo(np.zeros_like(agreed), masked, agreed)
    return (*others, newest), agreed


def _agree(
    agreed: Float[np.ndarray, "rows cols 2"],
    count: Int[np.ndarray, "rows cols"],
    other: Float[np.ndarray, "rows cols 2"],
    by: Float[np.ndarray, " 2"],
) -> None:
    """Lower `agreed` to what another place saw, its map moved by so many cells, to the nearest; and count it."""
    rows, cols = count.shape
    dx, dy = round(float(by[0])), round(float(by[1]))
    if abs(dx) >= cols or abs(dy) >= rows:
        return
    here = slice(max(0, dy), rows + min(0, dy)), slice(max(0, dx), cols + min(0, dx))
    there = slice(max(0, -dy), rows + min(0, -dy)), slice(max(0, -dx), cols + min(0, -dx))
    moved = other[there]
    count[here] += moved[:, :, 0] < _UNSEEN
    agreed[here] = cv2.min(agreed[here], moved)
