"""A detectability map as one picture: over the part, along the sweep, over the camera's picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np

from inspector import drawing
from inspector.detectability_report import middle, source
from inspector.drawing import FAINT, INK, PAPER, RULE, Colour
from models.appearance import Appearance
from models.defects import Kind
from models.detectability import Detectability

WIDTH, PAD = 1400, 24
_CHART = 118
_LADDER = np.array([(204, 255, 255), (118, 217, 254), (60, 141, 253), (28, 26, 227), (38, 0, 128)], float)
"""Pale yellow for what is caught when small, dark red for what must be large: blue, green, red."""
_NONE, _HATCH, _UNTRIED = (70, 70, 70), (190, 190, 190), (240, 240, 240)
_LINES: tuple[Colour, ...] = ((190, 150, 90), (130, 80, 20), (70, 30, 0))
"""From the weakest contrast to the strongest."""
_PALE = 0.45
"""Of the part's own picture under the colours."""


def picture(found: Detectability, appearance: Appearance, name: str) -> np.ndarray:
    """The whole picture (h, w, 3)."""
    contrast = middle(found)
    blocks = [
        _header(found, name),
        _legend(found),
        _title(f"Over the part: smallest defect of {contrast:g} grey levels that is caught, px"),
        _mosaics(found, appearance, contrast),
        _title("Along the sweep: thick line the usual size, thin line the worst place; picture rim left out"),
        *(_chart(found, kind) for kind in found.kinds),
        _title(
            f"Over the camera's picture, {contrast:g} grey levels: what a defect that lies there needs, all its way"
        ),
        _fields(found, contrast, ("usual", "worst")),
    ]
    return np.vstack([*blocks, drawing.blank(WIDTH, PAD)])


def _header(found: Detectability, name: str) -> np.ndarray:
    paper = drawing.blank(WIDTH, 84)
    drawing.write(paper, f"{name}: what can be found, and where not", (PAD, 40), size=0.9)
    said = (
        f"synthetic defects put into {source(found)}; {len(found.sites)} sites {found.spacing:.0f} px apart, picture "
        f"{found.size[0]}x{found.size[1]}, lens blur {found.blur:.1f} px"
    )
    drawing.write(paper, said, (PAD, 68), FAINT, 0.5)
    return paper


def _title(text: str) -> np.ndarray:
    paper = drawing.blank(WIDTH, 46)
    cv2.line(paper, (PAD, 10), (WIDTH - PAD, 10), RULE, 1)
    drawing.write(paper, text, (PAD, 34), size=0.55)
    return paper


def _step(found: Detectability, size: float) -> int:
    return int(np.abs(np.array(found.sizes) - size).argmin())


def _colour(found: Detectability, size: float) -> Colour:
    """By the step among the sizes tried."""
    at = _step(found, size) / max(len(found.sizes) - 1, 1) * (len(_LADDER) - 1)
    low = min(int(at), len(_LADDER) - 2)
    blue, green, red = (_LADDER[low] + (at - low) * (_LADDER[low + 1] - _LADDER[low])).round().astype(int)
    return int(blue), int(green), int(red)


def _hatched(height: int, width: int) -> np.ndarray:
    """Where nothing is caught."""
    y, x = np.mgrid[:height, :width]
    return np.where(((x + y) % 8 < 3)[:, :, None], np.array(_HATCH), np.array(_NONE)).astype(np.uint8)


def _painted(found: Detectability, sizes: np.ndarray) -> np.ndarray:
    """Sizes (h, w) as colours: hatched where none, blank where nothing was tried."""
    paper = np.full((*sizes.shape, 3), PAPER, np.uint8)
    paper[np.isnan(sizes)] = _UNTRIED
    for size in np.unique(sizes[np.isfinite(sizes)]):
        paper[sizes == size] = _colour(found, float(size))
    none = np.isinf(sizes)
    paper[none] = _hatched(*sizes.shape)[none]
    return paper


def _legend(found: Detectability) -> np.ndarray:
    paper = drawing.blank(WIDTH, 52)
    side, x = 46, PAD
    for size in found.sizes:
        cv2.rectangle(paper, (x, 4), (x + side - 3, 22), _colour(found, size), cv2.FILLED)
        drawing.write(paper, f"{size:g}", (x + 8, 40), INK, 0.45)
        x += side
    drawing.write(paper, "px", (x + 2, 40), INK, 0.45)
    x += 40
    for pattern, text in (
        (_hatched(19, 60), "none caught"),
        (np.full((19, 60, 3), _UNTRIED), "nothing to try: no such edge"),
    ):
        paper[4:23, x : x + 60] = pattern
        drawing.write(paper, text, (x, 40), INK, 0.45)
        x += 150
    return paper


