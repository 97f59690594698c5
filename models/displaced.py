"""How a part lies that lies too far off for a sweep to be followed: by how many pixels, turned by how many degrees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from models.appearance import Appearance
from models.localise import Guide, belongs, lay
from models.registration import shrink_by, smooth
from models.tolerance import levels

_ANGLES = range(-16, 17, 4)
"""Degrees that are tried."""
_SMALL = 80
"""Width to which pictures are scaled for the search."""
_OVERLAP = 0.3
"""Share of a picture that must lie on the reference picture."""
_ALIKE = np.array([8.0, np.deg2rad(1.5)])
"""Pixels of registration, and radians, by which pictures of one sweep may differ in how the part lies."""


_FOLLOWED_PX, _FOLLOWED_DEGREES = 6.0, 1.5
"""What is tried where a sweep begins, so that a part that lies off by less is followed."""


class Displaced(NamedTuple):
    """Agreeing pictures, what they reach together, and how the part lies on them."""

    agree: int
    agreement: float
    across: float
    """Pixels of the picture, across the path: along it, lying off looks like travel."""
    degrees: float

    @property
    def is_off(self) -> bool:
        """Whether that is further than a sweep bears."""
        return abs(self.across) > _FOLLOWED_PX or abs(self.degrees) > _FOLLOWED_DEGREES


def displaced(own: Appearance, pictures: Sequence[np.ndarray], places: Sequence[int]) -> Displaced | None:
    """How the part lies, where it is the learnt one; None where too few pictures say so, and alike.

    `places` are those that the pictures would show if nothing were amiss.
    """
    guide = own.guide
    if guide.turn is not None:
        return None
    found: list[tuple[float, float, float]] = []
    for picture, place in zip(pictures, places, strict=True):
        reference = guide.path.key(min(place, own.places - 1))
        smoothed = smooth(own.ignored.filled(levels(picture)))
        pose = _searched(smooth(own.ignored.filled(own.references.get(reference).picture)), smoothed)
        registered, agreement = lay(guide, smoothed, reference, pose)
        if belongs(guide, reference, registered, agreement):
            found.append((_across(guide, reference, registered.pose), float(registered.pose[2]), min(agreement, 1.0)))
    if not found:
        return None
    lies = np.array(found)
    middle = np.median(lies[:, :2], axis=0)
    alike = lies[(np.abs(lies[:, :2] - middle) <= _ALIKE).all(axis=1)]
    across = float(middle[0]) * shrink_by(own.size)
    return Displaced(len(alike), float(alike[:, 2].sum()), across, float(np.rad2deg(middle[1])))


def _across(guide: Guide, reference: int, pose: Float[np.ndarray, " 3"]) -> float:
    """Pixels across the path where the sweep begins: a part that is turned drifts as the camera travels."""
    way = guide.path.between(0, reference)
    x, y = pose[:2] + pose[2] * np.array([-way[1], way[0]])
    u, v = guide.path.speed(reference)
    length = float(np.hypot(u, v))
    return float(np.hypot(x, y)) if length < 0.5 else float(u * y - v * x) / length


def _searched(reference: Float[np.ndarray, "h w"], seen: Float[np.ndarray, "h w"]) -> Float[np.ndarray, " 3"]:
    """The shift and turn at which a picture agrees best with a reference picture, roughly: all shifts, a few turns."""
    h, w = reference.shape
    by = max(w, h) / _SMALL
    size = (round(w / by), round(h / by))
    one, other = (cv2.resize(each, size, interpolation=cv2.INTER_AREA).astype(np.float32) for each in (reference, seen))
    best, pose = -np.inf, np.zeros(3)
    middle = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    one_mask = np.ones(one.shape, np.float32)
    for degrees in _ANGLES:
        # turned back, so that only a shift is left
        m = cv2.getRotationMatrix2D(middle, degrees, 1.0)
        back = cv2.warpAffine(other, m, size, flags=cv2.INTER_LINEAR)
        mask = cv2.warpAffine(one_mask, m, size, flags=cv2.INTER_NEAREST)
        score, (dx, dy) = _best_shift(one, one_mask, back, mask)
        if score > best:
            best, angle = score, np.deg2rad(degrees)
            c, s = np.cos(angle), np.sin(angle)
            pose = np.array([by * (c * dx - s * dy), by * (s * dx + c * dy), angle])
    return pose


def _best_shift(
    one: np.ndarray, one_mask: np.ndarray, other: np.ndarray, other_mask: np.ndarray
) -> tuple[float, tuple[int, int]]:
    """Correlation of the overlap at the best shift of `other` against `one`, and that shift (Padfield, CVPR 2010)."""
    h, w = one.shape
    shape = (2 * h, 2 * w)
    f, fm = (np.fft.rfft2(each, shape) for each in (one * one_mask, one_mask))
    g, gm = (np.conj(np.fft.rfft2(each, shape)) for each in (other * other_mask, other_mask))
    f2, g2 = np.fft.rfft2(one * one * one_mask, shape), np.conj(np.fft.rfft2(other * other * other_mask, shape))
    count = np.maximum(np.fft.irfft2(fm * gm, shape), 1.0)
    sum_f, sum_g = np.fft.irfft2(f * gm, shape), np.fft.irfft2(fm * g, shape)
    top = np.fft.irfft2(f * g, shape) - sum_f * sum_g / count
    var_f = np.fft.irfft2(f2 * gm, shape) - sum_f**2 / count
    var_g = np.fft.irfft2(fm * g2, shape) - sum_g**2 / count
    ncc = top / np.sqrt(np.maximum(var_f * var_g, (count * 4.0) ** 2))
    ncc[count < _OVERLAP * h * w] = -1.0
    y, x = np.unravel_index(int(ncc.argmax()), ncc.shape)
    # `one` shows at p what `other` shows at p - shift
    dx, dy = (int(x) if x < w else int(x) - 2 * w), (int(y) if y < h else int(y) - 2 * h)
    return float(ncc[y, x]), (-dx, -dy)
