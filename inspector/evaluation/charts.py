"""Charts as inline SVG: scores against the limit, ROC curves, the score along s. Colours are the page's."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from itertools import pairwise
from math import sqrt

from inspector.evaluation.running import Inspected
from inspector.evaluation.words import area
from models.labelled import Label, Outcome, Truth
from models.measures import auroc, roc
from models.verdict import FrameState, Result

Point = tuple[float, float]

WIDTH, LEFT, RIGHT = 720, 44, 16
LANE, DOT = 72, 4.5
TICKS = (0.0, 0.25, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
SQUARE = 280


def scores_chart(parts: Sequence[Inspected]) -> str:
    """Every part's highest score, good above bad, on a root scale; those that were judged wrongly are crosses."""
    scored = [part.outcome for part in parts if part.outcome.score is not None]
    top = max([1.5, *(1.08 * (each.score or 0.0) for each in scored)])
    foot = 2 * LANE + 8
    marks: list[str] = []
    for at, tick in _ticks(top):
        marks += [_line((at, 4), (at, foot), "grid"), _text(f"{tick:g}", at, foot + 16, "middle")]
    limit = LEFT + (WIDTH - LEFT - RIGHT) * sqrt(1 / top)
    marks.append(_line((limit, 0), (limit, foot), "limit"))
    marks.append(
        _text("score (root scale); the line at 1 is the limit", (LEFT + WIDTH - RIGHT) / 2, foot + 34, "middle")
    )
    for number, label in enumerate(Label):
        middle = LANE * (number + 0.5) + 4
        marks.append(_text(label.value, 4, middle + 4, "start"))
        marks += _swarm([each for each in scored if each.label is label], middle, top)
    name = f"Scores of {len(scored)} parts against the limit"
    return _svg(WIDTH, foot + 42, name, marks)


def _ticks(top: float) -> list[Point]:
    """Where the axis is marked, and with what; no mark hides another, and the limit is among them."""
    found = [(LEFT + (WIDTH - LEFT - RIGHT) * sqrt(tick / top), tick) for tick in TICKS if tick <= top]
    limit = next(at for at, tick in found if tick == 1)
    return [(at, tick) for at, tick in found if tick in (0, 1) or (at - LEFT > 32 and abs(at - limit) > 32)]


def _swarm(parts: Iterable[Outcome], middle: float, top: float) -> list[str]:
    """A mark for each part, moved aside where it would hide another."""
    placed: list[Point] = []
    marks: list[str] = []
    offsets = sorted((k * 2 * DOT for k in range(-3, 4)), key=abs)
    for part in sorted(parts, key=lambda each: each.score or 0.0):
        x = LEFT + (WIDTH - LEFT - RIGHT) * sqrt((part.score or 0.0) / top)
        free = (
            middle + y
            for y in offsets
            if all((x - a) ** 2 + (middle + y - b) ** 2 >= (2 * DOT) ** 2 for a, b in placed)
        )
        y = next(free, middle)
        placed.append((x, y))
        marks.append(_mark(part, x, y))
    return marks


def _mark(part: Outcome, x: float, y: float) -> str:
    said = escape(f"{part.name}: {part.score:.2f}, {part.verdict}")
    if part.right:
        return f'<circle class="{part.label}" cx="{x:.1f}" cy="{y:.1f}" r="{DOT}"><title>{said}</title></circle>'
    d = f"M{x - DOT:.1f} {y - DOT:.1f}l{2 * DOT} {2 * DOT}m0 {-2 * DOT}l{-2 * DOT} {2 * DOT}"
    return f'<path class="wrong" d="{d}"><title>{said}</title></path>'


def roc_chart(outcomes: Sequence[Outcome]) -> str:
    """The ROC curves of parts, and of frames where the truth is known; nothing where neither can be drawn."""
    parts = [[each.score for each in outcomes if each.label is label and each.score is not None] for label in Label]
    known = [each.tally for each in outcomes if each.tally]
    frames = [[s for each in known for s in each.clean], [s for each in known for s in each.defective]]
    curves = [
        (name, kind, negative, positive)
        for name, kind, (negative, positive) in (("parts", "curve", parts), ("frames", "curve dashed", frames))
        if negative and positive
    ]
    if not curves:
        return ""
    left, low = LEFT + 8, SQUARE + 12
    marks = [f'<rect class="frame" x="{left}" y="12" width="{SQUARE}" height="{SQUARE}"/>']
    marks.append(_line((left, low), (left + SQUARE, 12), "grid"))
    for number, (name, kind, negative, positive) in enumerate(curves):
        points = [(left + SQUARE * float(x), low - SQUARE * float(y)) for x, y in roc(negative, positive)]
        marks.append(_path(points, kind))
        at = low - 56 + 24 * number
        marks.append(_path([(left + 76, at - 4), (left + 108, at - 4)], kind))
        marks.append(_text(f"{name}, AUROC {area(auroc(negative, positive))}", left + 114, at, "start"))
    for tick in (0.0, 0.5, 1.0):
        marks.append(_text(f"{tick:g}", left + SQUARE * tick, low + 16, "middle"))
        marks.append(_text(f"{tick:g}", left - 6, low + 4 - SQUARE * tick, "end"))
    marks.append(_text("share of good at or above a limit", left + SQUARE / 2, low + 34, "middle"))
    turned = f'transform="rotate(-90 14 {12 + SQUARE / 2})"'
    marks.append(_text("share of bad", 14, 12 + SQUARE / 2, "middle", turned))
    return _svg(left + SQUARE + 24, low + 42, "ROC curve", marks)


