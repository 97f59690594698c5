"""How far a picture lies outside of what may be, pixel by pixel, and what of that is forgiven."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from models.patches import GAP, Patches, drawn_out
from models.registration import shrink_by

BRIGHT, DARK = 0, 1
Pair = tuple[np.ndarray, np.ndarray]
_EDGE = 2
"""One golden sweep cannot say how far an edge may move: two pixels either way are allowed, in pictures 320 wide."""
_FAR = 2
"""Pixels beyond that, from which on nobody calls an edge that strays the same edge."""
_LINE = 9
"""Pixels: a stretch of edge this long that strays as a whole is the part's own spread, not a notch."""
_LINES = (
    np.ones((1, _LINE), np.uint8),
    np.ones((_LINE, 1), np.uint8),
    np.eye(7, dtype=np.uint8),
    np.eye(7, dtype=np.uint8)[::-1].copy(),
)
_THICK = np.ones((4, 4), np.uint8)
_STILL_AN_EDGE = 0.6
"""Share of its contrast that an edge which only strayed must still have."""
_FAINT = 0.65
"""What is missing weighs less than what was added: a slight blur takes contrast from thin things, and adds none."""


_CACHED = 2 << 20
"""Bytes of a picture that the processor's nearer caches can be expected to hold beside what is made of it."""


def reach(shape: tuple[int, ...]) -> int:
    """How many pixels an edge may stray in pictures of this shape.

    What parts do differently is as wide as it is, and more pixels show more of it; but edges are sharper there, too:
    the reach grows with the square root of the resolution.
    """
    return round(_EDGE * float(np.sqrt(shrink_by((shape[1], shape[0])))))


def band(picture: np.ndarray) -> Pair:
    """The dark and the bright end of what may be where every edge may stray."""
    return _about(picture, reach(picture.shape))


def _about(picture: np.ndarray, by: int) -> Pair:
    """The darkest and the brightest within so many pixels."""
    return cv2.erode(picture, _square(by)), cv2.dilate(picture, _square(by))


@lru_cache
def _square(by: int) -> np.ndarray:
    return np.ones((2 * by + 1, 2 * by + 1), np.uint8)


def strongest(channels: np.ndarray) -> np.ndarray:
    """The strongest of the channels, pixel by pixel; grey as it is."""
    if channels.ndim == 2:
        return channels
    blue, green, red = cv2.split(channels)
    return cv2.max(cv2.max(blue, green), red)


