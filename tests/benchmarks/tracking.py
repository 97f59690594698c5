"""How fast may a part go that a hand follows?

Run by hand: python -m tests.benchmarks.tracking [--svg tests/benchmarks/tracking.svg]; five minutes on an idle core.

For every speed a part sets off at once, round a circle and on smooth paths of chance, and a simulated hand follows it
with a frame of latency, thirty frames a second; then the same with ten frames covered. Error is how far the part is
from the middle of the picture, in reaches (half of what was learnt), the larger of x and y.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.following import TOP_SPEED, circle, follow, learn_displacements, path
from inspector.tracking import TrackingSummary
from models.workspace import Workspace

SPEEDS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.49, 0.55, 0.6)
PARTS = ("plate", "board2", "casting3")
SETTLED = 10
"""Frames after which the hand has caught up."""
FRAMES = 300
COURSES = {"circle": (circle,), "paths": tuple(partial(path, seed=seed) for seed in (11, 12, 13, 14))}


@dataclass(frozen=True)
class Row:
    """One speed on one kind of course, all parts and courses."""

    speed: float
    mean: float
    most: float
    """Of the frames after it has caught up, where it was never lost."""
    first: float
    """Largest error of all, which is of the first frames."""
    lost: int
    found: int
    runs: int


def opened(part: str, options: str = "") -> SimulatedCamera:
    camera = open_camera(f"simulated:?part={part}&size=160x120{options}")
    assert isinstance(camera, SimulatedCamera)
    return camera


def measured(learnt: dict[str, Workspace], kind: str, speed: float) -> Row:
    """Every part on every course of a kind: seen all the time, and covered for ten frames."""
    settled, first, lost, found, runs = list[float](), 0.0, 0, 0, 0
    for number, (part, workspace) in enumerate(learnt.items()):
        camera = opened(part, f"&unit={number + 2}&seed={number + 7}&gain=0.95&shade=0.05")
        for course in COURSES[kind]:
            runs += 1
            summary = TrackingSummary()
            errors = list[float]()
            for one in follow(camera, workspace, course(speed), FRAMES):
                summary = summary.with_frame(one.tracked)
                errors.append(one.error)
            lost += summary.losses > 0
            if not summary.losses:
                settled += errors[SETTLED:]
                first = max(first, *errors)
            covered = list(follow(camera, workspace, course(speed), 150, covered=range(100, 110)))
            found += all(one.tracked.state == "tracking" for one in covered[-20:])
    return Row(speed, _or_nan(np.mean, settled), _or_nan(np.max, settled), first, lost, found, runs)


def _or_nan(of: np.ufunc, values: Sequence[float]) -> float:
    return float(of(values)) if values else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--svg", type=Path)
    chosen = parser.parse_args()
    cv2.setNumThreads(1)
    learnt = {part: learn_displacements(opened(part)) for part in PARTS}
    rows: dict[str, list[Row]] = {}
    for kind in COURSES:
        print(f"| {kind}: reaches per frame | mean error | largest | while it sets off | lost | found again |")
        print("| --- | --- | --- | --- | --- | --- |")
        rows[kind] = []
        for speed in SPEEDS:
            row = measured(learnt, kind, speed)
            rows[kind].append(row)
            figures = (
                f"{row.mean:.3f} | {row.most:.3f} | {row.first:.2f} | {row.lost}/{row.runs} | {row.found}/{row.runs}"
            )
            print(f"| {speed:g} | {figures} |", flush=True)
    if chosen.svg:
        chosen.svg.write_text("\n".join(drawn(rows)) + "\n")


WIDTH, HEIGHT, LEFT, TOP, RIGHT, LOW = 640, 300, 52, 34, 620, 250
INKS = {"circle": "#2563eb", "paths": "#c2410c"}


def drawn(rows: dict[str, list[Row]]) -> Iterator[str]:
    """The plot: mean and largest error against speed, as far as nothing is lost."""
    seen = [row for each in rows.values() for row in each if not row.lost]
    top = max(0.1, np.ceil(max(row.most for row in seen) * 10) / 10)

    def at(speed: float, error: float) -> str:
        x = LEFT + (RIGHT - LEFT) * speed / SPEEDS[-1]
        return f"{x:.1f},{LOW - (LOW - TOP) * error / top:.1f}"

    head = f'xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}"'
    yield f'<svg {head} font-family="sans-serif" font-size="12">'
    yield f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>'
    yield f'<text x="{LEFT}" y="18" fill="#111">Error of the hand, reaches; one frame of latency, 30 frames/s</text>'
    for step in range(6):
        error = top * step / 5
        _, y = at(0, error).split(",")
        yield f'<path d="M{LEFT} {y}H{RIGHT}" stroke="#ddd"/>'
        yield f'<text x="{LEFT - 6}" y="{float(y) + 4}" text-anchor="end" fill="#444">{error:.2g}</text>'
    for speed in (0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6):
        x, _ = at(speed, 0).split(",")
        yield f'<path d="M{x} {LOW}v5" stroke="#444"/>'
        yield f'<text x="{x}" y="{LOW + 18}" text-anchor="middle" fill="#444">{speed:g}</text>'
    middle = (LEFT + RIGHT) / 2
    yield f'<text x="{middle}" y="{LOW + 38}" text-anchor="middle" fill="#444">speed, reaches per frame</text>'
    for speed, said, y in ((TOP_SPEED, "stated top speed", TOP + 12), (0.5, "gone at once", TOP + 28)):
        x, _ = at(speed, 0).split(",")
        yield f'<path d="M{x} {TOP}V{LOW}" stroke="#444" stroke-dasharray="4 4"/>'
        yield f'<text x="{float(x) + 5}" y="{y}" fill="#444">{said}</text>'
    for number, (kind, each) in enumerate(rows.items()):
        kept = [row for row in each if not row.lost]
        for values, dash in (([row.mean for row in kept], ""), ([row.most for row in kept], ' stroke-dasharray="2 3"')):
            points = " ".join(at(row.speed, value) for row, value in zip(kept, values, strict=True))
            yield f'<polyline points="{points}" fill="none" stroke="{INKS[kind]}" stroke-width="2"{dash}/>'
        y = TOP + 20 + 18 * number
        yield f'<path d="M{LEFT + 16} {y}h24" stroke="{INKS[kind]}" stroke-width="2"/>'
        yield f'<text x="{LEFT + 46}" y="{y + 4}" fill="#111">{kind}: mean; dotted: largest, once caught up</text>'
    yield "</svg>"


if __name__ == "__main__":
    main()
