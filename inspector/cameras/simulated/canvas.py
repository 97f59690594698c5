"""The part being drawn: colour, relief and gloss, over which shapes are painted, raised and sunk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from math import atan2, cos, hypot, radians, sin

import cv2
import numpy as np

from inspector.cameras.simulated.shapes import Box, Shape

WIDTH, HEIGHT = 960, 520
"""The surface that a sweep covers, bench included, in units (px of a 320 wide picture)."""
SLOPE = 1.8
"""Rise of a wall per unit. Steeper walls could hide ground, which the renderer's fixed point cannot follow."""

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Place:
    """Where a shape's origin lies, in units, and how far it is turned, in degrees."""

    x: float
    y: float
    angle: float = 0.0

    def at(self, dx: float, dy: float, angle: float = 0.0) -> Place:
        """The place at (dx, dy) in the frame of this one."""
        c, s = cos(radians(self.angle)), sin(radians(self.angle))
        return Place(self.x + c * dx - s * dy, self.y + s * dx + c * dy, self.angle + angle)


@dataclass(frozen=True, eq=False)
class Canvas:
    """Layers of one part under work; the drawing methods change them in place."""

    scale: float
    """Pixels per unit."""
    colour: np.ndarray
    """(h, w, 3) blue, green, red albedo, 0..1."""
    height: np.ndarray
    """(h, w) relief in units, towards the camera."""
    gloss: np.ndarray
    """(h, w) strength of the mirror reflection, 0..1."""

    @staticmethod
    def blank(scale: float, colour: Colour) -> Canvas:
        """An empty bench."""
        size = (round(HEIGHT * scale), round(WIDTH * scale))
        full = np.broadcast_to(np.array(colour, np.float32), (*size, 3)).copy()
        return Canvas(scale, full, np.zeros(size, np.float32), np.full(size, 0.02, np.float32))

    def copy(self) -> Canvas:
        """The same layers, to be changed apart."""
        return replace(self, colour=self.colour.copy(), height=self.height.copy(), gloss=self.gloss.copy())

    def paint(
        self, place: Place, shape: Shape, colour: Colour | None, gloss: float | None = None, alpha: float = 1.0
    ) -> None:
        """Lay colour and gloss over the shape; `None` leaves what is there."""
        window, distance = self._window(place, shape)
        self.blend(window, np.clip(0.5 - distance * self.scale, 0, 1) * np.float32(alpha), colour, gloss)

    def blend(
        self, window: tuple[slice, slice], cover: np.ndarray, colour: Colour | None, gloss: float | None = None
    ) -> None:
        """Mix colour and gloss into a window by a cover of 0..1."""
        if colour is not None:
            self.colour[window] += cover[..., None] * (np.array(colour, np.float32) - self.colour[window])
        if gloss is not None:
            self.gloss[window] += cover * (np.float32(gloss) - self.gloss[window])

    def lift(self, place: Place, shape: Shape, height: float, slope: float = SLOPE) -> None:
        """Raise the shape (sink it, where negative) with walls inside its outline."""
        window, distance = self._window(place, shape)
        rise = np.clip(-distance * np.float32(slope), 0, abs(height))
        self.height[window] += rise if height > 0 else -rise

    def level(self, place: Place, shape: Shape, height: float) -> None:
        """Machine the shape flat at a height over the bench."""
        window, distance = self._window(place, shape)
        cover = np.clip(-distance * self.scale / 2, 0, 1)
        self.height[window] += cover * (np.float32(height) - self.height[window])

    def line(
        self,
        points: list[tuple[float, float]],
        width: float,
        colour: Colour | None,
        gloss: float | None = None,
        *,
        rise: float = 0.0,
        alpha: float = 1.0,
    ) -> None:
        """A track through points, with round ends."""
        for (x0, y0), (x1, y1) in pairwise(points):
            length = hypot(x1 - x0, y1 - y0)
            place = Place((x0 + x1) / 2, (y0 + y1) / 2, np.rad2deg(atan2(y1 - y0, x1 - x0)))
            shape = Box(length + width, width, width / 2)
            self.paint(place, shape, colour, gloss, alpha)
            if rise:
                self.lift(place, shape, rise)

    def text(self, place: Place, words: str, size: float, colour: Colour | None, depth: float = 0.0) -> None:
        """Print words (cap height `size`), centred; sunk by `depth` where they are engraved, raised where negative."""
        ink, inside = self._lettering(words, size)
        half = (ink.shape[1] / 2 / inside, ink.shape[0] / 2 / inside)
        window, (x, y) = self._local(place, hypot(*half))
        maps = [((v + h) * inside - 0.5).astype(np.float32) for v, h in zip((x, y), half, strict=True)]
        cover = cv2.remap(ink, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        self.blend(window, cover, colour)
        self.height[window] -= cover * np.float32(depth)

    def _lettering(self, words: str, size: float) -> tuple[np.ndarray, float]:
        """Cover of the words, and its pixels per unit; drawn four times finer, so that its edges are soft."""
        fine = 4.0 * max(self.scale, 0.5)
        font, stroke = cv2.FONT_HERSHEY_SIMPLEX, max(1, round(0.17 * size * fine))
        zoom = size * fine / 21.0  # a capital letter of this font is 21 px high
        (width, height), low = cv2.getTextSize(words, font, zoom, stroke)
        image = np.zeros((height + low + 2 * stroke, width + 2 * stroke), np.uint8)
        cv2.putText(image, words, (stroke, height + stroke), font, zoom, (255,), stroke, cv2.LINE_8)
        return cv2.GaussianBlur(image, (0, 0), fine / self.scale * 0.4).astype(np.float32) / 255, fine

    def _window(self, place: Place, shape: Shape) -> tuple[tuple[slice, slice], np.ndarray]:
        window, (x, y) = self._local(place, shape.reach)
        return window, shape.distance(x, y).astype(np.float32)

    def _local(self, place: Place, reach: float) -> tuple[tuple[slice, slice], tuple[np.ndarray, np.ndarray]]:
        """The pixels about a place, and their coordinates in its frame, in units."""
        spread = reach + 1.5 / self.scale
        rows, cols = (
            slice(max(0, int((v - spread) * self.scale)), max(0, min(n, int((v + spread) * self.scale) + 2)))
            for v, n in zip((place.y, place.x), self.height.shape, strict=True)
        )
        dx = np.arange(cols.start, cols.stop, dtype=np.float32)[None, :] / np.float32(self.scale) - np.float32(place.x)
        dy = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] / np.float32(self.scale) - np.float32(place.y)
        c, s = np.float32(cos(radians(place.angle))), np.float32(sin(radians(place.angle)))
        return (rows, cols), (c * dx + s * dy, c * dy - s * dx)