@dataclass(frozen=True, eq=False)
class Excess:
    """What is too bright and too dark, asked both ways.

    The frame may not leave the band about the reference: that finds what was added. Nor may the reference leave the
    band about the frame: that finds what is missing, however thin it is.
    """

    reference: np.ndarray
    seen: np.ndarray
    planes: np.ndarray
    """(4, h, w[, 3]): added, bright and dark: how far the frame lies above the reference's band, and below it; missing,
    where the frame is too bright and too dark: how far the reference lies below the frame's band, and above it."""

    @classmethod
    def of(cls, reference: np.ndarray, about: Pair, seen: np.ndarray) -> Excess:
        """`about` is the reference's band."""
        planes = np.empty((4, *seen.shape), seen.dtype)
        h, by = len(seen), reach(seen.shape)
        # what is between a frame and its excess should fit into the cache: large pictures go strip by strip
        rows = h if seen.nbytes <= _CACHED else max(64, h * _CACHED // (4 * seen.nbytes))
        for top in range(0, h, rows):
            strip, first = slice(top, min(h, top + rows)), max(0, top - by)
            dark, bright = (each[top - first :][:rows] for each in _about(seen[first : strip.stop + by], by))
            added, missing = planes[:2, strip], planes[2:, strip]
            less(seen[strip], about[1][strip], added[0])
            less(about[0][strip], seen[strip], added[1])
            _share(less(dark, reference[strip], missing[0]), _FAINT, missing[0])
            _share(less(reference[strip], bright, missing[1]), _FAINT, missing[1])
        return cls(reference, seen, planes)

    def whole(self, polarity: int) -> np.ndarray:
        """Too bright or too dark, nothing forgiven: grey levels, never negative."""
        added: np.ndarray = self.planes[polarity]
        missing: np.ndarray = self.planes[2 + polarity]
        return cv2.max(added, missing)

    def forgiven(self, polarity: int, patches: Patches | None = None) -> np.ndarray:
        """Too bright or too dark without edges that stray; of some squares of the picture, or of all of it."""
        pictures = self.planes[polarity], self.planes[2 + polarity]
        # side by side in one picture: what is asked of both costs one call
        if patches:
            reference, seen, planes = patches.cut(self.reference), patches.cut(self.seen), patches.cut(*pictures)
        else:
            reference, seen = drawn_out(self.reference), drawn_out(self.seen)
            planes = np.concatenate([drawn_out(plane) for plane in pictures], axis=1)
        w = reference.shape[1]
        if not planes.any():
            left = planes[:, :w]
        else:
            left = _forgiven(reference, seen, planes, polarity, reach(self.seen.shape) + _FAR)
        return left if patches else left[:, GAP:-GAP]


def less(one: np.ndarray, other: np.ndarray, into: np.ndarray | None = None) -> np.ndarray:
    """The difference, never negative; made in `into`, if given."""
    left = cv2.subtract(one, other, dst=into)
    return left if left.dtype == np.uint8 else np.maximum(left, 0, out=into)


def _share(picture: np.ndarray, share: float, into: np.ndarray | None = None) -> np.ndarray:
    if picture.dtype == np.uint8:
        return cv2.convertScaleAbs(picture, dst=into, alpha=share)
    return np.multiply(picture, np.float32(share), out=into)


def _still(actual: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """White where the actual contrast is still that of an edge where one is expected, 0 elsewhere."""
    if actual.dtype == np.uint8:
        # the least whole number that is enough
        return cv2.compare(actual, cv2.convertScaleAbs(expected, alpha=_STILL_AN_EDGE, beta=0.45), cv2.CMP_GE)
    return (actual >= np.float32(_STILL_AN_EDGE) * expected) * np.float32(255)


def _forgiven(reference: np.ndarray, seen: np.ndarray, planes: np.ndarray, polarity: int, far: int) -> np.ndarray:
    """Excess without edges that stray: thin, long and close beside an edge, as etching and wear move them.

    What is thick, short, or away from edges stays: notches, spurs, spots and scratches. So does what lies where the
    expected picture shows an edge and the actual one shows none: that edge has not strayed, it is missing.

    `planes` lie side by side: what was added, the reference expected, and what is missing, the frame expected.
    """
    (dark, bright), (around_dark, around_bright) = _about(reference, far), _about(seen, far)
    if polarity == BRIGHT:
        beyond = np.concatenate([less(seen, bright), less(around_dark, reference)], axis=1)
    else:
        beyond = np.concatenate([less(dark, seen), less(reference, around_bright)], axis=1)
    varies, does = cv2.subtract(bright, dark), cv2.subtract(around_bright, around_dark)
    lines = cv2.morphologyEx(planes, cv2.MORPH_OPEN, _LINES[0])
    for line in _LINES[1:]:
        lines = cv2.max(lines, cv2.morphologyEx(planes, cv2.MORPH_OPEN, line))
    lines = cv2.min(lines, np.concatenate([_still(does, varies), _still(varies, does)], axis=1))
    # even sides have no middle: what eroding shifts, dilating must shift back
    thick = cv2.min(planes, cv2.dilate(cv2.erode(planes, _THICK, anchor=(2, 2)), _THICK, anchor=(1, 1)))
    left = cv2.max(cv2.max(cv2.subtract(planes, lines), thick), cv2.min(planes, beyond))
    w = reference.shape[1]
    return cv2.max(left[:, :w], left[:, w:])
