"""Squares cut out of a picture and laid side by side: what is asked of a few places costs one call, not many."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

GAP = 4
"""Columns to the left and right of each square, its own first and last drawn out: its neighbours are not its own."""
_CORE = 24
"""Side of what is asked about in each square, in pixels: a whole number of cells."""
_MARGIN = 12
"""Pixels about it: what is asked of a pixel may look so far."""
_SIDE = _CORE + 2 * _MARGIN
_PITCH = _SIDE + 2 * GAP


@dataclass(frozen=True, eq=False)
class Patches:
    """k squares that hold some cells of a picture, each with a margin."""

    rows: Int[np.ndarray, " k"]
    """Of the first cell of each."""
    cols: Int[np.ndarray, " k"]
    tops: Int[np.ndarray, " k"]
    """Where each square begins in the picture, in pixels: even, and so that all of it lies inside."""
    lefts: Int[np.ndarray, " k"]

    @classmethod
    def about(cls, cells: UInt8[np.ndarray, "rows cols"], cell: int, shape: tuple[int, ...]) -> Patches | None:
        """Squares that hold all cells that are not 0, of `cell` pixels; None where the whole picture costs less."""
        h, w, *_ = shape
        count, _, stats, _ = cv2.connectedComponentsWithStats(cells, connectivity=8)
        many, found = _CORE // cell, list[tuple[int, int]]()
        for x, y, width, height, _ in stats[1:count].tolist():
            found += [(row, col) for row in range(y, y + height, many) for col in range(x, x + width, many)]
        if min(h, w) < _SIDE or len(found) * _PITCH * _SIDE > h * w:
            return None
        rows, cols = np.array(found, int).reshape(-1, 2).T
        tops = np.minimum(np.maximum(rows * cell - _MARGIN, 0), (h - _SIDE) // 2 * 2)
        lefts = np.minimum(np.maximum(cols * cell - _MARGIN, 0), (w - _SIDE) // 2 * 2)
        return cls(rows, cols, tops, lefts)

    def cut(self, *pictures: np.ndarray) -> np.ndarray:
        """The squares of one or more pictures of a kind, side by side."""
        first, count = pictures[0], len(self.rows)
        h, w, *channels = first.shape
        inside = (h - _SIDE + 1, w - _SIDE + 1, _SIDE, _SIDE, *channels)
        strides = (*first.strides[:2], *first.strides)
        row = np.empty((_SIDE, len(pictures) * count, _PITCH, *channels), first.dtype)
        for i, picture in enumerate(pictures):
            windows = np.lib.stride_tricks.as_strided(picture, inside, strides, writeable=False)
            squares = windows[self.tops, self.lefts]
            row[:, i * count : (i + 1) * count, GAP:-GAP] = squares.swapaxes(0, 1)
        row[:, :, :GAP] = row[:, :, GAP : GAP + 1]
        row[:, :, -GAP:] = row[:, :, -GAP - 1 : -GAP]
        return row.reshape(_SIDE, -1, *channels)

    def put(
        self, values: Float[np.ndarray, "h2 w2"], cells: Float[np.ndarray, "rows cols"], cell: int
    ) -> Float[np.ndarray, "rows cols"]:
        """The cells, those in the squares taken from these at half their size: the value at the top left of each."""
        half, steps = cell // 2, np.arange(_CORE // cell)
        rows, cols = (first[:, None] + steps for first in (self.rows, self.cols))
        # cells beyond the picture are asked of as often as they are not kept
        down = np.minimum(half * rows - self.tops[:, None] // 2, _SIDE // 2 - 1)
        across = np.minimum(half * cols - self.lefts[:, None] // 2, _SIDE // 2 - 1)
        across += (np.arange(len(rows)) * _PITCH + GAP)[:, None] // 2
        height, width = cells.shape
        grown = cv2.copyMakeBorder(cells, 0, len(steps), 0, len(steps), cv2.BORDER_CONSTANT)
        grown[rows[:, :, None], cols[:, None, :]] = values[down[:, :, None], across[:, None, :]]
        return grown[:height, :width]


def drawn_out(picture: np.ndarray) -> np.ndarray:
    """A picture with its first and last column repeated, as squares are that lie side by side."""
    return cv2.copyMakeBorder(picture, 0, 0, GAP, GAP, cv2.BORDER_REPLICATE)
