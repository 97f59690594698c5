"""How far a picture lies outside of what may be, pixel by pixel, and what of that is forgiven."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from models.registration import shrink_by

BRIGHT, DARK = 0, 1
Pair = tuple[np.ndarray, np.ndarray]
Box = tuple[slice, slice]
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
MARGIN = 16
"""Pixels beyond a box that forgiveness inside of it looks at."""


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
    added: Pair
    """How far the frame lies above the reference's band, and below it."""
    missing: Pair
    """How far the reference lies below the frame's band, where the frame is too bright; and above it."""

    @classmethod
    def of(cls, reference: np.ndarray, about: Pair, seen: np.ndarray) -> Excess:
        """`about` is the reference's band."""
        around = band(seen)
        return cls(
            reference,
            seen,
            (_less(seen, about[1]), _less(about[0], seen)),
            (_share(_less(around[0], reference), _FAINT), _share(_less(reference, around[1]), _FAINT)),
        )

    def whole(self, polarity: int) -> np.ndarray:
        """Too bright or too dark, nothing forgiven: grey levels, never negative."""
        return cv2.max(self.added[polarity], self.missing[polarity])

    def forgiven(self, polarity: int, box: Box) -> np.ndarray:
        """The same inside a box, without edges that stray."""
        far = reach(self.seen.shape) + _FAR
        expected, actual = (Local.of(picture[box], far) for picture in (self.reference, self.seen))
        added = _forgiven(self.added[polarity][box], expected, actual, polarity)
        missing = _forgiven(self.missing[polarity][box], actual, expected, 1 - polarity)
        return cv2.max(added, missing)


@dataclass(frozen=True, eq=False)
class Local:
    """A picture with the darkest and the brightest about each pixel."""

    picture: np.ndarray
    dark: np.ndarray
    bright: np.ndarray

    @classmethod
    def of(cls, picture: np.ndarray, by: int) -> Local:
        """As far as so many pixels about."""
        return cls(picture, *_about(picture, by))

    @property
    def contrast(self) -> np.ndarray:
        """How much the picture varies there."""
        return cv2.subtract(self.bright, self.dark)


def _less(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    left = cv2.subtract(one, other)
    return left if left.dtype == np.uint8 else np.maximum(left, 0)


def _share(picture: np.ndarray, share: float) -> np.ndarray:
    return cv2.convertScaleAbs(picture, alpha=share) if picture.dtype == np.uint8 else picture * np.float32(share)


def _forgiven(excess: np.ndarray, expected: Local, actual: Local, polarity: int) -> np.ndarray:
    """Excess without edges that stray: thin, long and close beside an edge, as etching and wear move them.

    What is thick, short, or away from edges stays: notches, spurs, spots and scratches. So does what lies where the
    expected picture shows an edge and the actual one shows none: that edge has not strayed, it is missing.
    """
    if not excess.any():
        return excess
    seen = actual.picture
    far = _less(seen, expected.bright) if polarity == BRIGHT else _less(expected.dark, seen)
    lines = cv2.morphologyEx(excess, cv2.MORPH_OPEN, _LINES[0])
    for line in _LINES[1:]:
        lines = cv2.max(lines, cv2.morphologyEx(excess, cv2.MORPH_OPEN, line))
    lines[actual.contrast < np.float32(_STILL_AN_EDGE) * expected.contrast] = 0
    # even sides have no middle: what eroding shifts, dilating must shift back
    thick = cv2.min(excess, cv2.dilate(cv2.erode(excess, _THICK, anchor=(2, 2)), _THICK, anchor=(1, 1)))
    return cv2.max(cv2.max(cv2.subtract(excess, lines), thick), cv2.min(excess, far))
