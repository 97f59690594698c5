"""Is what the detectability map promises found on real boards?

Run by hand, on one thread: python -m tests.benchmarks.detectability FOLDER... [--noise] [--fine]

A FOLDER holds `golden.mcap` and `golden-again.mcap` to learn from, and sweeps of defective parts `bad-*.mcap`, each
with its `*.truth.json`: per frame the boxes of the annotated defects in pixels, and whether each is wholly `inside`.
The map is made of each appearance alone, then every bad sweep is inspected, and each defect is asked: did the map
promise it? Was it found? Of those promised, 99 % must have been.

Boxes are drawn around defects with room to spare, so what lies in them is measured: `models.inspection.explain` lays
the frame on the picture expected, and of the difference between the two inside the box, that which is beyond half of
its strongest value is the defect. Its size is the diameter of the largest disc that fits into it, its contrast the
median difference in that disc: edges that stray are thin, and do not make it larger; a defect of another shape is
never smaller than that disc. Both are medians over the frames that show it. Brighter ones are compared with added
material, darker ones with missing material, at the worst of the sites about the place where it comes nearest to the
middle of the picture. A region finds a defect where its middle lies in the box grown by ten pixels and it is no more
than nine times larger.
"""

from __future__ import annotations

import argparse
import json
import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from inspector.recording import SweepReader
from models.appearance import Appearance
from models.defects import Kind
from models.detectability import Detectability, expected_size
from models.inspection import begin, explain, step
from models.learning import learn
from models.probe import SPACING, SPACING_FINE, probe
from models.registration import shrink_by
from models.verdict import Region, ScoredFrame

cv2.setNumThreads(1)


@dataclass
class Seen:
    """One annotated defect in one sweep."""

    looks: list[tuple[float, float, float]] = field(default_factory=list[tuple[float, float, float]])
    """Diameter in pixels, contrast in grey levels with its sign, distance from the middle of the picture."""
    places: list[tuple[float, float, float]] = field(default_factory=list[tuple[float, float, float]])
    """s, and x and y on the reference picture."""
    found: bool = False
    best: float = 0.0
    """The highest score of a region on it."""

    def measured(self) -> tuple[float, float]:
        """Diameter and contrast."""
        looks = np.array(self.looks)
        return float(np.median(looks[:, 0])), float(np.median(looks[:, 1]))

    def place(self) -> tuple[float, float, float]:
        """Where it comes nearest to the middle of the picture."""
        return self.places[int(np.array(self.looks)[:, 2].argmin())]


def finds(region: Region, box: list[float], slack: float = 10) -> bool:
    """A region finds a defect when its middle lies in the box with some slack, and it is no blanket."""
    x1, y1, x2, y2 = box[0] - slack, box[1] - slack, box[2] + slack, box[3] + slack
    x, y = region.x + region.width / 2, region.y + region.height / 2
    return x1 <= x <= x2 and y1 <= y <= y2 and region.width * region.height <= 9 * (x2 - x1) * (y2 - y1)


def measure(difference: np.ndarray, box: tuple[int, int, int, int]) -> tuple[float, float]:
    """Diameter and signed contrast of what is wrong inside a box of the difference picture; 0, 0 where nothing is."""
    x0, y0, x1, y1 = box
    part = cv2.blur(difference, (3, 3))[y0:y1, x0:x1]
    best = (0.0, 0.0)
    for sign in (1, -1):
        beyond = (sign * part > 0.5 * float(np.abs(part).max())).astype(np.uint8)
        inside = cv2.distanceTransform(cv2.copyMakeBorder(beyond, 1, 1, 1, 1, cv2.BORDER_CONSTANT), cv2.DIST_L2, 5)
        y, x = np.unravel_index(int(inside.argmax()), inside.shape)
        radius = float(inside[y, x])
        # a distance counts to the middle of the first pixel outside
        if 2 * radius - 1 > best[0]:
            disc = cv2.circle(np.zeros_like(beyond), (int(x) - 1, int(y) - 1), max(int(radius - 1), 0), 1, cv2.FILLED)
            best = 2 * radius - 1, float(np.median(difference[y0:y1, x0:x1][disc > 0]))
    return best


