"""What may differ, pixel by pixel, along the sweep: the expected band, and how far a picture lies outside of it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from models.registration import affine

BRIGHT, DARK = 0, 1
_EDGE = np.ones((5, 5), np.uint8)
"""One golden sweep cannot say how far an edge may move: two pixels either way are allowed."""
_FAR = np.ones((9, 9), np.uint8)
"""Nobody calls an edge that strays by more than four pixels the same edge."""
_LINE = 9
"""Pixels: a stretch of edge this long that strays as a whole is the part's own spread, not a notch."""
_LINES = (
    np.ones((1, _LINE), np.uint8),
    np.ones((_LINE, 1), np.uint8),
    np.eye(7, dtype=np.uint8),
    np.eye(7, dtype=np.uint8)[::-1].copy(),
)
_THICK = np.ones((4, 4), np.uint8)
_STILL_AN_EDGE = np.float32(0.6)
"""Share of its contrast that an edge which only strayed must still have."""
_SLIGHT = 8
"""Grey levels of excess not worth forgiving."""
_GROW = np.ones((3, 3), np.uint8)
_RIM = 4
_STRAY = 7
"""Pixels: the wide band and half the box that evidence is averaged over."""
_EVEN = 0.004
"""Shading too slight to be worth a multiplication: less than half a grey level."""


def cell_size(size: tuple[int, int]) -> int:
    """Side of the cells that evidence is kept in, in pixels: some 80 x 60 of them in a small picture."""
    return 4 if max(size) <= 640 else 8


def levels(pixels: np.ndarray) -> np.ndarray:
    """The picture in grey levels of 0..255: eight bits as they are, sixteen as float32."""
    return pixels if pixels.dtype == np.uint8 else pixels.astype(np.float32) * np.float32(1 / 257)


