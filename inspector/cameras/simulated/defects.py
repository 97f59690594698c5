"""What can be wrong with a part: things forgotten or bent, and marks on its surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import cos, hypot, pi, sin

import numpy as np

from inspector.cameras.simulated.canvas import Canvas, Colour, Place
from inspector.cameras.simulated.features import BLACK, BRIGHT, LOOSE, TIN, Feature
from inspector.cameras.simulated.shapes import Box, Disc, Shape


@dataclass(frozen=True)
class Defect:
    """One defect of one part."""

    kind: str
    """A name in `KINDS`."""
    x: float
    y: float
    """Where it is, in units; a missing or bent thing is the nearest that is loose."""
    size: float
    """Extent in units."""
    strength: float
    seed: int


def with_defects(features: tuple[Feature, ...], defects: tuple[Defect, ...]) -> tuple[Feature, ...]:
    """The features that are left, and lie as the defects have them."""
    kept, touched = list(features), set[int]()
    for defect in (d for d in defects if d.kind in ("missing", "bent")):
        loose = [i for i, f in enumerate(features) if f.kind in LOOSE and i not in touched]
        if not loose:
            continue
        index = min(loose, key=lambda i: hypot(features[i].x - defect.x, features[i].y - defect.y))
        touched.add(index)
        kept[index] = _bent(features[index], defect)
    gone = {i for i in touched if kept[i].size == 0}
    return tuple(f for i, f in enumerate(kept) if i not in gone)


def _bent(feature: Feature, defect: Defect) -> Feature:
    if defect.kind == "missing":
        threaded = feature.kind in ("screw", "slotted", "dowel")
        return replace(feature, kind="hole", size=0.5 * feature.size) if threaded else replace(feature, size=0)
    way = 2 * pi * np.random.default_rng(defect.seed).random()
    push = 0.6 * defect.size * defect.strength
    turn = feature.angle + 1.5 * defect.size * defect.strength
    return replace(feature, x=feature.x + push * cos(way), y=feature.y + push * sin(way), angle=turn)


def mark(canvas: Canvas, defect: Defect) -> None:
    """Put the defect on the surface; nothing for those that `with_defects` sees to."""
    if defect.kind in MARKS:
        MARKS[defect.kind](canvas, defect, np.random.default_rng(defect.seed))


def _opposite(canvas: Canvas, d: Defect) -> Colour:
    """Dark on bright ground, bright on dark, so that a mark can be seen wherever it falls."""
    row, column = (
        int(np.clip(v * canvas.scale, 0, n - 1)) for v, n in zip((d.y, d.x), canvas.height.shape, strict=True)
    )
    about = max(1, round(3 * canvas.scale))
    ground = canvas.colour[max(0, row - about) : row + about + 1, max(0, column - about) : column + about + 1]
    return BLACK if float(ground.mean()) > 0.22 else BRIGHT


def _walk(d: Defect, rng: np.random.Generator, bends: int, wild: float) -> list[tuple[float, float]]:
    """A wandering line through the defect's place, about as long as its size."""
    way = rng.uniform(0, 2 * pi) + np.cumsum(rng.normal(0, wild, bends))
    steps = d.size / bends * np.stack([np.cos(way), np.sin(way)], axis=1)
    points = np.vstack([[0, 0], np.cumsum(steps, axis=0)])
    points += (d.x, d.y) - points[bends // 2]
    return [(float(x), float(y)) for x, y in points]


def _scratch(canvas: Canvas, d: Defect, rng: np.random.Generator) -> None:
    points, contrast = _walk(d, rng, 6, 0.12), min(1.0, 0.85 * d.strength)
    colour = BRIGHT if _opposite(canvas, d) == BRIGHT or canvas.colour.mean() < 0.5 else BLACK
    canvas.line(points, 1.7 * max(1.0, d.strength), colour, 0.6, rise=-0.5, alpha=contrast)


def _crack(canvas: Canvas, d: Defect, rng: np.random.Generator) -> None:
    points, contrast = _walk(d, rng, 9, 0.65), min(1.0, 0.9 * d.strength)
    branch = [points[5], *_walk(replace(d, x=points[5][0], y=points[5][1], size=d.size / 2), rng, 4, 0.7)[2:]]
    for line in (points, branch):
        canvas.line(line, 1.5 * max(1.0, d.strength), _opposite(canvas, d), 0.02, rise=-0.8, alpha=contrast)


def _spot(canvas: Canvas, d: Defect, rng: np.random.Generator) -> None:
    colour = _opposite(canvas, d)
    for _ in range(5):
        dx, dy = rng.normal(0, d.size / 8, 2)
        canvas.paint(Place(d.x + dx, d.y + dy), Disc(d.size * 0.3), colour, 0.1, min(1.0, 0.7 * d.strength))


def _pinhole(canvas: Canvas, d: Defect, rng: np.random.Generator) -> None:
    del rng
    canvas.paint(Place(d.x, d.y), Disc(d.size / 2), _opposite(canvas, d), 0.02, min(1.0, 0.95 * d.strength))
    canvas.lift(Place(d.x, d.y), Disc(d.size / 2), -2)


def _stain(canvas: Canvas, d: Defect, rng: np.random.Generator) -> None:
    colour = tuple(0.6 * c for c in BRIGHT) if _opposite(canvas, d) == BRIGHT else (0.12, 0.16, 0.20)
    for _ in range(14):
        dx, dy = rng.normal(0, d.size / 7, 2)
        blob = Disc(float(rng.uniform(0.16, 0.3)) * d.size)
        canvas.paint(
            Place(d.x + dx, d.y + dy), blob, (colour[0], colour[1], colour[2]), 0.3, min(1.0, 0.13 * d.strength)
        )


def _extra(canvas: Canvas, d: Defect, rng: np.random.Generator) -> None:
    """A chip or a drop of solder that does not belong there."""
    place = Place(d.x, d.y, float(rng.uniform(0, 180)))
    shape: Shape = Disc(d.size / 2) if rng.random() < 0.5 else Box(d.size, d.size * 0.6, 2)
    canvas.paint(place, shape, TIN if _opposite(canvas, d) == BRIGHT else BRIGHT, 0.8, min(1.0, d.strength))
    canvas.lift(place, shape, 4 * min(1.5, d.strength), 1.2)


MARKS: dict[str, Callable[[Canvas, Defect, np.random.Generator], None]] = {
    "scratch": _scratch, "spot": _spot, "extra": _extra, "stain": _stain, "crack": _crack, "pinhole": _pinhole,
}  # fmt: skip
USUAL_SIZE = {
    "scratch": 46.0, "spot": 13.0, "missing": 0.0, "extra": 15.0, "stain": 40.0, "crack": 42.0, "pinhole": 6.0,
    "bent": 9.0,
}  # fmt: skip
"""Extent in units; of what is bent: how far it is pushed. What is missing has its own size."""
KINDS = tuple(USUAL_SIZE)
