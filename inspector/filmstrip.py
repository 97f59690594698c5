"""A picture per deviation: what was expected, what was seen, how they differ, at the peak and around it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from inspector import drawing
from inspector.drawing import View
from inspector.errors import OutputExists
from inspector.files import write_new
from inspector.pictures import encode_png
from inspector.report import WORDS
from models.appearance import Appearance
from models.frame import Frame
from models.inspection import Explanation, explain
from models.verdict import Deviation, FrameState, Region, Result, ScoredFrame

TILE, GUTTER, GAP, HEADER, CAPTION, CHART = 320, 92, 6, 62, 22, 128
ROWS = ("expected", "seen", "difference")
AROUND = (-2, -1, 0, 1, 2)
"""Frames shown, in steps from the peak."""


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame of a strip."""

    scored: ScoredFrame
    explanation: Explanation


def refuse_strips(folder: Path, name: str) -> None:
    """Raise where strips of that name are in the folder already."""
    for found in sorted(folder.glob(f"{name}-*.png")):
        raise OutputExists(found)


def write_filmstrips(
    folder: Path, frames: Iterable[Frame], appearance: Appearance, result: Result, name: str
) -> Iterator[Path]:
    """A PNG `name-1.png` ... per deviation, each path as it is written; `frames` are those inspected, once more.

    A deviation around which no frame was scored has no strip: there is nothing to compare. Raises OutputExists,
    NotWritten.
    """
    refuse_strips(folder, name)
    for number, picture in filmstrips(frames, appearance, result, result.deviations, name):
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{name}-{number}.png"
        write_new(path, encode_png(picture).data)
        yield path


def filmstrips(
    frames: Iterable[Frame],
    appearance: Appearance,
    result: Result,
    shown: Sequence[Deviation],
    name: str,
    *,
    around: Sequence[int] = AROUND,
) -> Iterator[tuple[int, np.ndarray]]:
    """A picture (h, w, 3) per deviation shown, with its number from 1; `frames` are those inspected, once more."""
    wanted = {number: chosen(each, result.frames, around) for number, each in enumerate(shown, start=1)}
    shots: dict[int, list[Shot]] = {number: [] for number, indices in wanted.items() if indices}
    for scored, frame in zip(result.frames, frames, strict=False):
        if not shots:
            return
        for number in [number for number in shots if scored.index in wanted[number]]:
            if (explanation := explain(appearance, frame, scored)) is not None:
                shots[number].append(Shot(scored, explanation))
            if scored.index == wanted[number][-1]:
                yield number, strip(result, shown[number - 1], shots.pop(number), name)


def peak_of(result: Result) -> Deviation | None:
    """What to show of a part: its highest deviation, or the frame that came nearest to one; None where none was scored.

    The latter is none of the result's deviations.
    """
    if wrong := [each for each in result.deviations if each.kind == "appearance"]:
        return max(wrong, key=lambda each: each.peak_score)
    scored = [frame for frame in result.frames if frame.state is FrameState.SCORED and frame.reference >= 0]
    if not scored:
        return None
    peak = max(scored, key=lambda frame: frame.score)
    s, at = peak.s or 0.0, peak.index
    return Deviation(s, s, at, at + 1, "appearance", None, peak.score, at, peak.regions)


def chosen(deviation: Deviation, frames: Sequence[ScoredFrame], around: Sequence[int] = AROUND) -> tuple[int, ...]:
    """Indices of the frames to show: the peak and some about it, of those that were compared."""
    compared = [f.index for f in frames if f.state is FrameState.SCORED and f.reference >= 0]
    if not compared:
        return ()
    peak = int(np.abs(np.array(compared) - deviation.peak_index).argmin())
    step = max(2, (deviation.index_end - deviation.index_start) // 4)
    return tuple(sorted({compared[min(max(peak + k * step, 0), len(compared) - 1)] for k in around}))


def strip(result: Result, deviation: Deviation, shots: Sequence[Shot], name: str) -> np.ndarray:
    """The whole picture (h, w, 3) for a deviation, or for the peak of a part without one, of the part of that name."""
    peak = min(shots, key=lambda shot: abs(shot.scored.index - deviation.peak_index))
    view, full = View.whole(peak.explanation.expected, TILE), _full_colour(peak)
    columns = [_column(shot, view, full, _title(shot.scored), shot is peak) for shot in shots]
    close = _close(peak, deviation, view)
    if close is not None:
        columns.append(_column(peak, close, full, f"frame {peak.scored.index}, close", True))
    grid = np.hstack([_labels(view.size[1]), *columns])
    head = _header(result, deviation, grid.shape[1], name)
    foot = _footer(result, deviation, grid.shape[1], full)
    return np.vstack([head, grid, foot])


def _title(scored: ScoredFrame) -> str:
    return f"frame {scored.index}   s {scored.s:.3f}   score {scored.score:.1f}"


def _full_colour(peak: Shot) -> float:
    """Grey levels shown in full colour: nearly the largest difference, but never so few that noise would shine."""
    difference = np.abs(drawing.signed(peak.explanation.difference))
    return float(np.clip(np.percentile(difference, 99.8), 24, 120))


def _close(peak: Shot, deviation: Deviation, view: View) -> View | None:
    """A closer look at the strongest region; None where there is none."""
    regions = peak.scored.regions or deviation.regions
    if not regions:
        return None
    corners = _corners(max(regions, key=lambda region: region.score), peak.explanation)
    low, high = corners.min(axis=0), corners.max(axis=0)
    x, y = (low + high) / 2
    extent = max(2.2 * float((high - low).max()), view.size[1] / view.scale / 6)
    return view.about(float(x), float(y), extent)


def _corners(region: Region, explanation: Explanation) -> np.ndarray:
    """(4, 2): corners of a region of the frame, on the reference picture."""
    a, b, c, d, e, f = explanation.placement
    x0, y0, x1, y1 = region.x, region.y, region.x + region.width, region.y + region.height
    seen = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], float)
    # Corners of pixels: half a pixel before their centres, in which the placement counts.
    return np.linalg.solve(np.array([[a, b], [d, e]]), (seen - 0.5 - (c, f)).T).T + 0.5


