"""Are good sweeps refused as often as was promised?

Run by hand, on one thread; ten minutes:

    python -m tests.benchmarks.false_rejects                          # 208 good sweeps of 8 simulated products
    python -m tests.benchmarks.false_rejects PANEL_1 PANEL_2 ...      # folders with golden*.mcap and good*.mcap
    python -m tests.benchmarks.false_rejects --json peaks.json        # keeps what every good sweep reached

Learnt is from the first 2, 3 and 5 golden sweeps (from as many as a folder has). The highest score of each good sweep
is measured once, in units of the assumed tolerance; every target is judged from it, because scores go with 1 / factor.
Products, individuals, fixture offsets, pace and light are drawn; no seed is shared with what the assumptions were
taken from.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import cv2
import numpy as np

from inspector.cameras import open_camera
from inspector.recording import SweepReader
from models.appearance import Appearance
from models.frame import Frame
from models.inspection import begin, conclude, step
from models.learning import learn
from models.limits import promise
from models.verdict import Judgement, Policy

TARGETS = (0.01, 0.05)
GOLDEN = (2, 3, 5)
PRODUCTS = ("plate", "board", "casting", "plate5", "board6", "casting7", "plate8", "board9")
CAMERA = "simulated:?size=160x120&path=line&step=12"
JUDGED = (Judgement.OK, Judgement.REVIEW, Judgement.NG)


@dataclass(frozen=True)
class Measured:
    """What one appearance made of the good sweeps of its product."""

    product: str
    golden: int
    golden_peaks: tuple[float, ...]
    peaks: tuple[float, ...]
    """Of the good sweeps that were judged, in units of the assumed tolerance."""
    unjudged: int
    """Good sweeps that were INVALID or INCOMPLETE."""


def sweep(product: str, number: int, seed: int) -> list[Frame]:
    """A good sweep of individual `number`: placed, lit and paced by chance."""
    rng = np.random.default_rng([seed, number])
    dx, dy, turn = rng.uniform((-3, -2, -0.3), (3, 2, 0.3))
    gain, drift, shade, pace, noise = rng.uniform((0.8, 0, 0, 0, 1), (1.15, 0.06, 0.06, 0.25, 4))
    url = (
        f"{CAMERA}&part={product}&unit={number}&seed={1000 * seed + number}&place={dx:.2f},{dy:.2f},{turn:.3f}"
        f"&gain={gain:.3f}&drift={drift:.3f}&shade={shade:.3f}&pace={pace:.2f}&noise={noise:.1f}"
    )
    with open_camera(url) as camera:
        return list(camera.frames())


def highest(appearance: Appearance, frames: Iterable[Frame]) -> float | None:
    """The peak of a good sweep in units of the assumed tolerance; None where it was not judged."""
    state = begin(appearance, Policy())
    for frame in frames:
        state, _ = step(state, frame)
    result = conclude(state)
    if result.verdict not in JUDGED:
        return None
    return max(frame.score for frame in result.frames) * state.factor


def left_out(golden: Sequence[Iterable[Frame]]) -> tuple[float, ...]:
    """What each golden sweep reaches where it is judged by what the others show; none where there are no others."""
    if len(golden) < 2:
        return ()
    found = (highest(learn([*golden[:i], *golden[i + 1 :]]), swept) for i, swept in enumerate(golden))
    return tuple(round(peak, 4) for peak in found if peak is not None)


def measured(
    product: str, golden: Sequence[Iterable[Frame]], good: Iterable[Iterable[Frame]], counts: Sequence[int]
) -> Iterator[Measured]:
    learnt = {count: learn(golden[:count]) for count in counts}
    reached: dict[int, list[float | None]] = {count: [] for count in counts}
    for frames in good:
        swept = list(frames)
        for count, appearance in learnt.items():
            reached[count].append(highest(appearance, swept))
    for count in counts:
        peaks = tuple(round(peak, 4) for peak in reached[count] if peak is not None)
        yield Measured(product, count, left_out(golden[:count]), peaks, reached[count].count(None))


def simulated(good: int, seed: int) -> Iterator[Measured]:
    for number, product in enumerate(PRODUCTS):
        first = 1000 * (number + 1)
        golden = [sweep(product, first + i, seed) for i in range(max(GOLDEN))]
        yield from measured(product, golden, (sweep(product, first + 100 + i, seed) for i in range(good)), GOLDEN)


def recorded(folders: Sequence[Path]) -> Iterator[Measured]:
    for folder in folders:
        golden, good = (sorted(folder.glob(f"{kind}*.mcap")) for kind in ("golden", "good"))
        # sorted by name, `golden-again` comes before `golden`
        golden.sort(key=lambda path: (len(path.stem), path.stem))
        counts = sorted({count for count in (1, *GOLDEN, len(golden)) if 0 < count <= len(golden)})
        yield from measured(
            folder.name, [SweepReader(path) for path in golden], (SweepReader(path) for path in good), counts
        )


HEAD = (
    "golden sweeps",
    "target",
    "limits",
    "good sweeps",
    "NG",
    "observed",
    "expected",
    "promised",
    "inside",
    "REVIEW",
)


def table(found: Sequence[Measured], tolerance: float = 1.0) -> Iterator[str]:
    """Observed against promised, as if `tolerance` times as much had been assumed."""
    yield f"| {' | '.join(HEAD)} |"
    yield "| --- " * len(HEAD) + "|"
    for golden in sorted({each.golden for each in found}):
        some = [each for each in found if each.golden == golden and each.peaks]
        for target in TARGETS:
            yield f"| {golden} | {target:.0%} | {' | '.join(row(some, target, tolerance))} |"


def row(some: Sequence[Measured], target: float, tolerance: float) -> Iterator[str]:
    promised = [promise([peak / tolerance for peak in each.golden_peaks], target) for each in some]
    factors = np.array([each.factor * tolerance for each in promised])
    peaks = [np.array(each.peaks) for each in some]
    refused, near = (
        sum(int((reached >= share * factor).sum()) for reached, factor in zip(peaks, factors, strict=True))
        for share in (1.0, 1.0 - Policy().review_margin)
    )
    counts = np.array([len(reached) for reached in peaks])
    sweeps = int(counts.sum())
    low, expected, high = (
        float(counts @ [getattr(each, name) for each in promised]) / sweeps for name in ("low", "expected", "high")
    )
    observed = refused / sweeps
    # a share too small to show in so many sweeps is none
    inside = (low <= observed or low * sweeps < 0.5) and observed <= high
    yield f"{factors.min():.2f}–{factors.max():.2f}"
    yield from (f"{sweeps}", f"{refused}", f"{observed:.1%}", f"{expected:.1%}", f"{low:.1%}–{high:.1%}")
    yield from ("yes" if inside else "no", f"{near - refused}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, help="golden*.mcap and good*.mcap; none: simulated products")
    parser.add_argument("--good", type=int, default=26, help="good sweeps of each simulated product")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument(
        "--tolerance", type=float, nargs="+", default=[1.0, 0.2], help="judge as if so many times were assumed"
    )
    parser.add_argument("--json", type=Path, help="where to keep the peaks")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    found: list[Measured] = []
    for each in recorded(given.folders) if given.folders else simulated(given.good, given.seed):
        found.append(each)
        low, middle, high = np.quantile(each.peaks, (0, 0.5, 1)) if each.peaks else (np.nan,) * 3
        print(
            f"{each.product}: {each.golden} golden sweeps, peaks {[round(peak, 2) for peak in each.golden_peaks]}; "
            f"{len(each.peaks)} good sweeps reached {low:.2f} to {high:.2f}, half of them {middle:.2f}; "
            f"{each.unjudged} not judged",
            flush=True,
        )
    for tolerance in given.tolerance:
        print(f"\nassumed tolerance times {tolerance}:\n", *table(found, tolerance), sep="\n")
    if given.json:
        given.json.write_text(json.dumps([asdict(each) for each in found]))


if __name__ == "__main__":
    main()
