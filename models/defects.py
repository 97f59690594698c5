"""Synthetic defects: drawn into pictures as a lens would show them, of stated size and contrast."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float

from models.registration import shrink_by
from models.tolerance import levels

_FINE = 4
"""Defects are drawn so many times larger, and placed to such a share of a pixel."""
_BESIDE = 6
"""Pixels, in pictures 320 wide: how far from an edge material is added or missing."""
_LONG = 0.1
"""Length of a line, as a share of the picture's width."""
_SLANT = np.deg2rad(30)
"""Of a line: along no direction in which edges are forgiven."""
_STEEP = 40.0
"""Grey levels: weaker edges say nothing of the lens."""


class Kind(StrEnum):
    """What a synthetic defect does to the picture."""

    SPOT = "spot"
    """A disc, brighter than dark ground and darker than bright ground."""
    LINE = "line"
    """A straight scratch, a tenth of the picture's width long, of the same polarity as a spot."""
    ADDED = "added material"
    """A disc beside an edge, in the colour of the bright side: a spur, a splash, a bridge."""
    MISSING = "missing material"
    """A disc beside an edge, in the colour of the dark side: a notch, a break, a hole."""


@dataclass(frozen=True)
class Defect:
    """One synthetic defect, wherever it lies."""

    kind: Kind
    size: float
    """Diameter of a disc, width of a line, in pixels of the picture, before the lens."""
    contrast: float
    """Grey levels of 255 by which it differs, before the lens; never beyond black, white, or the neighbour's colour."""
    bright: bool
    """Brighter than what is there."""

    def extent(self, width: int) -> tuple[float, float]:
        """Half its width and half its height in a picture of that width, in pixels."""
        if self.kind is not Kind.LINE:
            return self.size / 2, self.size / 2
        along = _LONG * width / 2
        return along * float(np.cos(_SLANT)) + self.size / 2, along * float(np.sin(_SLANT)) + self.size / 2


def draw(pixels: np.ndarray, x: float, y: float, defect: Defect, blur: float) -> None:
    """Put a defect into a picture, in place: pixels (h, w[, 3]), uint8 or uint16; `blur` is the lens', in pixels.

    Saturated pixels stay: how far above white they are, and what would be left of that, nobody knows.
    """
    h, w = pixels.shape[:2]
    length = _LONG * w if defect.kind is Kind.LINE else 0.0
    left, top = int(np.floor(x)), int(np.floor(y))
    phase = round((x - left) * _FINE) % _FINE, round((y - top) * _FINE) % _FINE
    left, top = left + (round((x - left) * _FINE) == _FINE), top + (round((y - top) * _FINE) == _FINE)
    cover = _cover(defect.size, length, blur, phase)
    half = cover.shape[0] // 2
    x0, y0, x1, y1 = max(0, left - half), max(0, top - half), min(w, left + half + 1), min(h, top + half + 1)
    if x0 >= x1 or y0 >= y1:
        return
    cover = cover[y0 - top + half : y1 - top + half, x0 - left + half : x1 - left + half]
    scale = 257.0 if pixels.dtype == np.uint16 else 1.0
    seen = pixels[y0:y1, x0:x1].astype(np.float32) / np.float32(scale)
    if defect.kind in (Kind.SPOT, Kind.LINE):
        drawn = seen + (cover if seen.ndim == 2 else cover[:, :, None]) * (
            defect.contrast * (1 if defect.bright else -1)
        )
    else:
        drawn = _coloured(pixels, (x, y), seen, cover, defect)
    part = pixels[y0:y1, x0:x1]
    drawn = (np.clip(drawn, 0, 255) * scale + 0.5).astype(pixels.dtype)
    np.copyto(part, drawn, where=part < np.iinfo(pixels.dtype).max)


def _coloured(
    pixels: np.ndarray, at: tuple[float, float], seen: np.ndarray, cover: np.ndarray, defect: Defect
) -> np.ndarray:
    """Towards the colour of the brightest or the darkest nearby, as far as the contrast goes."""
    h, w = pixels.shape[:2]
    beside = beside_edge((w, h))
    x, y = (min(max(round(v), 0), side - 1) for v, side in zip(at, (w, h), strict=True))
    about = pixels[max(0, y - beside) : y + beside + 1, max(0, x - beside) : x + beside + 1]
    about = cv2.blur(np.ascontiguousarray(levels(about)), (3, 3))
    grey, ground = _grey(about), _grey(seen)
    row, col = np.unravel_index(int(grey.argmax() if defect.bright else grey.argmin()), grey.shape)
    room = grey[row, col] - ground if defect.bright else ground - grey[row, col]
    share = cover * np.where(room > 0, np.minimum(1.0, defect.contrast / np.maximum(room, 1.0)), 0.0)
    return seen + (share if seen.ndim == 2 else share[:, :, None]) * (about[row, col].astype(np.float32) - seen)


def _grey(picture: np.ndarray) -> np.ndarray:
    """One float32 per pixel."""
    return (picture if picture.ndim == 2 else picture.mean(axis=2)).astype(np.float32)


def beside_edge(size: tuple[int, int]) -> int:
    """Within how many pixels of added or missing material the edge lies."""
    return round(_BESIDE * float(np.sqrt(shrink_by(size))))


@lru_cache(maxsize=4096)
def _cover(size: float, length: float, blur: float, phase: tuple[int, int]) -> Float[np.ndarray, "n n"]:
    """How much of each pixel the defect covers, after the lens; its middle lies `phase` behind the middle pixel's."""
    half = int(np.ceil((size + length) / 2 + 3 * blur)) + 1
    n = (2 * half + 1) * _FINE
    grid = (np.arange(n) + 0.5) / _FINE - half - 0.5
    x, y = grid[None, :] - phase[0] / _FINE, grid[:, None] - phase[1] / _FINE
    across = -x * np.sin(_SLANT) + y * np.cos(_SLANT)
    beyond = np.maximum(np.abs(x * np.cos(_SLANT) + y * np.sin(_SLANT)) - length / 2, 0.0)
    distance = np.hypot(across, beyond)
    sharp = np.clip((size / 2 - distance) * _FINE + 0.5, 0, 1).astype(np.float32)
    soft = np.asarray(cv2.GaussianBlur(sharp, (0, 0), blur * _FINE), np.float32)
    return soft.reshape(2 * half + 1, _FINE, 2 * half + 1, _FINE).mean(axis=(1, 3))


def sharpness(picture: np.ndarray) -> float | None:
    """The lens' blur (sigma, in pixels) by the sharpest edges of a picture in grey levels; None where it has none.

    A step of height C blurred by sigma rises by C / (sigma sqrt(2 pi)) per pixel at the most.
    """
    grey = _grey(picture)
    rise = np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=0.125))
    reach = np.ones((9, 9), np.uint8)
    height = cv2.dilate(grey, reach) - cv2.erode(grey, reach)
    edges = (height > _STEEP) & (rise > 1) & (rise >= cv2.dilate(rise, np.ones((3, 3), np.uint8)))
    if edges.sum() < 20:
        return None
    sigma = height[edges] / (rise[edges] * np.sqrt(2 * np.pi))
    # the differences that the rise is taken by blur by 0.8 pixels themselves
    return float(np.sqrt(max(float(np.percentile(sigma, 20)) ** 2 - 0.8**2, 0.5**2)))