def _mosaics(found: Detectability, appearance: Appearance, contrast: float) -> np.ndarray:
    """The part under each kind's sizes."""
    low = (-found.way).min(axis=0)
    extent = (-found.way).max(axis=0) - low + np.array(found.size)
    across = 2 if extent[0] < 2.5 * extent[1] else 1
    width = (WIDTH - 2 * PAD - (across - 1) * PAD) // across
    scale = min(width / extent[0], 420 / extent[1])
    part = _part(found, appearance, low, extent, scale)
    tiles: list[np.ndarray] = []
    for kind in found.kinds:
        paper = drawing.blank(width + PAD, part.shape[0] + 34)
        drawing.write(paper, kind.value, (0, 18), size=0.5)
        paper[26 : 26 + part.shape[0], : part.shape[1]] = _over_part(found, part, found.at(kind, contrast), low, scale)
        tiles.append(paper)
    rows = [np.hstack(tiles[i : i + across]) for i in range(0, len(tiles), across)]
    return _centred(np.vstack(rows))


def _centred(block: np.ndarray) -> np.ndarray:
    paper = drawing.blank(WIDTH, block.shape[0])
    shown = block[:, : WIDTH - PAD]
    paper[:, PAD : PAD + shown.shape[1]] = shown
    return paper


def _part(
    found: Detectability, appearance: Appearance, low: np.ndarray, extent: np.ndarray, scale: float
) -> np.ndarray:
    """The reference pictures laid side by side, grey and pale; as a sweep that comes back shows them last."""
    w, h = (max(1, round(scale * float(side))) for side in extent)
    paper = np.full((h, w), 255, np.uint8)
    size = (max(1, round(scale * found.size[0])), max(1, round(scale * found.size[1])))
    last = np.full(2, np.inf)
    for place in (int(key) for key in appearance.keys):
        point = -found.way[place] - low
        if np.hypot(*(point - last)) < found.size[0] / 6 and place != appearance.keys[-1]:
            continue
        last = point
        shown = np.clip(appearance.references.get(place).picture, 0, 255).astype(np.uint8)
        grey = shown if shown.ndim == 2 else cv2.cvtColor(shown, cv2.COLOR_BGR2GRAY)
        x, y = (int(v) for v in np.minimum((scale * point).round(), (w - size[0], h - size[1])).clip(0))
        paper[y : y + size[1], x : x + size[0]] = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)[: h - y, : w - x]
    dark, bright = np.percentile(paper, (1, 90))
    return cv2.cvtColor(cv2.convertScaleAbs(paper, alpha=255 / max(bright - dark, 1.0), beta=0), cv2.COLOR_GRAY2BGR)


