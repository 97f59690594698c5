"""The drawn parts: plates, boards and castings, each in any number of designs, each design in any number of units."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import cv2
import numpy as np

from inspector.cameras.simulated.canvas import HEIGHT, WIDTH, Canvas, Colour, Place
from inspector.cameras.simulated.features import GOLD, Feature, draw
from inspector.cameras.simulated.shapes import Box

KINDS = ("plate", "board", "casting")
CELL = 114.0
BENCH: Colour = (0.13, 0.12, 0.12)


@dataclass(frozen=True)
class Part:
    """A product by kind and design number, and the individual by `unit`; unit 0 is the drawing itself."""

    kind: str
    design: int
    unit: int = 0

    @staticmethod
    def named(text: str) -> Part:
        """`board`, `plate3`, or a bare number, which counts through the kinds.

        >>> Part.named("5")
        Part(kind='board', design=2, unit=0)
        """
        match = re.fullmatch(r"([a-z]*)(\d*)", text)
        if not match or not text or (match[1] and match[1] not in KINDS):
            raise ValueError(text)
        number = int(match[2] or 1) - 1
        if number < 0:
            raise ValueError(text)
        return Part(match[1], number + 1) if match[1] else Part(KINDS[number % 3], number // 3 + 1)

    def rng(self, purpose: int, unit: int = 0) -> np.random.Generator:
        """Chance that is the same whenever this part is drawn."""
        return np.random.default_rng([KINDS.index(self.kind), self.design, unit, purpose])


def features_of(part: Part) -> tuple[Feature, ...]:
    """What is on this unit: the design's features, each moved by what manufacturing lets through."""
    features = LAYOUTS[part.kind](part)
    return features if part.unit == 0 else tuple(_natural(features, part.rng(2, part.unit)))


def draw_part(part: Part, features: tuple[Feature, ...], scale: float) -> Canvas:
    """The part lying on its bench."""
    canvas = Canvas.blank(scale, BENCH)
    BLANKS[part.kind](canvas, part)
    for feature in features:
        draw(canvas, feature)
    _grain(canvas, part, sigma=(0.7, 0.7), shade=0.02, relief=0.05, purpose=5)
    return canvas


def _natural(features: tuple[Feature, ...], rng: np.random.Generator) -> list[Feature]:
    moved: list[Feature] = []
    for f in features:
        dx, dy = np.clip(rng.normal(0, 0.15, 2), -0.3, 0.3)
        turn = rng.uniform(-6, 6) if f.kind in ("screw", "slotted") else rng.normal(0, 0.12)
        moved.append(replace(f, x=f.x + float(dx), y=f.y + float(dy), angle=f.angle + float(turn)))
    return moved


def _cells(rng: np.random.Generator, columns: int, rows: int) -> list[tuple[float, float]]:
    """Cell centres in random order, so that a layout can deal its features out."""
    pitch_x, pitch_y = (WIDTH - 130) / columns, (HEIGHT - 110) / rows
    grid = [(65 + (c + 0.5) * pitch_x, 55 + (r + 0.5) * pitch_y) for c in range(columns) for r in range(rows)]
    return [grid[i] for i in rng.permutation(len(grid))]


