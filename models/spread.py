"""What golden sweeps showed, cell by cell: what is tolerated where, which sweep is odd, and what each reaches alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32

Shown = Mapping[int, bytes]
"""What one golden sweep showed at each key place that it came by; made by `pack`."""
_STEPS = 16
"""Of a map per unit of the assumed limit: eight bits reach to fifteen times of it."""
ALL = 255 / _STEPS
"""The most that a map can hold: where it is tolerated, everything is."""
_GROW = np.ones((3, 3), np.uint8)
ODD = 2.5
"""A sweep that reaches this many times what golden sweeps usually reach does not belong to them."""
_FEW = 3
"""Golden sweeps from which on an odd one can be told."""


def pack(shown: Float32[np.ndarray, "rows cols c"]) -> bytes:
    """A map of scores, in units of the assumed limits, as a PNG of its channels one below the other."""
    counted = np.ceil(np.clip(shown * _STEPS, 0, 255)).astype(np.uint8)
    return cv2.imencode(".png", np.vstack(list(np.moveaxis(counted, 2, 0))))[1].tobytes()


def unpack_cells(data: bytes, shape: tuple[int, int, int]) -> Float32[np.ndarray, "rows cols c"]:
    """The map again. Raises ValueError where the picture is none of this shape."""
    kept = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    rows, cols, channels = shape
    if kept is None or kept.shape != (channels * rows, cols) or kept.dtype != np.uint8:
        raise ValueError(f"a tolerance of {len(data)} bytes is no map of {rows} x {cols} cells, {channels} channels")
    return np.moveaxis(kept.reshape(channels, rows, cols), 0, 2).astype(np.float32) / np.float32(_STEPS)


def grown(shown: Float32[np.ndarray, "rows cols c"]) -> Float32[np.ndarray, "rows cols c"]:
    """Each cell as high as the highest about it: what strays may stray a cell further."""
    return cv2.dilate(shown, _GROW)


def highest(shown: Sequence[Shown], key: int, shape: tuple[int, int, int]) -> bytes:
    """The most that any of the sweeps showed at a key place; empty where none came by."""
    maps = [unpack_cells(sweep[key], shape) for sweep in shown if key in sweep]
    return pack(np.max(maps, axis=0)) if maps else b""


def tolerated(shown: Sequence[Shown], key: int, shape: tuple[int, int, int]) -> bytes:
    """What is tolerated at a key place: what any of the sweeps showed there, a cell further."""
    most = highest(shown, key, shape)
    return pack(grown(unpack_cells(most, shape))) if most else b""


def against(tolerance: Shown, shown: Shown, shape: tuple[int, int, int]) -> Float32[np.ndarray, " scales"]:
    """The highest score of a sweep against what is tolerated, per scale."""
    peaks = np.zeros(shape[2] // 2, np.float32)
    for key, data in shown.items():
        allowed = 1 + unpack_cells(tolerance[key], shape) if key in tolerance else np.float32(1)
        peaks = np.maximum(peaks, _highest(unpack_cells(data, shape) / allowed, len(peaks)))
    return peaks


def leave_one_out(shown: Sequence[Shown], shape: tuple[int, int, int]) -> Float32[np.ndarray, "sweeps scales"]:
    """The highest score of each sweep against what the others show (leave one out), per scale.

    The first row is that of the reference sweep: the most that *all* others show at one place, which they then share
    and it alone does not. Channels of `shape` come in pairs, a pair for each scale.
    """
    scales = shape[2] // 2
    peaks = np.zeros((len(shown) + 1, scales), np.float32)
    for key in sorted({key for sweep in shown for key in sweep}):
        by = [i for i, sweep in enumerate(shown) if key in sweep]
        maps = np.stack([unpack_cells(shown[i][key], shape) for i in by])
        around = np.stack([grown(each) for each in maps])
        first, most = around.argmax(axis=0), around.max(axis=0)
        np.put_along_axis(around, first[None], 0, axis=0)
        second = around.max(axis=0)
        for row, i in enumerate(by):
            others = np.asarray(np.where(first == row, second, most), np.float32)
            peaks[i + 1] = np.maximum(peaks[i + 1], _highest(maps[row] / (1 + others), scales))
        if len(by) == len(shown) > 1:
            peaks[0] = np.maximum(peaks[0], _highest(maps.min(axis=0), scales))
    return peaks


def _highest(score: Float32[np.ndarray, "rows cols c"], scales: int) -> Float32[np.ndarray, " scales"]:
    return score.reshape(-1, scales, 2).max(axis=(0, 2))


@dataclass(frozen=True)
class Odd:
    """A golden sweep that is unlike the others."""

    sweep: int
    """Counted from 0, the reference sweep."""
    reached: float
    """Its highest score, in units of the assumed limits."""
    usual: float
    """What golden sweeps reach at the same scale: their median."""


def usual(peaks: Float32[np.ndarray, "sweeps ..."]) -> Float32[np.ndarray, ...]:
    """What is usual enough of peaks: what stays within the assumed limit is no defect, however quiet others are.

    >>> usual(np.array([0.2, 0.3, 0.4])), usual(np.array([1.2, 1.3, 9.0]))
    (np.float64(1.0), np.float64(1.3))
    """
    return np.maximum(np.median(peaks, axis=0), 1.0)


def odd(peaks: Float32[np.ndarray, "sweeps scales"], kept: Bool[np.ndarray, " sweeps"]) -> Odd | None:
    """Which of the kept golden sweeps is unlike the others, if one is; the most unlike first."""
    if kept.sum() < _FEW:
        return None
    unlike = np.where(kept[:, None], peaks / usual(peaks[kept]), 0.0)
    worst, scale = (int(i) for i in np.unravel_index(unlike.argmax(), unlike.shape))
    if unlike[worst, scale] <= ODD:
        return None
    return Odd(worst, float(peaks[worst, scale]), float(np.median(peaks[kept, scale])))