def _over_part(found: Detectability, part: np.ndarray, sizes: np.ndarray, low: np.ndarray, scale: float) -> np.ndarray:
    """Colours of the nearest site over the part; where two visits see the same, of the one further from the rim."""
    coarse = 4
    h, w = part.shape[:2]
    ys, xs = np.mgrid[coarse // 2 : h : coarse, coarse // 2 : w : coarse] / scale
    best, nearest = np.full(ys.shape, np.inf), np.full(ys.shape, np.nan)
    covered = np.zeros(ys.shape, bool)
    for site, point, size in zip(found.sites, found.points - low, sizes, strict=True):
        off = np.hypot(xs - point[0], ys - point[1])
        near = off <= found.spacing
        covered |= near
        weight = off - 0.5 * min(site.depth, found.spacing)
        nearer = near & (weight < best)
        best[nearer], nearest[nearer] = weight[nearer], size
    painted = cv2.resize(_painted(found, nearest), None, fx=coarse, fy=coarse, interpolation=cv2.INTER_NEAREST)[:h, :w]
    # hatching that is drawn coarse would be a pattern of its own
    none = cv2.resize(
        np.isinf(nearest).astype(np.uint8), (painted.shape[1], painted.shape[0]), interpolation=cv2.INTER_NEAREST
    )
    painted[none > 0] = _hatched(*painted.shape[:2])[none > 0]
    shown = (
        cv2.resize(covered.astype(np.uint8), (painted.shape[1], painted.shape[0]), interpolation=cv2.INTER_NEAREST) > 0
    )
    under = part[: painted.shape[0], : painted.shape[1]].astype(np.float32)
    # the part's edges stay to be seen in the colours
    mixed = painted * (1 - _PALE + _PALE * under / 255)
    out = np.full_like(part, PAPER[0])
    out[: painted.shape[0], : painted.shape[1]][shown] = mixed[shown].astype(np.uint8)
    return out


def _chart(found: Detectability, kind: Kind) -> np.ndarray:
    """Sizes over s, a line for each contrast."""
    left, right, top, bottom = PAD + 160, WIDTH - PAD - 20, 12, 26
    paper = drawing.blank(WIDTH, _CHART + top + bottom)
    count = len(found.sizes)

    def at(s: float, size: float) -> tuple[int, int]:
        step = count if math.isinf(size) else float(np.interp(size, found.sizes, np.arange(count)))
        return round(left + s * (right - left)), round(top + _CHART * (1 - step / count))

    drawing.write(paper, kind.value, (PAD, top + 12), size=0.45)
    for number, contrast in enumerate(found.contrasts):
        y = top + 34 + 16 * number
        cv2.line(paper, (PAD, y - 4), (PAD + 18, y - 4), _line(number), 2, cv2.LINE_AA)
        drawing.write(paper, f"{contrast:g}", (PAD + 24, y), FAINT, 0.4)
    drawing.write(paper, "grey levels", (PAD, top + 34 + 16 * len(found.contrasts)), FAINT, 0.35)
    for stretch in found.weak(kind, middle(found)):
        (x0, y0), (x1, y1) = at(stretch.s_start, math.inf), at(stretch.s_end, found.sizes[0])
        if math.isinf(stretch.size):
            paper[y0:y1, x0:x1] = _hatched(y1 - y0, x1 - x0)
        else:
            cv2.rectangle(paper, (x0, y0), (x1, y1), (215, 215, 250), cv2.FILLED)
    for size in (*found.sizes[::3], math.inf):
        y = at(0, size)[1]
        cv2.line(paper, (left, y), (right, y), RULE, 1)
        drawing.write(paper, "none" if math.isinf(size) else f"{size:g}", (left - 34, y + 4), FAINT, 0.38)
    for number, contrast in enumerate(found.contrasts):
        along = found.along(kind, contrast)
        for values, thick in ((along.worst, 1), (along.usual, 3)):
            points = [
                None if math.isnan(v) else at(s, v) for s, v in zip(along.s.tolist(), values.tolist(), strict=True)
            ]
            _line_of(paper, points, _line(number), thick)
    for tenth in range(11):
        x, y = at(tenth / 10, found.sizes[0])
        cv2.line(paper, (x, y), (x, y + 4), FAINT, 1)
        drawing.write(paper, f"s {tenth / 10:g}" if tenth == 0 else f"{tenth / 10:g}", (x - 8, y + 18), FAINT, 0.4)
    return paper


def _line(number: int) -> Colour:
    return _LINES[min(number, len(_LINES) - 1)]


def _line_of(paper: np.ndarray, points: Sequence[tuple[int, int] | None], colour: Colour, thick: int) -> None:
    for before, now in pairwise(points):
        if before is not None and now is not None:
            cv2.line(paper, before, now, colour, thick, cv2.LINE_AA)
    for before, now, after in zip([None, *points[:-1]], points, [*points[1:], None], strict=True):
        if now is not None and before is None and after is None:
            cv2.circle(paper, now, thick, colour, cv2.FILLED, cv2.LINE_AA)


def _fields(found: Detectability, contrast: float, names: Sequence[str]) -> np.ndarray:
    """The camera's picture by kind: the usual size over the sweep above, the worst below."""
    count = len(found.kinds)
    width = (WIDTH - PAD - 70 - count * PAD) // count
    height = round(width * found.size[1] / found.size[0])
    rows: list[np.ndarray] = []
    both = [found.over_picture(kind, contrast) for kind in found.kinds]
    for row, name in enumerate(names):
        label = drawing.blank(70 + PAD, height + 30)
        drawing.write(label, name, (PAD, 44), size=0.5)
        tiles = [label]
        for kind, each in zip(found.kinds, both, strict=True):
            paper = drawing.blank(width + PAD, height + 30)
            if row == 0:
                drawing.write(paper, kind.value, (0, 18), size=0.5)
            rows_of, cols_of = (
                np.arange(n) * side // n for n, side in zip((height, width), each.shape[1:], strict=True)
            )
            field = each[row][rows_of[:, None], cols_of]
            paper[24 : 24 + height, :width] = _painted(found, field)
            tiles.append(paper)
        rows.append(np.hstack(tiles))
    block = np.vstack(rows)
    paper = drawing.blank(WIDTH, block.shape[0])
    paper[:, : min(WIDTH, block.shape[1])] = block[:, :WIDTH]
    return paper