@dataclass(frozen=True, eq=False)
class Band:
    """What a place may look like, in grey levels: dark end, bright end, and the local contrast between them."""

    reference: np.ndarray
    low: np.ndarray
    high: np.ndarray
    contrast: Float[np.ndarray, "rows cols"]
    """Per cell: how much the reference picture varies about it. Edges that stray are as strong as this."""

    @classmethod
    def of(cls, reference: np.ndarray, excess: np.ndarray | None, cell: int) -> Band:
        """Around a reference picture in grey levels; `excess` (2, ...) is what golden sweeps showed beyond it."""
        low, high = cv2.erode(reference, _EDGE), cv2.dilate(reference, _EDGE)
        # low and high reach over two pixels: one of them a cell says nearly all
        middle = slice(cell // 2, None, cell)
        spread = cv2.subtract(high[middle, middle], low[middle, middle])
        spread = spread if spread.ndim == 2 else _strongest(spread)
        contrast = cv2.blur(cv2.dilate(_whole(spread.astype(np.float32), reference.shape, cell), _GROW), (3, 3))
        if excess is not None:
            grown = [cv2.dilate(part, _GROW).astype(reference.dtype) for part in excess]
            high, low = cv2.add(high, grown[BRIGHT]), cv2.subtract(low, grown[DARK])
        return cls(reference, low, high, contrast)


def _whole(cells: np.ndarray, shape: tuple[int, ...], cell: int) -> np.ndarray:
    """With the last row and column that a picture's cut cells need."""
    rows, cols = -(-shape[0] // cell) - cells.shape[0], -(-shape[1] // cell) - cells.shape[1]
    return cells if not (rows or cols) else cv2.copyMakeBorder(cells, 0, rows, 0, cols, cv2.BORDER_REPLICATE)


def _strongest(channels: np.ndarray) -> np.ndarray:
    """The strongest of three channels, pixel by pixel."""
    blue, green, red = cv2.split(channels)
    return cv2.max(cv2.max(blue, green), red)


def aligned(picture: np.ndarray, pose: Float[np.ndarray, " 3"], light: Float[np.ndarray, " 4"]) -> np.ndarray:
    """The picture laid on its reference and lit like it: grey levels, shape and type of the picture."""
    h, w = picture.shape[:2]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    laid = cv2.warpAffine(picture, affine(pose, (w, h)), (w, h), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    gain, offset, across, down = (float(v) for v in light)
    if abs(across) + abs(down) < _EVEN:
        return _scaled(laid, 1 / max(gain, 0.1), -offset / max(gain, 0.1))
    u = np.linspace(-across, across, w, dtype=np.float32)
    v = np.linspace(gain - down, gain + down, h, dtype=np.float32)
    lamp = cv2.divide(1.0, np.maximum(v[:, None] + u[None, :], np.float32(0.1)))
    lamp = lamp if laid.ndim == 2 else cv2.merge([lamp, lamp, lamp])
    return cv2.multiply(_scaled(laid, 1.0, -offset), lamp, dtype=cv2.CV_8U if laid.dtype == np.uint8 else cv2.CV_32F)


def _scaled(picture: np.ndarray, by: float, plus: float) -> np.ndarray:
    if picture.dtype != np.uint8:
        return picture * np.float32(by) + np.float32(plus)
    table = np.clip(np.arange(256) * by + plus + 0.5, 0, 255).astype(np.uint8)
    return cv2.LUT(picture, table)


def beyond(band: Band, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far each pixel lies above the band, and how far below: grey levels, never negative."""
    bright, dark = cv2.subtract(seen, band.high), cv2.subtract(band.low, seen)
    if seen.dtype != np.uint8:
        bright, dark = np.maximum(bright, 0), np.maximum(dark, 0)
    return _forgiven(bright, band.reference, seen, BRIGHT), _forgiven(dark, band.reference, seen, DARK)


def _forgiven(excess: np.ndarray, reference: np.ndarray, seen: np.ndarray, polarity: int) -> np.ndarray:
    """Excess without edges that stray: thin, long and close beside an edge, as etching and wear move them.

    What is thick, short, or away from edges stays: notches, spurs, spots and scratches. So does what lies where the
    reference shows an edge and the frame shows none: that edge has not strayed, it is missing.
    """
    marked = (excess if excess.ndim == 2 else _strongest(excess)) >= _SLIGHT
    x, y, w, h = cv2.boundingRect(marked.view(np.uint8))
    if w < _LINE and h < _LINE:
        return excess
    box = slice(max(0, y - _LINE), y + h + _LINE), slice(max(0, x - _LINE), x + w + _LINE)
    part, expected, actual = excess[box], reference[box], seen[box]
    dark, bright = cv2.erode(expected, _FAR), cv2.dilate(expected, _FAR)
    far = cv2.subtract(actual, bright) if polarity == BRIGHT else cv2.subtract(dark, actual)
    lines = cv2.morphologyEx(part, cv2.MORPH_OPEN, _LINES[0])
    for line in _LINES[1:]:
        lines = cv2.max(lines, cv2.morphologyEx(part, cv2.MORPH_OPEN, line))
    there = cv2.subtract(cv2.dilate(actual, _FAR), cv2.erode(actual, _FAR))
    missing = there < _STILL_AN_EDGE * cv2.subtract(bright, dark).astype(np.float32)
    lines[missing] = 0
    # even sides have no middle: what eroding shifts, dilating must shift back
    thick = cv2.min(part, cv2.dilate(cv2.erode(part, _THICK, anchor=(2, 2)), _THICK, anchor=(1, 1)))
    forgiven = excess.copy()
    forgiven[box] = cv2.max(cv2.max(cv2.subtract(part, lines), thick), cv2.min(part, far))
    return forgiven


def evidence(band: Band, seen: np.ndarray, cell: int) -> Float[np.ndarray, "rows cols 2"]:
    """Mean excess over a box of six pixels, the largest per cell, bright and dark apart, in grey levels."""
    h, w = seen.shape[:2]
    rows, cols = -(-h // cell), -(-w // cell)
    found = np.zeros((rows, cols, 2), np.float32)
    for polarity, excess in enumerate(beyond(band, seen)):
        halves = cv2.resize(excess, (w // 2, h // 2), interpolation=cv2.INTER_AREA)
        halves = halves if halves.ndim == 2 else _strongest(halves)
        mean = cv2.boxFilter(halves, cv2.CV_32F, (3, 3))
        half = cell // 2
        whole = mean[: rows * half, : cols * half]
        if whole.shape != (rows * half, cols * half):
            missing = (rows * half - whole.shape[0], cols * half - whole.shape[1])
            whole = cv2.copyMakeBorder(whole, 0, missing[0], 0, missing[1], cv2.BORDER_REPLICATE)
        across = np.maximum.reduce([whole[i::half] for i in range(half)])
        found[:, :, polarity] = np.maximum.reduce([across[:, i::half] for i in range(half)])
    return found


def outside(pose: Float[np.ndarray, " 3"], size: tuple[int, int], cell: int) -> Bool[np.ndarray, "rows cols"]:
    """Cells of the reference picture that the frame does not wholly show."""
    w, h = size
    rows, cols = -(-h // cell), -(-w // cell)
    tx, ty, turn = float(pose[0]), float(pose[1]), abs(float(pose[2]))
    # rotations are small: the edge that turns in decides for its whole length
    skew_x, skew_y = turn * h / 2 + _RIM, turn * w / 2 + _RIM
    left, right = (skew_x - tx) / cell, (w - 1 - skew_x - tx) / cell
    top, bottom = (skew_y - ty) / cell, (h - 1 - skew_y - ty) / cell
    hidden = np.ones((rows, cols), bool)
    # what lies just outside of the reference picture may stray in: its own rim says nothing
    rim = -(-_STRAY // cell)
    shown_rows = slice(max(rim, int(np.ceil(top))), max(0, min(h // cell - rim, int(np.floor(bottom)))))
    shown_cols = slice(max(rim, int(np.ceil(left))), max(0, min(w // cell - rim, int(np.floor(right)))))
    hidden[shown_rows, shown_cols] = False
    return hidden
