"""What may differ, pixel by pixel, along the sweep: the expected band, and how far a picture lies outside of it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from models.registration import affine

BRIGHT, DARK = 0, 1
_EDGE = np.ones((5, 5), np.uint8)
"""One golden sweep cannot say how far an edge may move: two pixels either way are allowed."""
_GROW = np.ones((3, 3), np.uint8)
_BOX = (5, 5)
_RIM = 4


def cell_size(size: tuple[int, int]) -> int:
    """Side of the cells that evidence is kept in, in pixels: some 80 x 60 of them in a small picture."""
    return 4 if max(size) <= 640 else 8


def levels(pixels: np.ndarray) -> np.ndarray:
    """The picture in grey levels of 0..255: eight bits as they are, sixteen as float32."""
    return pixels if pixels.dtype == np.uint8 else pixels.astype(np.float32) * np.float32(1 / 257)


def to_cells(values: np.ndarray, cell: int) -> np.ndarray:
    """The largest value in each cell; a cell that the picture's edge cuts counts too."""
    return cv2.dilate(values, np.ones((cell, cell), np.uint8), anchor=(0, 0))[::cell, ::cell]


@dataclass(frozen=True, eq=False)
class Band:
    """What a place may look like, in grey levels: dark end, bright end, and the local contrast between them."""

    low: np.ndarray
    high: np.ndarray
    contrast: Float[np.ndarray, "rows cols"]
    """Per cell: how much the reference picture varies about it. Edges that stray are as strong as this."""

    @classmethod
    def of(cls, reference: np.ndarray, excess: np.ndarray | None, cell: int) -> Band:
        """Around a reference picture in grey levels; `excess` (2, ...) is what golden sweeps showed beyond it."""
        low, high = cv2.erode(reference, _EDGE), cv2.dilate(reference, _EDGE)
        spread = to_cells(high, cell).astype(np.float32) + to_cells(np.float32(255) - low, cell) - 255
        spread = spread if spread.ndim == 2 else spread.max(axis=2)
        contrast = cv2.blur(cv2.dilate(spread, _GROW), (3, 3))
        if excess is not None:
            grown = [cv2.dilate(part, _GROW) for part in excess]
            high, low = cv2.add(high, grown[BRIGHT]), cv2.subtract(low, grown[DARK])
        return cls(low, high, contrast)


def aligned(picture: np.ndarray, pose: Float[np.ndarray, "3"], light: Float[np.ndarray, "4"]) -> np.ndarray:
    """The picture laid on its reference and lit like it: float32 grey levels, shape of the picture."""
    h, w = picture.shape[:2]
    laid = cv2.warpAffine(
        picture,
        affine(pose, (w, h)),
        (w, h),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    ).astype(np.float32)
    gain, offset, across, down = (np.float32(v) for v in light)
    u = np.linspace(-1, 1, w, dtype=np.float32) * across + gain
    v = np.linspace(-1, 1, h, dtype=np.float32) * down
    lamp = np.maximum(u[None, :] + v[:, None], np.float32(0.1))
    laid -= offset
    laid /= lamp if laid.ndim == 2 else lamp[:, :, None]
    return laid


def beyond(band: Band, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far each pixel lies above the band, and how far below: float32 grey levels, never negative."""
    return cv2.max(cv2.subtract(seen, band.high, dtype=cv2.CV_32F), 0.0), cv2.max(
        cv2.subtract(band.low, seen, dtype=cv2.CV_32F), 0.0
    )


def evidence(band: Band, seen: np.ndarray, cell: int) -> Float[np.ndarray, "rows cols 2"]:
    """Mean excess over a small box, the largest per cell, bright and dark apart, in grey levels."""
    parts: list[np.ndarray] = []
    for excess in beyond(band, seen):
        cells = to_cells(cv2.blur(excess, _BOX), cell)
        parts.append(cells if cells.ndim == 2 else cells.max(axis=2))
    return np.dstack(parts)


def outside(pose: Float[np.ndarray, "3"], size: tuple[int, int], cell: int) -> np.ndarray:
    """Cells of the reference picture that the frame does not wholly show: bool (rows, cols)."""
    w, h = size
    m = affine(pose, size)
    rows, cols = -(-h // cell), -(-w // cell)
    # the corner of the cell that lies deepest outside decides; rotations are small
    x0, y0 = np.arange(cols) * cell, np.arange(rows)[:, None] * cell
    hidden = np.zeros((rows, cols), bool)
    for x, y in ((x0, y0), (x0 + cell - 1, y0), (x0, y0 + cell - 1), (x0 + cell - 1, y0 + cell - 1)):
        u, v = m[0, 0] * x + m[0, 1] * y + m[0, 2], m[1, 0] * x + m[1, 1] * y + m[1, 2]
        hidden |= (u < _RIM) | (u > w - 1 - _RIM) | (v < _RIM) | (v > h - 1 - _RIM)
    return hidden
