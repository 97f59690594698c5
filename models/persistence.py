"""A real defect moves with the part: what is seen at one place of the sweep only is noise."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

PLACES = 5
"""How many places must agree."""
_TRAVEL = 0.019
"""Places lie this share of the picture's width apart: a standstill adds none."""
_FEW = np.ones(256, np.float32)
_FEW[: PLACES + 1] = 1 / np.array([np.inf, 3.0, 2.0, 1.5, 1.2, 1.0])
"""What has been seen at fewer places must be that much stronger."""
Cells = tuple[slice, slice]
"""A rectangle of them: rows and columns."""
_GROW = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False)
class Sight:
    """The score of one place, and where the picture stood."""

    point: Float[np.ndarray, " 2"]
    """Displacement of the frame along the reference sweep, in pixels."""
    place: float
    grid: Float[np.ndarray, " 2"]
    """Displacement of the reference picture that the score is laid on."""
    score: Float[np.ndarray, "rows cols c"]
    """Bright and dark of each scale, grown by one cell."""
    shown: Cells
    """Where anything was seen."""
    unseen: Bool[np.ndarray, "rows cols"] | None
    """Cells among them where nothing was; the score is beyond all bounds there."""


def persist(
    sights: tuple[Sight, ...],
    score: Float[np.ndarray, "rows cols c"],
    shown: Cells,
    sight: tuple[float, Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]],
    cell: int,
    *,
    unseen: Bool[np.ndarray, "rows cols"] | None = None,
) -> tuple[tuple[Sight, ...], Float[np.ndarray, "rows cols c"]]:
    """The last places with this one added, newest last, and the score that all of them agree on.

    `sight` is the place, the displacement of the frame, and the displacement of the reference picture that `score`
    is laid on, which the answer is laid on, too. Only cells in `shown` are seen, and of them none in
    `unseen`.
    """
    place, point, grid = sight
    rows, cols, _ = score.shape
    stays = bool(sights) and abs(sights[-1].place - place) < 1.0
    grown = cv2.dilate(score, _GROW)
    if stays and hypot(*(sights[-1].point - point).tolist()) < _TRAVEL * cols * cell:
        others = sights[:-1]
        newest = Sight(sights[-1].point, sights[-1].place, grid, grown, shown, unseen)
    else:
        others = sights[-(PLACES - 1) :]
        newest = Sight(point, place, grid, grown, shown, unseen)
    agreed = np.zeros_like(score)
    agreed[shown] = score[shown]
    if unseen is not None:
        grown[unseen], agreed[unseen] = np.inf, 0
    count = np.ones((rows, cols), np.uint8)
    for other in others:
        x, y = ((grid - other.grid) / cell).tolist()
        _agree(agreed, count, shown, other, (round(y), round(x)))
    few = cv2.LUT(count, _FEW)
    return (*others, newest), agreed * few[:, :, None]


def _agree(
    agreed: Float[np.ndarray, "rows cols c"],
    count: UInt8[np.ndarray, "rows cols"],
    shown: Cells,
    other: Sight,
    by: tuple[int, int],
) -> None:
    """Lower `agreed` to what another place saw, its map moved by so many cells down and across; and count it."""
    here, there = list[slice](), list[slice]()
    for mine, theirs, moved in zip(shown, other.shown, by, strict=True):
        start, stop = max(mine.start, theirs.start + moved), min(mine.stop, theirs.stop + moved)
        if start >= stop:
            return
        here.append(slice(start, stop))
        there.append(slice(start - moved, stop - moved))
    both, its = (here[0], here[1]), (there[0], there[1])
    count[both] += 1 if other.unseen is None else ~other.unseen[its]
    agreed[both] = cv2.min(agreed[both], other.score[its])
