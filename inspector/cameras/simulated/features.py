"""What parts are assembled of: each kind of feature, drawn as colour, relief and gloss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from inspector.cameras.simulated.canvas import Canvas, Colour, Place
from inspector.cameras.simulated.shapes import Box, Disc, Hexagon, Ring

STEEL: Colour = (0.60, 0.60, 0.58)
BRIGHT: Colour = (0.74, 0.74, 0.73)
DARK: Colour = (0.05, 0.05, 0.05)
BLACK: Colour = (0.10, 0.09, 0.09)
WHITE: Colour = (0.86, 0.88, 0.88)
GOLD: Colour = (0.25, 0.58, 0.75)
TIN: Colour = (0.66, 0.66, 0.64)
BROWN: Colour = (0.20, 0.30, 0.42)


@dataclass(frozen=True)
class Feature:
    """One thing on a part."""

    kind: str
    """A name in `FEATURES`."""
    x: float
    y: float
    size: float
    """Radius of round things, length of long ones, in units; letters: their height."""
    angle: float = 0.0
    """Degrees."""
    label: str = ""

    @property
    def place(self) -> Place:
        """Where it lies."""
        return Place(self.x, self.y, self.angle)


def draw(canvas: Canvas, feature: Feature) -> None:
    """Put the feature on the canvas."""
    FEATURES[feature.kind](canvas, feature)


def _screw(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Disc(f.size * 1.55), BRIGHT, 0.5)
    canvas.lift(f.place, Disc(f.size * 1.55), 1.5)
    canvas.paint(f.place, Disc(f.size), STEEL, 0.6)
    canvas.lift(f.place, Disc(f.size), 8)
    canvas.paint(f.place, Ring(f.size * 0.8, f.size * 0.92), BRIGHT, 0.9, 0.6)
    canvas.paint(f.place, Hexagon(f.size * 0.48), DARK, 0.1)
    canvas.lift(f.place, Hexagon(f.size * 0.52), -5)


def _slotted(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Disc(f.size), GOLD, 0.5)
    canvas.lift(f.place, Disc(f.size), 4, 0.8)
    canvas.paint(f.place, Box(1.7 * f.size, 0.32 * f.size, 0.5), DARK, 0.1)
    canvas.lift(f.place, Box(1.7 * f.size, 0.4 * f.size, 0.5), -3)


def _hole(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Disc(f.size * 1.35), BRIGHT, 0.7)
    canvas.lift(f.place, Disc(f.size * 1.35), -0.35 * f.size, 1.0)
    canvas.paint(f.place, Disc(f.size), DARK, 0.02)
    canvas.lift(f.place, Disc(f.size), -18)


def _boss(canvas: Canvas, f: Feature) -> None:
    canvas.lift(f.place, Disc(f.size + 5), 4, 0.7)
    canvas.lift(f.place, Disc(f.size), 15, 1.5)
    canvas.level(f.place, Disc(f.size - 8), 25)
    canvas.paint(f.place, Disc(f.size - 7), BRIGHT, 0.35)
    for radius in np.arange(f.size * 0.5, f.size - 8, 2.6):
        canvas.paint(f.place, Ring(radius, radius + 1.1), STEEL, 0.45, 0.35)
    _hole(canvas, Feature("hole", f.x, f.y, f.size * 0.36))


def _pocket(canvas: Canvas, f: Feature) -> None:
    outline = Box(f.size, f.size * 0.55, 9)
    canvas.paint(f.place, outline, (0.40, 0.40, 0.39), 0.2)
    for k in np.arange(-f.size / 2 + 11, f.size / 2 - 10, 4.6):
        canvas.paint(f.place.at(float(k), 0), Box(1.2, f.size * 0.55 - 18), (0.50, 0.50, 0.49), 0.3, 0.35)
    canvas.lift(f.place, outline, -12)


def _slot(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Box(f.size + 5, 19, 9.5), BRIGHT, 0.5)
    canvas.paint(f.place, Box(f.size, 14, 7), (0.16, 0.16, 0.16), 0.05)
    canvas.lift(f.place, Box(f.size + 3, 17, 8.5), -14)


def _groove(canvas: Canvas, f: Feature) -> None:
    canvas.lift(f.place, Disc(f.size + 6), -3)
    canvas.paint(f.place, Disc(f.size + 3), STEEL, 0.4)
    canvas.paint(f.place, Ring(f.size * 0.74, f.size), BLACK, 0.25)
    canvas.lift(f.place, Ring(f.size * 0.72, f.size * 1.02), 3, 0.8)
    _hole(canvas, Feature("hole", f.x, f.y, f.size * 0.4))


def _dowel(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Disc(f.size + 1.2), DARK, 0.05)
    canvas.paint(f.place, Disc(f.size), WHITE, 0.8)
    canvas.lift(f.place, Disc(f.size), 4)


def _rib(canvas: Canvas, f: Feature) -> None:
    canvas.lift(f.place, Box(f.size, 30, 15), 13, 1.1)
    canvas.paint(f.place, Box(f.size - 26, 4, 2), BRIGHT, 0.3, 0.35)


def _pad(canvas: Canvas, f: Feature) -> None:
    """A machined pad on a casting, with its thread."""
    canvas.lift(f.place, Box(f.size, f.size * 0.8, 12), 12, 0.9)
    canvas.level(f.place, Box(f.size - 24, f.size * 0.8 - 24, 5), 18)
    canvas.paint(f.place, Box(f.size - 22, f.size * 0.8 - 22, 5), BRIGHT, 0.45)
    for k in np.arange(-f.size / 2 + 14, f.size / 2 - 14, 3.4):
        canvas.paint(f.place.at(float(k), 0), Box(1.0, f.size * 0.8 - 26), STEEL, 0.3, 0.4)
    _hole(canvas, Feature("hole", f.x, f.y, f.size * 0.14))


def _engraved(canvas: Canvas, f: Feature) -> None:
    canvas.text(f.place, f.label, f.size, (0.22, 0.22, 0.22), 1.2)


def _embossed(canvas: Canvas, f: Feature) -> None:
    canvas.text(f.place, f.label, f.size, None, -4.0)


def _printed(canvas: Canvas, f: Feature) -> None:
    canvas.text(f.place, f.label, f.size, WHITE, 0.0)


def _sticker(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Box(f.size, f.size * 0.55, 3), WHITE, 0.1)
    canvas.lift(f.place, Box(f.size, f.size * 0.55, 3), 0.5)
    canvas.text(f.place.at(0, -f.size * 0.14), f.label, f.size * 0.12, BLACK)
    bars = np.random.default_rng([len(f.label), *map(ord, f.label)])
    x = -f.size * 0.4
    while x < f.size * 0.38:
        width = float(bars.integers(1, 4)) * f.size * 0.012
        canvas.paint(f.place.at(x + width / 2, f.size * 0.1), Box(width, f.size * 0.18), BLACK)
        x += width + float(bars.integers(1, 4)) * f.size * 0.014


def _chip(canvas: Canvas, f: Feature) -> None:
    """A package with gull-wing leads on two sides."""
    body = f.size * 0.55
    for k in np.arange(-f.size / 2 + 5, f.size / 2 - 2, 8.0):
        for side in (-1, 1):
            lead = f.place.at(float(k), side * (body / 2 + 4.5))
            canvas.paint(lead.at(0, side * 2.5), Box(5.4, 11, 1), TIN, 0.5)
            canvas.paint(lead, Box(3.2, 9), BRIGHT, 0.7)
            canvas.lift(lead, Box(3.2, 11, 1), 1.5)
    canvas.paint(f.place, Box(f.size, body, 1.5), BLACK, 0.12)
    canvas.lift(f.place, Box(f.size, body, 1.5), 9)
    canvas.paint(f.place.at(-f.size / 2 + 9, body / 2 - 9), Disc(2.6), (0.22, 0.22, 0.22), 0.3)
    canvas.text(f.place.at(0, -body * 0.1), f.label, min(9.0, body * 0.22), (0.55, 0.56, 0.56))


def _resistor(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Box(f.size * 1.35, f.size * 0.66, 1), TIN, 0.5)
    canvas.paint(f.place, Box(f.size, f.size * 0.5), TIN, 0.8)
    canvas.lift(f.place, Box(f.size, f.size * 0.5), 3)
    canvas.paint(f.place, Box(f.size * 0.62, f.size * 0.5), BLACK if f.label else BROWN, 0.15)
    canvas.text(f.place, f.label, f.size * 0.24, WHITE) if f.label else None


def _can(canvas: Canvas, f: Feature) -> None:
    """An electrolytic capacitor: the tallest thing on the board."""
    canvas.paint(f.place, Box(2.2 * f.size, 2.2 * f.size, 4), BLACK, 0.1)
    canvas.lift(f.place, Box(2.2 * f.size, 2.2 * f.size, 4), 4)
    canvas.paint(f.place, Disc(f.size), TIN, 0.5)
    canvas.lift(f.place, Disc(f.size), 22)
    canvas.paint(f.place.at(-f.size * 0.52, 0), Box(f.size * 0.4, f.size * 0.95, 2), BLACK, 0.1)
    canvas.text(f.place.at(f.size * 0.15, 0, 90), f.label, f.size * 0.28, BLACK)


def _crystal(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Box(f.size, f.size * 0.42, f.size * 0.21), BRIGHT, 0.6)
    canvas.lift(f.place, Box(f.size, f.size * 0.42, f.size * 0.21), 9)
    canvas.text(f.place, f.label, f.size * 0.11, (0.3, 0.3, 0.3), 0.4)


def _connector(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Box(f.size, 34, 2), (0.80, 0.83, 0.84), 0.1)
    canvas.lift(f.place, Box(f.size, 34, 2), 14)
    canvas.lift(f.place, Box(f.size - 8, 22, 2), -8)
    canvas.paint(f.place, Box(f.size - 12, 18, 2), (0.50, 0.53, 0.54), 0.05)
    for k in np.arange(-f.size / 2 + 14, f.size / 2 - 10, 11.0):
        canvas.paint(f.place.at(float(k), 0), Box(4.5, 4.5, 0.5), GOLD, 0.8)
        canvas.lift(f.place.at(float(k), 0), Box(4.5, 4.5, 0.5), 4)


def _via(canvas: Canvas, f: Feature) -> None:
    canvas.paint(f.place, Disc(f.size), GOLD, 0.6)
    canvas.lift(f.place, Disc(f.size), 0.6)
    canvas.paint(f.place, Disc(f.size * 0.45), DARK, 0.05)


FEATURES: dict[str, Callable[[Canvas, Feature], None]] = {
    "screw": _screw, "slotted": _slotted, "hole": _hole, "boss": _boss, "pocket": _pocket, "slot": _slot,
    "groove": _groove, "dowel": _dowel, "rib": _rib, "pad": _pad, "engraved": _engraved, "embossed": _embossed,
    "printed": _printed, "sticker": _sticker, "chip": _chip, "resistor": _resistor, "can": _can,
    "crystal": _crystal, "connector": _connector, "via": _via,
}  # fmt: skip
LOOSE = ("screw", "slotted", "dowel", "groove", "sticker", "chip", "resistor", "can", "crystal", "connector")
"""Kinds that an assembler can forget or bend."""
