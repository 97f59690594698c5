"""Small drawn parts and a camera over them, all in memory: what the tests of the models share."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from hypothesis import settings

from models.appearance import Appearance
from models.frame import Frame
from models.inspection import begin, conclude, step
from models.learning import learn
from models.verdict import Policy, Result, ScoredFrame

FEW, MANY = (settings(max_examples=count, deadline=None) for count in (25, 80))
"""How often hypothesis tries what takes long, and what does not."""
SIZE = (160, 120)
STEP = 4.0
"""Travel of the golden sweep from frame to frame, in pixels."""
FIRST, FRAMES = 90.0, 60
"""Where the camera begins, in pixels of the surface, and for how many frames it goes on."""
INTERVAL_NS = 40_000_000
MIDDLE = 110.0
"""Where the camera stands across its path."""


@lru_cache
def surface(seed: int = 1, width: int = 440, height: int = 220) -> np.ndarray:
    """A part seen from above: grain of three sizes, and discs and bars with soft edges; float32 grey levels."""
    rng = np.random.default_rng(seed)
    ground = np.full((height, width), 110, np.float32)
    for sigma, strength in ((1.5, 6), (4, 12), (15, 18)):
        grain = cv2.GaussianBlur(rng.standard_normal((height, width)).astype(np.float32), (0, 0), sigma)
        ground += strength * grain / grain.std()
    for _ in range(width * height // 1500):
        x, y, size, level = rng.uniform((0, 0, 4, -45), (width, height, 14, 45))
        layer = np.zeros_like(ground)
        if rng.random() < 0.5:
            cv2.circle(layer, (int(x), int(y)), int(size), float(level), cv2.FILLED)
        else:
            cv2.rectangle(layer, (int(x), int(y)), (int(x + 2 * size), int(y + size)), float(level), cv2.FILLED)
        ground += layer
    drawn = np.clip(cv2.GaussianBlur(ground, (0, 0), 0.8), 20, 235)
    drawn.flags.writeable = False
    return drawn


def with_spot(part: np.ndarray, x: int, y: int, size: int = 10, level: float = 60) -> np.ndarray:
    """The part with a square added to it, `size` pixels wide about (x, y)."""
    spoilt = part.copy()
    spoilt[y - size // 2 : y - size // 2 + size, x - size // 2 : x - size // 2 + size] += level
    return np.clip(spoilt, 0, 255)


@dataclass(frozen=True)
class View:
    """How the camera sees the part: where it lies in its fixture, and the light."""

    dx: float = 0.0
    """Pixels by which the part lies off, along the path; where it is turned, at the middle of the path."""
    dy: float = 0.0
    turn: float = 0.0
    """Of the part, in radians."""
    gain: float = 1.0
    offset: float = 0.0
    shade: float = 0.0
    """Gain at the right edge less gain at the middle."""
    noise: float = 1.0
    """Standard deviation, grey levels."""
    seed: int = 0
    colour: bool = False
    deep: bool = False
    """Sixteen bits."""
    size: tuple[int, int] = SIZE


STRAIGHT = View()


def pose_of(view: View, x: float) -> np.ndarray:
    """Where the picture lies on that of a part which lies straight: shift x, shift y, rotation; camera over x."""
    c, s = np.cos(view.turn), np.sin(view.turn)
    along = x - FIRST - STEP * (FRAMES - 1) / 2
    return np.array([view.dx + (c - 1) * along, view.dy + s * along, view.turn])


def shot(part: np.ndarray, x: float, view: View = STRAIGHT, number: int = 0) -> np.ndarray:
    """The picture with the camera over (x, MIDDLE)."""
    w, h = view.size
    tx, ty, turn = pose_of(view, x)
    c, s = np.cos(turn), np.sin(turn)
    at = np.array([[c, s, x], [-s, c, MIDDLE]])
    at[:, 2] -= at[:, :2] @ np.array([(w - 1) / 2 + tx, (h - 1) / 2 + ty])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    seen = cv2.warpAffine(part, at, (w, h), flags=flags, borderMode=cv2.BORDER_REFLECT_101)
    lamp = view.gain + np.linspace(-view.shade, view.shade, w, dtype=np.float32)
    seen = seen * lamp + np.float32(view.offset)
    if view.colour:
        seen = cv2.merge([0.9 * seen, seen, 255 - 0.8 * seen])
    seen += view.noise * np.random.default_rng([view.seed, number]).standard_normal(seen.shape, np.float32)
    if view.deep:
        return np.clip(seen * 257 + 0.5, 0, 65535).astype(np.uint16)
    return np.clip(seen + 0.5, 0, 255).astype(np.uint8)


def frame(pixels: np.ndarray, number: int, start_ns: int = 0) -> Frame:
    """A picture as frame `number` of a sweep that begins at `start_ns`."""
    return Frame(pixels, start_ns + number * INTERVAL_NS, number)


def places(pace: float = 1.0, first: float = 0.0, last: float = FRAMES - 1) -> np.ndarray:
    """Where the camera stands at each frame, in frames of the golden sweep: first <= place <= last."""
    return np.arange(first, last + 1e-9, pace)


def swept(part: np.ndarray, ats: Iterable[float] | None = None, view: View = STRAIGHT) -> list[Frame]:
    """The frames of a camera that stands at those places, one after the other."""
    ats = places() if ats is None else ats
    return [frame(shot(part, FIRST + STEP * at, view, i), i) for i, at in enumerate(ats)]


@lru_cache
def golden() -> Appearance:
    """Learnt from two good sweeps of surface 1."""
    again = View(dx=0.7, dy=-1.2, gain=1.04, seed=2)
    return learn([swept(surface()), swept(surface(), view=again)])


def inspected(
    appearance: Appearance, frames: Iterable[Frame], policy: Policy | None = None
) -> tuple[Result, tuple[ScoredFrame, ...]]:
    """The verdict on a sweep, and what was said of each frame."""
    state = begin(appearance, policy)
    for each in frames:
        state, _ = step(state, each)
    return conclude(state), state.frames