def along_chart(result: Result, truth: Truth | None, name: str) -> str:
    """The score of a part along s, on a root scale, with the stretches in which a defect is in view."""
    scored = [(f.s, f.score) if f.state is FrameState.SCORED and f.s is not None else None for f in result.frames]
    top = 1.08 * max([1.2, *(point[1] for point in scored if point)])
    height, foot = 132, 118
    wide = WIDTH - LEFT - RIGHT

    def at(s: float, score: float) -> Point:
        return LEFT + wide * min(max(s, 0.0), 1.0), foot - (foot - 8) * sqrt(score / top)

    marks = [_stretch(at(a, top), at(b, 0)) for a, b in _in_view(truth)]
    marks.append(_line(at(0, 0), at(1, 0), "grid"))
    marks.append(_line(at(0, 1), at(1, 1), "limit"))
    marks.append(_text("1", LEFT - 6, at(0, 1)[1] + 4, "end"))
    marks.append(_text("0", LEFT - 6, foot + 4, "end"))
    if top > 2:
        marks.append(_text(f"{top / 1.08:.1f}", LEFT - 6, at(0, top / 1.08)[1] + 4, "end"))
    marks += [_path([at(*point) for point in run], "curve thin") for run in _runs(scored)]
    marks += [_text(f"{tenth / 10:g}", at(tenth / 10, 0)[0], height + 4, "middle") for tenth in range(0, 11, 2)]
    marks.append(_text("s", LEFT - 6, height + 4, "end"))
    return _svg(WIDTH, height + 10, f"Score of {name} along s", marks)


def _runs(points: Iterable[Point | None]) -> Iterable[list[Point]]:
    """What can be drawn without a gap; of points in the same column the highest."""
    run: list[Point] = []
    for point in points:
        if point is None:
            yield run
            run = []
        elif run and round(run[-1][0] * WIDTH) == round(point[0] * WIDTH):
            run[-1] = max(run[-1], point, key=lambda each: each[1])
        else:
            run.append(point)
    yield run


def _in_view(truth: Truth | None) -> list[tuple[float, float]]:
    """Stretches of s in which a defect is in view."""
    found: list[tuple[float, float]] = []
    frames = truth.frames if truth else ()
    for before, now in pairwise(frames):
        if before.defects and now.defects:
            a, b = sorted((before.s, now.s))
            if found and a <= found[-1][1] and b >= found[-1][0]:
                found[-1] = (min(a, found[-1][0]), max(b, found[-1][1]))
            else:
                found.append((a, b))
    return found


def _svg(width: float, height: float, name: str, marks: Iterable[str]) -> str:
    return (
        f'<svg role="img" aria-label="{escape(name)}" viewBox="0 0 {width:g} {height:g}" '
        f'width="{width:g}" height="{height:g}">{"".join(marks)}</svg>'
    )


def _line(a: Point, b: Point, kind: str) -> str:
    return f'<line class="{kind}" x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}"/>'


def _stretch(a: Point, b: Point) -> str:
    """A ground from the upper left to the lower right."""
    size = f'width="{max(1.0, b[0] - a[0]):.1f}" height="{b[1] - a[1]:.1f}"'
    return f'<rect class="defect" x="{a[0]:.1f}" y="{a[1]:.1f}" {size}/>'


def _path(points: Sequence[Point], kind: str) -> str:
    if not points:
        return ""
    more = points if len(points) > 1 else [*points, points[0]]
    return f'<path class="{kind}" d="M{"L".join(f"{x:.1f} {y:.1f}" for x, y in more)}"/>'


def _text(said: str, x: float, y: float, anchor: str, more: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" {more}>{escape(said)}</text>'