def _plate(part: Part) -> tuple[Feature, ...]:
    rng = part.rng(1)
    corners = [(x, y) for x in (52, WIDTH / 2, WIDTH - 52) for y in (52, HEIGHT - 52)]
    features = [Feature("screw", x, y, 12, float(rng.uniform(0, 60))) for x, y in corners]
    deck = ["boss"] * 4 + ["pocket"] * 4 + ["groove"] * 3 + ["slot"] * 3 + ["screws"] * 4 + ["holes"] * 4 + ["mark"] * 3
    deck += ["sticker"]
    for kind, (column, row) in zip(deck, _cells(rng, 7, 4), strict=False):
        x, y = column + float(rng.uniform(-8, 8)), row + float(rng.uniform(-6, 6))
        turn = float(rng.choice([0, 90]))
        if kind == "screws":
            features += [
                Feature("screw", x + d, y + e, 9, float(rng.uniform(0, 60))) for d, e in ((-24, -14), (22, 18))
            ]
            features.append(Feature("dowel", x + 20, y - 20, 6))
        elif kind == "holes":
            features += [
                Feature("hole", x + d, y + e, float(rng.uniform(4, 8))) for d in (-26, 0, 26) for e in (-16, 18)
            ]
        elif kind == "mark":
            features += [Feature("engraved", x, y - 10, 13, 0, f"{_word(rng)}-{rng.integers(10, 99)}")]
            features += [Feature("engraved", x, y + 14, 8, 0, f"M{rng.integers(4, 12)} x {rng.integers(8, 40)}")]
        else:
            size = {"boss": 38, "pocket": 92, "groove": 30, "slot": 64, "sticker": 86}[kind]
            size *= float(rng.uniform(0.85, 1.08))
            features.append(
                Feature(kind, x, y, size, turn if kind == "slot" else 0, f"SN {rng.integers(10000, 99999)}")
            )
    return tuple(features)


def _board(part: Part) -> tuple[Feature, ...]:
    rng = part.rng(1)
    corners = [(x, y) for x in (50, WIDTH - 50) for y in (50, HEIGHT - 50)]
    features = [Feature("slotted", x, y, 13, float(rng.uniform(0, 180))) for x, y in corners]
    deck = ["chip"] * 6 + ["can"] * 4 + ["crystal"] * 2 + ["connector"] * 3 + ["passives"] * 9 + ["sticker"]
    for kind, (column, row) in zip(deck, _cells(rng, 7, 4), strict=False):
        x, y = column + float(rng.uniform(-8, 8)), row + float(rng.uniform(-5, 5))
        letter = {"chip": "U", "can": "C", "crystal": "Y", "connector": "J"}.get(kind, "S")
        name = f"{letter}{rng.integers(1, 99)}"
        if kind == "passives":
            for d in (-33, 0, 33):
                for e in (-22, 20):
                    label = f"{rng.integers(10, 99)}{rng.integers(1, 5)}" if rng.random() < 0.6 else ""
                    turn = float(rng.choice([0, 90]))
                    features.append(Feature("resistor", x + d, y + e, float(rng.choice([17, 21])), turn, label))
            features.append(Feature("printed", x, y - 42, 6, 0, f"R{rng.integers(10, 99)}  C{rng.integers(10, 99)}"))
            continue
        size = {"chip": 84, "can": 25, "crystal": 72, "connector": 88, "sticker": 80}[kind]
        label = {"chip": f"{_word(rng)}{rng.integers(100, 999)}", "can": f"{rng.choice([47, 100, 220])}"}.get(
            kind, name
        )
        features.append(Feature(kind, x, y, size * float(rng.uniform(0.9, 1.05)), 0, label))
        features.append(Feature("printed", x - 30, y - 43, 7, 0, name))
    return tuple(features)


def _casting(part: Part) -> tuple[Feature, ...]:
    rng = part.rng(1)
    features: list[Feature] = []
    deck = ["boss"] * 5 + ["pad"] * 4 + ["rib"] * 5 + ["pocket"] * 3 + ["screw"] * 4 + ["embossed"] * 3 + ["hole"] * 2
    for kind, (column, row) in zip(deck, _cells(rng, 7, 4), strict=False):
        x, y = column + float(rng.uniform(-8, 8)), row + float(rng.uniform(-6, 6))
        size = {"boss": 42, "pad": 90, "rib": 104, "pocket": 96, "screw": 13, "embossed": 19, "hole": 15}[kind]
        turn = {"rib": float(rng.choice([0, 90, 35, -35])), "screw": float(rng.uniform(0, 60))}.get(kind, 0.0)
        label = f"{_word(rng)} {rng.integers(2, 9)}"
        features.append(Feature(kind, x, y, size * float(rng.uniform(0.85, 1.08)), turn, label))
        if kind in ("pocket", "embossed", "rib"):
            features.append(Feature("dowel", x + 46, y - 36, 7))
    return tuple(features)


