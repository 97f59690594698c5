"""What may differ, pixel by pixel, along the sweep: the expected band, and how far a picture lies outside of it."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor

import cv2
import numpy as np
from jaxtyping import Float

from models.excess import BRIGHT, DARK, Excess, strongest
from models.excess import band as ends
from models.patches import Patches
from models.registration import affine

Box = tuple[slice, slice]
EVERYWHERE: Box = slice(None), slice(None)
_GROW = np.ones((3, 3), np.uint8)
_MATTERS = 0.5
"""Share of the threshold from which on edges that stray are worth forgiving."""
_RIM = 4
_STRAY = 4
"""Pixels at a reference picture's rim that something from beyond it may stray into."""
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
    more: list[np.ndarray] | None
    """What golden sweeps showed beyond that, bright and dark; None where nothing."""

    @classmethod
    def of(cls, reference: np.ndarray, excess: np.ndarray | None, cell: int) -> Band:
        """Around a reference picture in grey levels; `excess` (2, ...) is what golden sweeps showed beyond it."""
        low, high = ends(reference)
        # low and high reach over some pixels: one of them a cell says nearly all
        middle = slice(cell // 2, None, cell)
        spread = cv2.subtract(high[middle, middle], low[middle, middle])
        contrast = cv2.blur(
            cv2.dilate(_whole(strongest(spread).astype(np.float32), reference.shape, cell), _GROW), (3, 3)
        )
        more = None if excess is None else [cv2.dilate(part, _GROW).astype(reference.dtype) for part in excess]
        return cls(reference, low, high, contrast, more)


def _whole(cells: np.ndarray, shape: tuple[int, ...], cell: int) -> np.ndarray:
    """With the last row and column that a picture's cut cells need."""
    rows, cols = -(-shape[0] // cell) - cells.shape[0], -(-shape[1] // cell) - cells.shape[1]
    return cells if not (rows or cols) else cv2.copyMakeBorder(cells, 0, rows, 0, cols, cv2.BORDER_REPLICATE)


def aligned(picture: np.ndarray, pose: Float[np.ndarray, " 3"], light: Float[np.ndarray, " 4"]) -> np.ndarray:
    """The picture laid on its reference and lit like it: grey levels, shape and type of the picture."""
    h, w = picture.shape[:2]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    laid = cv2.warpAffine(picture, affine(pose, (w, h)), (w, h), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    gain, offset, across, down = light.tolist()
    if abs(across) + abs(down) < _EVEN:
        return _scaled(laid, 1 / max(gain, 0.1), -offset / max(gain, 0.1))
    laid = laid if abs(offset) < 0.5 else _scaled(laid, 1.0, -offset)
    lamp = _lamp(gain, across, down, (w, h))
    lamp = lamp if laid.ndim == 2 else cv2.merge([lamp, lamp, lamp])
    return cv2.multiply(laid, lamp, dtype=cv2.CV_8U if laid.dtype == np.uint8 else cv2.CV_32F)


def _lamp(gain: float, across: float, down: float, size: tuple[int, int]) -> Float[np.ndarray, "h w"]:
    """What undoes gain and shading: smooth, so divided on a coarse grid and drawn out (off by 0.2 % at the rim)."""
    u, v = ((2 * np.arange(n) + 1) / n - 1 for n in (40, 30))
    lamp = 1 / np.maximum(gain + across * u[None, :] + down * v[:, None], 0.1)
    return cv2.resize(lamp.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)


def _scaled(picture: np.ndarray, by: float, plus: float) -> np.ndarray:
    if picture.dtype != np.uint8:
        return picture * np.float32(by) + np.float32(plus)
    table = np.clip(np.arange(256) * by + plus + 0.5, 0, 255).astype(np.uint8)
    return cv2.LUT(picture, table)


def beyond(band: Band, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far each pixel is too bright, and too dark, edges that stray forgiven: grey levels, never negative."""
    excess = Excess.of(band.reference, (band.low, band.high), seen)
    return _within(band, excess.forgiven(BRIGHT), BRIGHT), _within(band, excess.forgiven(DARK), DARK)


def _within(band: Band, excess: np.ndarray, polarity: int, patches: Patches | None = None) -> np.ndarray:
    """What is left of an excess when what golden sweeps showed is allowed."""
    if band.more is None:
        return excess
    more = band.more[polarity]
    return np.maximum(cv2.subtract(excess, patches.cut(more) if patches else more), 0)


def evidence(
    band: Band, seen: np.ndarray, cell: int, threshold: Float[np.ndarray, "rows cols"], box: Box = EVERYWHERE
) -> Float[np.ndarray, "rows cols 2"]:
    """Mean excess over a box of six pixels, the largest per cell, bright and dark apart, in grey levels.

    Edges that stray are forgiven where that can matter: about cells inside of `box` that come near the threshold.
    """
    excess = Excess.of(band.reference, (band.low, band.high), seen)
    enough = np.full_like(threshold, np.inf)
    enough[box] = _MATTERS * threshold[box]
    return cv2.merge([_evidence(band, excess, polarity, cell, enough) for polarity in (BRIGHT, DARK)])


def _evidence(
    band: Band, excess: Excess, polarity: int, cell: int, enough: Float[np.ndarray, "rows cols"]
) -> Float[np.ndarray, "rows cols"]:
    shape = excess.seen.shape
    cells = _picked(_means(_within(band, excess.whole(polarity), polarity), cell), shape, cell)
    strong = cv2.compare(cells, enough, cv2.CMP_GE)
    if not cv2.countNonZero(strong):
        return cells
    patches = Patches.about(cv2.dilate(strong, _GROW), cell, shape)
    means = _means(_within(band, excess.forgiven(polarity, patches), polarity, patches), cell)
    return patches.put(means, cells, cell) if patches else _picked(means, shape, cell)


def _means(excess: np.ndarray, cell: int) -> Float[np.ndarray, "h2 w2"]:
    """Averaged over six pixels, at half the size; then the largest in a cell to the right and below."""
    h, w = excess.shape[:2]
    halves = strongest(cv2.resize(excess, (w // 2, h // 2), interpolation=cv2.INTER_AREA))
    half = cell // 2
    return cv2.dilate(cv2.boxFilter(halves, cv2.CV_32F, (3, 3)), np.ones((half, half), np.uint8), anchor=(0, 0))


def _picked(means: Float[np.ndarray, "h2 w2"], shape: tuple[int, ...], cell: int) -> Float[np.ndarray, "rows cols"]:
    """One value a cell."""
    half = cell // 2
    return _whole(means[::half, ::half], shape, cell)


def cells_shown(pose: Float[np.ndarray, " 3"], size: tuple[int, int], cell: int) -> Box:
    """Rows and columns of the cells of the reference picture that the frame wholly shows."""
    w, h = size
    tx, ty, turn = pose.tolist()
    turn = abs(turn)
    # rotations are small: the edge that turns in decides for its whole length
    skew_x, skew_y = turn * h / 2 + _RIM, turn * w / 2 + _RIM
    left, right = (skew_x - tx) / cell, (w - 1 - skew_x - tx) / cell
    top, bottom = (skew_y - ty) / cell, (h - 1 - skew_y - ty) / cell
    # what lies just outside of the reference picture may stray in: its own rim says nothing
    rim = -(-_STRAY // cell)
    return (
        slice(max(rim, ceil(top)), max(0, min(h // cell - rim, floor(bottom)))),
        slice(max(rim, ceil(left)), max(0, min(w // cell - rim, floor(right)))),
    )