def look(appearance: Appearance, frame: Any, scored: ScoredFrame, defect: Mapping[str, Any], seen: Seen) -> None:
    """Measure a defect in one frame."""
    explanation = explain(appearance, frame, scored)
    if explanation is None or scored.s is None:
        return
    a, b, c, d, e, f = explanation.placement
    box = np.array(defect["box"]).reshape(2, 2)
    (x0, y0), (x1, y1) = np.linalg.solve(np.array([[a, b], [d, e]]), (box - (c, f)).T).T
    w, h = appearance.size
    inside = tuple(int(np.clip(v, 0, side)) for v, side in ((x0, w), (y0, h), (x1 + 1, w), (y1 + 1, h)))
    if inside[2] - inside[0] < 4 or inside[3] - inside[1] < 4:
        return
    difference = explanation.difference
    if difference.ndim == 3:
        difference = np.take_along_axis(difference, np.abs(difference).argmax(axis=2)[:, :, None], axis=2)[:, :, 0]
    size, contrast = measure(difference, inside)
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    seen.looks.append((size, contrast, float(np.hypot(x - w / 2, y - h / 2))))
    seen.places.append((scored.s, float(x), float(y)))


def inspect(appearance: Appearance, path: Path) -> dict[int, Seen]:
    """What a bad sweep shows of each annotated defect that is wholly in view at least once."""
    truth = json.loads(path.with_suffix(".truth.json").read_text())["frames"]
    defects: dict[int, Seen] = {}
    state = begin(appearance)
    slack = 10.0 * shrink_by(appearance.size)
    for frame, told in zip(SweepReader(path), truth, strict=True):
        state, scored = step(state, frame)
        for defect in told["defects"]:
            seen = defects.setdefault(defect["id"], Seen())
            best = max((r.score for r in scored.regions if finds(r, defect["box"], slack)), default=0.0)
            seen.found |= best >= 1.0
            seen.best = max(seen.best, best)
            if defect["inside"] and scored.reference >= 0:
                look(appearance, frame, scored, defect, seen)
    return {number: seen for number, seen in defects.items() if seen.looks}


@dataclass
class Tally:
    """Defects promised by the map and others, and how many of each were found."""

    promised: int = 0
    kept: int = 0
    others: int = 0
    found: int = 0

    def __add__(self, other: Tally) -> Tally:
        mine, its = vars(self), vars(other)
        return Tally(**{name: mine[name] + its[name] for name in mine})

    def __str__(self) -> str:
        share = f"{self.kept / self.promised:7.2%}" if self.promised else "      -"
        return f"{self.promised:9}{self.kept:7}{share:>9}{self.others:9}{self.found:7}"


def judged(found: Detectability, defects: Mapping[int, Seen], name: str) -> Iterator[tuple[bool, bool]]:
    """For each defect whether it was promised, and whether it was found."""
    for number, seen in sorted(defects.items()):
        (size, contrast), place = seen.measured(), seen.place()
        kind = Kind.ADDED if contrast > 0 else Kind.MISSING
        needed = expected_size(found, *place, contrast=abs(contrast), kind=kind)
        promised = size >= needed
        if promised and not seen.found:
            s, x, y = place
            print(
                f"  missed: {name} defect {number}, {kind}, {size:.1f} px of {contrast:+.0f} at s = {s:.3f} "
                f"({x:.0f}, {y:.0f}); the map says {needed:g} px"
            )
        yield promised, seen.found


def study(folder: Path, noise: bool, fine: bool) -> Tally:
    """Learn, make the map, inspect the bad sweeps, compare."""
    appearance = learn([SweepReader(folder / f"{name}.mcap") for name in ("golden", "golden-again")])
    start = time.process_time()
    sweeps = [list(SweepReader(folder / "golden-again.mcap"))] if noise else []
    found = probe(appearance, sweeps=sweeps, spacing=SPACING_FINE if fine else SPACING)
    took = time.process_time() - start
    tally = Tally()
    for path in sorted(folder.glob("bad-*.mcap")):
        if path.name.startswith("bad-cut-short"):
            continue
        for promised, was_found in judged(found, inspect(appearance, path), f"{folder.name}/{path.stem}"):
            tally += Tally(promised, promised and was_found, not promised, was_found and not promised)
    print(
        f"{folder.parent.name + '/' + folder.name:28}{tally}   map {took:.0f} s, astray {found.astray:.2%}", flush=True
    )
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--noise", action="store_true", help="put the defects into golden-again.mcap, noise and all")
    parser.add_argument("--fine", action="store_true")
    given = parser.parse_args()
    folders = [folder for folder in given.folders if (folder / "golden.mcap").exists()]
    if not folders:
        print("skipped: no folder with golden.mcap, golden-again.mcap and bad-*.mcap was given")
        return
    print(f"{'':28}{'promised':>9}{'found':>7}{'share':>9}{'others':>9}{'found':>7}")
    tally = sum((study(folder, given.noise, given.fine) for folder in folders), Tally())
    print(f"{'all':28}{tally}")
    sys.exit(0 if tally.kept >= 0.99 * tally.promised else 1)


if __name__ == "__main__":
    main()
