"""What may differ, pixel by pixel, along the sweep: the expected band, and how far a picture lies outside of it."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor

import cv2
import numpy as np
from jaxtyping import Float

from models.excess import BRIGHT, DARK, Excess, less, strongest
from models.excess import band as ends
from models.patches import Patches
from models.registration import affine, shrink_by

Box = tuple[slice, slice]
EVERYWHERE: Box = slice(None), slice(None)
_GROW = np.ones((3, 3), np.uint8)
_MATTERS = 0.5
"""Share of the threshold from which on edges that stray are worth forgiving."""
_RIM = 4
_STRAY = 4
"""Pixels at a reference picture's rim that something from beyond it may stray into."""
_SMALLER, _WIDE, _WIDE_BOX = 2, np.ones((7, 7), np.uint8), (13, 13)
"""The coarse band looks at half of registration's pixels, three of them either way, averaged over a box of so many."""
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
    def of(cls, reference: np.ndarray, cell: int) -> Band:
        """Around a reference picture in grey levels."""
        low, high = ends(reference)
        # low and high reach over some pixels: one of them a cell says nearly all
        middle = slice(cell // 2, None, cell)
        spread = strongest(cv2.subtract(high[middle, middle], low[middle, middle])).astype(np.float32)
        contrast = cv2.blur(cv2.dilate(_whole(spread, reference.shape, cell), _GROW), (3, 3))
        return cls(reference, low, high, contrast)


@dataclass(frozen=True, eq=False)
class Coarse:
    """A wide band over a picture made smaller: what is large and amiss where edges stray too far for the narrow one.

    Individuals of an assembled product differ by more than etching and wear: leads are bent, parts stand askew.
    """

    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, reference: np.ndarray) -> Coarse:
        """Around a reference picture in grey levels."""
        small = _smaller(reference)
        return cls(cv2.erode(small, _WIDE), cv2.dilate(small, _WIDE))


def _smaller(picture: np.ndarray) -> np.ndarray:
    h, w = picture.shape[:2]
    by = _SMALLER * shrink_by((w, h))
    return cv2.resize(picture, (max(1, round(w / by)), max(1, round(h / by))), interpolation=cv2.INTER_AREA)


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


def evidence(
    band: Band, seen: np.ndarray, cell: int, threshold: Float[np.ndarray, "rows cols"], box: Box = EVERYWHERE
) -> Float[np.ndarray, "rows cols 2"]:
    """Mean excess over a box of six pixels, the largest per cell, bright and dark apart, in grey levels.

    Edges that stray are forgiven where that can matter: about cells inside of `box` that come near the threshold.
    """
    excess = Excess.of(band.reference, (band.low, band.high), seen)
    enough = np.full_like(threshold, np.inf)
    enough[box] = _MATTERS * threshold[box]
    return cv2.merge([_evidence(excess, polarity, cell, enough) for polarity in (BRIGHT, DARK)])


def _evidence(
    excess: Excess, polarity: int, cell: int, enough: Float[np.ndarray, "rows cols"]
) -> Float[np.ndarray, "rows cols"]:
    shape = excess.seen.shape
    cells = _picked(_means(excess.whole(polarity), cell), shape, cell)
    strong = cv2.compare(cells, enough, cv2.CMP_GE)
    if not cv2.countNonZero(strong):
        return cells
    patches = Patches.about(cv2.dilate(strong, _GROW), cell, shape)
    means = _means(excess.forgiven(polarity, patches), cell)
    return patches.put(means, cells, cell) if patches else _picked(means, shape, cell)


def coarse_evidence(coarse: Coarse, seen: np.ndarray, cell: int, box: Box) -> Float[np.ndarray, "rows cols 2"]:
    """Mean excess over a wide box of the smaller picture, per cell, bright and dark apart, in grey levels.

    None where the wide box would reach out of `box`, the cells that are shown.
    """
    small = _smaller(seen)
    h, w = seen.shape[:2]
    rows, cols = -(-h // cell), -(-w // cell)
    reach = _SMALLER * shrink_by((w, h)) * (_WIDE_BOX[0] // 2) // cell
    within = (
        slice(box[0].start + reach, max(0, box[0].stop - reach)),
        slice(box[1].start + reach, max(0, box[1].stop - reach)),
    )
    found = np.zeros((rows, cols, 2), np.float32)
    for polarity, excess in enumerate((less(small, coarse.high), less(coarse.low, small))):
        mean = cv2.boxFilter(strongest(excess), cv2.CV_32F, _WIDE_BOX)
        found[..., polarity][within] = cv2.resize(mean, (cols, rows), interpolation=cv2.INTER_AREA)[within]
    return found


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