def _word(rng: np.random.Generator) -> str:
    return "".join(rng.choice(list("ABDEHKLMNPRSTX"), 3))


def _blank_plate(canvas: Canvas, part: Part) -> None:
    _slab(canvas, (0.46, 0.46, 0.45), 0.30)
    _grain(canvas, part, sigma=(16, 0.55), shade=0.075, relief=0.10, purpose=3)


def _blank_casting(canvas: Canvas, part: Part) -> None:
    _slab(canvas, (0.33, 0.34, 0.35), 0.14)
    _grain(canvas, part, sigma=(1.1, 1.1), shade=0.05, relief=0.14, purpose=3)
    _grain(canvas, part, sigma=(3, 3), shade=0.05, relief=0.25, purpose=4)


def _blank_board(canvas: Canvas, part: Part) -> None:
    _slab(canvas, (0.17, 0.30, 0.10), 0.12)
    _grain(canvas, part, sigma=(1.0, 1.0), shade=0.03, relief=0.05, purpose=3)
    rng = part.rng(6)
    for _ in range(90):
        x, y = float(rng.uniform(50, WIDTH - 50)), float(rng.uniform(45, HEIGHT - 45))
        points, width = [(x, y)], float(rng.choice([1.6, 2.2, 3.6]))
        for step in rng.choice([24, 40, 64], 4):
            dx, dy = [(1, 0), (0, 1), (-1, 0), (0, -1), (0.7, 0.7), (0.7, -0.7)][rng.integers(6)]
            x = float(np.clip(x + dx * step, 40, WIDTH - 40))
            y = float(np.clip(y + dy * step, 40, HEIGHT - 40))
            points.append((x, y))
        canvas.line(points, width, (0.27, 0.46, 0.20), 0.25, rise=0.5)
        for end in (points[0], points[-1]):
            draw(canvas, Feature("via", *end, size=4.2))
    canvas.paint(Place(WIDTH / 2, 34), Box(WIDTH - 160, 4, 2), GOLD, 0.4, 0.5)


def _slab(canvas: Canvas, colour: Colour, gloss: float) -> None:
    middle, outline = Place(WIDTH / 2, HEIGHT / 2), Box(WIDTH - 44, HEIGHT - 44, 14)
    canvas.paint(middle, outline, colour, gloss)
    canvas.lift(middle, outline, 6, 1.2)


def _grain(
    canvas: Canvas, part: Part, sigma: tuple[float, float], *, shade: float, relief: float, purpose: int
) -> None:
    """Texture of the surface: most of it the design's own, so that units resemble each other, the rest the unit's."""
    own = 0.35 if part.unit else 0.0
    noise = np.sqrt(1 - own**2) * _field(canvas, part.rng(purpose), sigma)
    if own:
        noise += own * _field(canvas, part.rng(purpose, part.unit), sigma)
    canvas.colour[:] *= 1 + np.float32(shade) * noise[..., None]
    canvas.height[:] += np.float32(relief) * noise


def _field(canvas: Canvas, rng: np.random.Generator, sigma: tuple[float, float]) -> np.ndarray:
    """Smooth noise of variance 1, drawn at one pixel per unit so that every scale shows the same texture."""
    noise: np.ndarray = cv2.GaussianBlur(
        rng.standard_normal((HEIGHT, WIDTH), np.float32), (0, 0), sigma[0], sigmaY=sigma[1]
    )
    noise = noise / np.float32(np.std(noise))
    size = (canvas.height.shape[1], canvas.height.shape[0])
    return noise if size == (WIDTH, HEIGHT) else cv2.resize(noise, size, interpolation=cv2.INTER_CUBIC)


LAYOUTS = {"plate": _plate, "board": _board, "casting": _casting}
BLANKS = {"plate": _blank_plate, "board": _blank_board, "casting": _blank_casting}