def _column(shot: Shot, view: View, full: float, title: str, emphasised: bool) -> np.ndarray:
    why = shot.explanation
    difference = drawing.signed(why.difference)
    tiles = [
        drawing.coloured(view.picture(why.expected)),
        drawing.coloured(view.picture(why.seen)),
        drawing.difference_picture(view.picture(difference), view.picture(why.expected), full),
    ]
    for region in shot.scored.regions:
        colour = drawing.BRIGHT if region.polarity == "bright" else drawing.DARK
        for tile in tiles[1:]:
            drawing.outline(tile, view.points(_corners(region, why)), colour)
    column = drawing.blank(TILE + GAP, CAPTION + 3 * (view.size[1] + GAP))
    drawing.write(column, title, (0, CAPTION - 7), drawing.INK if emphasised else drawing.FAINT)
    for row, tile in enumerate(tiles):
        top = CAPTION + row * (view.size[1] + GAP)
        column[top : top + view.size[1], :TILE] = tile
    if emphasised:
        cv2.line(column, (0, CAPTION - 3), (TILE - 1, CAPTION - 3), drawing.INK, 2)
    return column


def _labels(height: int) -> np.ndarray:
    labels = drawing.blank(GUTTER, CAPTION + 3 * (height + GAP))
    for row, name in enumerate(ROWS):
        drawing.write(labels, name, (8, CAPTION + row * (height + GAP) + 16))
    return labels


def _header(result: Result, deviation: Deviation, width: int, name: str) -> np.ndarray:
    header, (title, said) = drawing.blank(width, HEADER), _told(result, deviation)
    drawing.write(header, f"{name}   {result.verdict}   {title}", (8, 28), size=0.8)
    drawing.write(header, f"{said} (1.0 is the threshold)", (8, 52), drawing.FAINT)
    return header


def _told(result: Result, d: Deviation) -> tuple[str, str]:
    if d not in result.deviations:
        return (
            f"highest score {d.peak_score:.2f} at s {d.s_start:.3f}",
            f"nothing looks out of tolerance: frame {d.peak_index} comes nearest",
        )
    what = WORDS.get(d.polarity or "", d.kind)
    number = result.deviations.index(d) + 1
    return (
        f"{what} at s {d.s_start:.3f} to {d.s_end:.3f}",
        f"deviation {number} of {len(result.deviations)}: frames {d.index_start} to {d.index_end - 1},"
        f" peak score {d.peak_score:.2f} at frame {d.peak_index}",
    )


def _footer(result: Result, deviation: Deviation, width: int, full: float) -> np.ndarray:
    """The score along the sweep, and what the colours mean."""
    footer = drawing.blank(width, CHART)
    scores = [(f.s, f.score) if f.s is not None and f.state is FrameState.SCORED else None for f in result.frames]
    top = 1.1 * max([1.3, *(point[1] for point in scores if point)])
    peak = next((f.s for f in result.frames if f.index == deviation.peak_index and f.s is not None), deviation.s_start)
    stretches = [(d.s_start, d.s_end) for d in result.deviations]
    chart = drawing.Chart(width - GUTTER - TILE - 5 * GAP, CHART - 12, top)
    footer[8:-4, GUTTER : GUTTER + chart.width] = chart.draw(scores, stretches, peak)
    drawing.write(footer, "score by s", (8, 20))
    drawing.write(footer, "limit 1.0", (GUTTER - 62, 12 + chart.at(0, 1.0)[1]), drawing.FAINT, 0.4)
    bar = drawing.scale_bar(TILE, full)
    footer[40:80, width - TILE - GAP : width - GAP] = bar
    drawing.write(footer, "difference, grey levels", (width - TILE - GAP, 32))
    return footer
