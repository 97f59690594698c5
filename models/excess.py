"""How far a picture lies outside of what may be, pixel by pixel, and what of that is forgiven."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool

BRIGHT, DARK = 0, 1
Pair = tuple[np.ndarray, np.ndarray]
Box = tuple[slice, slice]
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
_FAINT = 0.65
"""What is missing weighs less than what was added: a slight blur takes contrast from thin things, and adds none."""
MARGIN = 16
"""Pixels beyond a box that forgiveness inside of it looks at."""


def band(picture: np.ndarray) -> Pair:
    """The dark and the bright end of what may be where every edge may stray by two pixels."""
    return cv2.erode(picture, _EDGE), cv2.dilate(picture, _EDGE)


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
            (_fainter(_less(around[0], reference)), _fainter(_less(reference, around[1]))),
        )

    def whole(self, polarity: int) -> np.ndarray:
        """Too bright or too dark, nothing forgiven: grey levels, never negative."""
        return cv2.max(self.added[polarity], self.missing[polarity])

    def forgiven(self, polarity: int, box: Box) -> np.ndarray:
        """The same inside a box, without edges that stray."""
        added = _forgiven(self.added[polarity][box], self.reference[box], self.seen[box], polarity)
        missing = _forgiven(self.missing[polarity][box], self.seen[box], self.reference[box], 1 - polarity)
        return cv2.max(added, missing)


def _less(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    left = cv2.subtract(one, other)
    return left if left.dtype == np.uint8 else np.maximum(left, 0)


def _fainter(excess: np.ndarray) -> np.ndarray:
    return cv2.convertScaleAbs(excess, alpha=_FAINT) if excess.dtype == np.uint8 else excess * np.float32(_FAINT)


def _forgiven(excess: np.ndarray, expected: np.ndarray, actual: np.ndarray, polarity: int) -> np.ndarray:
    """Excess without edges that stray: thin, long and close beside an edge, as etching and wear move them.

    What is thick, short, or away from edges stays: notches, spurs, spots and scratches. So does what lies where the
    expected picture shows an edge and the actual one shows none: that edge has not strayed, it is missing.
    """
    if not excess.any():
        return excess
    dark, bright = cv2.erode(expected, _FAR), cv2.dilate(expected, _FAR)
    far = _less(actual, bright) if polarity == BRIGHT else _less(dark, actual)
    lines = cv2.morphologyEx(excess, cv2.MORPH_OPEN, _LINES[0])
    for line in _LINES[1:]:
        lines = cv2.max(lines, cv2.morphologyEx(excess, cv2.MORPH_OPEN, line))
    lines[_gone(dark, bright, actual)] = 0
    # even sides have no middle: what eroding shifts, dilating must shift back
    thick = cv2.min(excess, cv2.dilate(cv2.erode(excess, _THICK, anchor=(2, 2)), _THICK, anchor=(1, 1)))
    return cv2.max(cv2.max(cv2.subtract(excess, lines), thick), cv2.min(excess, far))


def _gone(dark: np.ndarray, bright: np.ndarray, actual: np.ndarray) -> Bool[np.ndarray, "h w *c"]:
    """Where an edge was expected, and there is none."""
    there = cv2.subtract(cv2.dilate(actual, _FAR), cv2.erode(actual, _FAR))
    return there < _STILL_AN_EDGE * cv2.subtract(bright, dark).astype(np.float32)
