"""How densely a reference sweep shows its part, and where the camera should go slower."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from models.appearance import Appearance
from models.registration import shrink_by

_ENOUGH = 10.0
"""Frames that should show each spot: five places have to agree on a defect, and the rims of a picture say little."""
_FAST = 2.5
"""Times the usual step along the curve, from which on looks change faster than elsewhere."""
_TOGETHER = 2
"""Stretches that are so many places apart are told as one."""


@dataclass(frozen=True)
class Advice:
    """A stretch s_start <= s < s_end where the camera should go slower, and why, in a sentence."""

    s_start: float
    s_end: float
    said: str


@dataclass(frozen=True, eq=False)
class Sampling:
    """Of a reference sweep of n places, from each to the next; the last has none and repeats the one before."""

    s: Float[np.ndarray, " n"]
    pixels: Float[np.ndarray, " n"]
    """How far the picture moves per frame, in pixels of the frames as recorded."""
    shown: Float[np.ndarray, " n"]
    """Frames in which a spot that comes into the picture there is seen, at that pace; infinite where nothing moves."""
    curve: Float[np.ndarray, " n"]
    """How far the projected frame moves per frame, in medians of that: 1 is as usual for this sweep."""
    advice: tuple[Advice, ...]


def sampling(appearance: Appearance) -> Sampling:
    """Of an appearance. Where pictures do not move (turntables, corridors), only the curve can tell."""
    motion = shrink_by(appearance.size) * appearance.motion[:-1].astype(float)
    motion = motion if appearance.shifts else np.zeros_like(motion)
    steps = np.linalg.norm(np.diff(appearance.manifold.samples.astype(float), axis=0), axis=1)
    return sampled(appearance.s, motion, steps, appearance.size)


def sampled(
    s: Float[np.ndarray, " n"],
    motion: Float[np.ndarray, "n-1 2"],
    steps: Float[np.ndarray, " n-1"],
    size: tuple[int, int],
) -> Sampling:
    """From how the picture of this (width, height) moves from place to place, in pixels, and the projected frame.

    >>> motion = np.array([[8.0, 0], [8, 0], [40, 0], [8, 0]])
    >>> found = sampled(np.linspace(0, 1, 5), motion, np.array([1.0, 1, 2, 1]), (320, 240))
    >>> found.shown.tolist(), found.curve.tolist()
    ([40.0, 40.0, 8.0, 40.0, 40.0], [1.0, 1.0, 2.0, 1.0, 1.0])
    >>> found.advice[0].said
    'the picture moves by up to 40 pixels per frame: a spot is seen in 8 frames; go 1.2 times slower'
    """
    with np.errstate(divide="ignore"):
        shown = np.min(np.array(size) / np.abs(motion), axis=1)
    usual = float(np.median(steps))
    curve = steps / usual if usual > 0 else np.ones_like(steps)
    pixels = np.hypot(*motion.T)
    said = [*_too_few(s, pixels, shown), *_too_fast(s, curve, shown)]
    return Sampling(s, _last(pixels), _last(shown), _last(curve), tuple(sorted(said, key=lambda each: each.s_start)))


def _last(values: Float[np.ndarray, " n-1"]) -> Float[np.ndarray, " n"]:
    return np.append(values, values[-1])


def _too_few(s: np.ndarray, pixels: np.ndarray, shown: np.ndarray) -> Iterator[Advice]:
    for a, b in _stretches(shown < _ENOUGH):
        most, least = float(pixels[a:b].max()), float(shown[a:b].min())
        said = f"the picture moves by up to {most:.0f} pixels per frame: a spot is seen in {least:.0f} frames"
        yield Advice(float(s[a]), float(s[b]), f"{said}; go {_ENOUGH / least:.1f} times slower")


def _too_fast(s: np.ndarray, curve: np.ndarray, shown: np.ndarray) -> Iterator[Advice]:
    """Where pictures move and a spot is seen often enough, rich texture takes long steps, too, and does no harm."""
    for a, b in _stretches((curve > _FAST) & np.isinf(shown)):
        most = float(curve[a:b].max())
        said = f"looks change up to {most:.1f} times as fast per frame as usual; go {most:.1f} times slower"
        yield Advice(float(s[a]), float(s[b]), said)


def _stretches(where: Bool[np.ndarray, " m"]) -> Iterator[tuple[int, int]]:
    """First and one past the last of each run, those close to each other as one."""
    found = np.flatnonzero(where)
    if len(found):
        for run in np.split(found, np.flatnonzero(np.diff(found) > _TOGETHER) + 1):
            yield int(run[0]), int(run[-1]) + 1
