"""What does a frame cost, stage by stage, against the least that any pixel comparison costs?

Run by hand, on one thread:

    python tests/benchmarks/frame_cost.py                                    # simulated, two sizes, grey and colour
    python tests/benchmarks/frame_cost.py --growth                           # among 100 and among 10,000 places
    python tests/benchmarks/frame_cost.py --recording golden.mcap test.mcap  # of your own

The floor is decoding the JPEG frame, one bilinear warp, one absolute difference and one 5x5 box filter of it. Against
it stands all that scoring does to a frame: decoding it and `models.inspection.step`; cold, on the first pass of an
appearance just loaded, which decodes and prepares reference pictures on the way, and warm, on the second pass.
The ECC way is what one writes with OpenCV alone: `findTransformECC` against the reference picture of the same place
(found by us, a present), warp, `absdiff`, blur, threshold, connected components.

Floor and passes alternate. Times are of the thread's own clock, so that being interrupted does not count. Each frame's
best time over all rounds is averaged over the frames; medians stand beside it. Stages are timed by wrapping functions
from here, in passes of their own; a stage does not contain the stages called by it.
"""

from __future__ import annotations

import argparse
import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import gc
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import thread_time_ns
from typing import Any

import cv2
import numpy as np

import models.inspection
import models.localise
import models.references
import models.scoring
from inspector import pictures
from inspector.cameras import open_camera
from inspector.recording import SweepReader
from models.appearance import Appearance
from models.eigenspace import Eigenspace
from models.frame import EncodedPicture, Frame
from models.inspection import Inspection
from models.learning import learn
from models.manifold import Manifold
from models.position import Track
from models.preparation import Preparation
from models.references import References

TARGET, OF_ECC, GROWTH, FILE = 4.0, 1 / 8, 1.2, 1.0
"""What a frame may cost: times the floor, and of the ECC way; among 10,000 places, times what it costs among 100; and
how large a learnt file may be, times the pictures that it was learnt from."""
GOLDEN, PART = "unit=1&seed=1", "unit=2&seed=2&place=1,-1,0.1"
SWEEPS = {
    "320x240": "simulated:?size=320x240",
    # drawing large pictures is slow: a short way
    "1280x960": "simulated:?size=1280x960&path=line",
}

DECODE, WARP, DIFFERENCE, BOX = "decode the frame", "warp", "absolute difference", "box filter"
FLOOR = (DECODE, WARP, DIFFERENCE, BOX)
REST = "the rest"
STAGES: dict[str, tuple[tuple[Any, str], ...]] = {
    "smooth, blind?": ((models.scoring, "smooth"), (models.scoring, "is_blind")),
    "thumbnail and projection": ((Preparation, "prepare"), (Eigenspace, "project")),
    "position filter": (
        (models.localise, "move"),
        (models.localise, "standing"),
        (models.localise, "vouch"),
        (Track, "misfit"),
    ),
    "scan": ((models.localise, "scan"),),
    "registration": ((models.localise, "register"),),
    "place and fixture": ((models.scoring, "locate"),),
    "reference: decode": ((models.references, "unpack"),),
    "reference: smooth": ((models.references, "smooth"),),
    "reference: template": ((models.references.Template, "of"), (References, "_get")),
    "reference: band": ((models.references.Band, "of"),),
    "lay on the reference": ((models.scoring, "aligned"),),
    "compare": ((models.scoring, "evidence"), (models.scoring, "cells_shown")),
    "persistence": ((models.scoring, "persist"),),
    "regions": ((models.inspection, "regions"),),
    REST: ((models.inspection, "step"),),
}
"""Stage -> the functions that make it up, wherever they are looked up from."""


@dataclass
class Stopwatch:
    """Splits time among stages; what runs inside of another stage is taken off that one."""

    spent: defaultdict[str, int] = field(default_factory=lambda: defaultdict[str, int](int))
    _inner: list[int] = field(default_factory=lambda: [0])

    def timed(self, stage: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def run(*args: Any, **more: Any) -> Any:
            self._inner.append(0)
            start = thread_time_ns()
            try:
                return work(*args, **more)
            finally:
                took = thread_time_ns() - start
                self.spent[stage] += took - self._inner.pop()
                self._inner[-1] += took

        return run

    def split(self) -> dict[str, int]:
        """Nanoseconds by stage since the last call."""
        spent, self.spent = self.spent, defaultdict(int)
        return spent


@contextmanager
def wrapped(watch: Stopwatch) -> Iterator[None]:
    """While this is open, every function of STAGES reports to the watch."""
    before: list[tuple[Any, str, Any]] = []
    try:
        for stage, functions in STAGES.items():
            for owner, name in functions:
                own = vars(owner).get(name)
                if own is None:
                    raise SystemExit(f"{owner.__name__}.{name} is no more: bring STAGES up to date")
                before.append((owner, name, own))
                bound = isinstance(own, classmethod)
                timed = watch.timed(stage, getattr(owner, name) if bound else own)
                setattr(owner, name, staticmethod(timed) if bound else timed)
        yield
    finally:
        for owner, name, own in reversed(before):
            setattr(owner, name, own)


@dataclass(frozen=True)
class Case:
    """An appearance as it lies on the disk, and the frames of a part to be inspected, encoded."""

    name: str
    appearance: bytes
    frames: list[Frame]
    recorded: int = 0
    """Bytes of the pictures learnt from."""


@dataclass
class Times:
    """Nanoseconds: a list over rounds, each by frame."""

    floor: list[list[dict[str, int]]] = field(default_factory=list)
    whole: defaultdict[str, list[list[int]]] = field(default_factory=lambda: defaultdict(list))
    """By "cold" and "warm"."""
    stages: defaultdict[str, list[list[dict[str, int]]]] = field(default_factory=lambda: defaultdict(list))
    states: Counter[str] = field(default_factory=Counter)
    """What became of the frames."""
    ecc: list[int] = field(default_factory=list[int])
    """The ECC way: of some frames only, it is slow."""


def floor_pass(frames: Iterable[Frame], reference: np.ndarray) -> list[dict[str, int]]:
    """Stages of the floor, frame by frame."""
    h, w = reference.shape[:2]
    map_ = np.array([[1, -0.002, 1.3], [0.002, 1, -0.7]])
    found: list[dict[str, int]] = []
    for frame in frames:
        start = thread_time_ns()
        pixels = pictures.decode(encoded(frame))
        decoded = thread_time_ns()
        laid = cv2.warpAffine(pixels, map_, (w, h), flags=cv2.INTER_LINEAR)
        warped = thread_time_ns()
        difference = cv2.absdiff(laid, reference)
        compared = thread_time_ns()
        cv2.blur(difference, (5, 5))
        ends = (start, decoded, warped, compared, thread_time_ns())
        found.append({stage: b - a for stage, a, b in zip(FLOOR, ends, ends[1:], strict=False)})
    return found


def path_pass(frames: Iterable[Frame], state: Inspection, states: Counter[str]) -> list[int]:
    """The whole path, frame by frame."""
    found: list[int] = []
    for frame in frames:
        start = thread_time_ns()
        state, scored = models.inspection.step(state, decoded_again(frame))
        found.append(thread_time_ns() - start)
        states[scored.state.name.lower()] += 1
    return found


def stage_pass(frames: Iterable[Frame], state: Inspection, watch: Stopwatch) -> list[dict[str, int]]:
    """The whole path by stages, frame by frame."""
    found: list[dict[str, int]] = []
    again = watch.timed(DECODE, decoded_again)
    for frame in frames:
        state, _ = models.inspection.step(state, again(frame))
        found.append(watch.split())
    return found


def ecc_pass(case: Case) -> list[int]:
    """The same by OpenCV alone, of every tenth frame."""
    appearance = Appearance.from_bytes(case.appearance)
    state = models.inspection.begin(appearance)
    found: list[int] = []
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
    for i, frame in enumerate(case.frames):
        state, scored = models.inspection.step(state, frame)
        if i % 10 != 5 or scored.reference < 0:
            continue
        reference = appearance.references.get(scored.reference).picture
        flat = reference if reference.ndim == 2 else cv2.cvtColor(reference, cv2.COLOR_BGR2GRAY)
        start = thread_time_ns()
        pixels = pictures.decode(encoded(frame))
        grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
        try:
            _, m = cv2.findTransformECC(flat, grey, np.eye(2, 3, dtype=np.float32), cv2.MOTION_EUCLIDEAN, criteria)
        except cv2.error:
            continue
        laid = cv2.warpAffine(pixels, m, frame.size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        blurred = cv2.blur(cv2.absdiff(laid, reference), (5, 5))
        strongest = blurred if blurred.ndim == 2 else blurred.max(axis=2)
        cv2.connectedComponentsWithStats(cv2.threshold(strongest, 30, 255, cv2.THRESH_BINARY)[1])
        found.append(thread_time_ns() - start)
    return found


def encoded(frame: Frame) -> EncodedPicture:
    return frame.encoded if frame.encoded is not None else pictures.encode_jpeg(frame.pixels)


def decoded_again(frame: Frame) -> Frame:
    return Frame(pictures.decode(encoded(frame)), frame.t_ns, frame.sequence, encoded=frame.encoded)


def measure(case: Case, rounds: int) -> Times:
    """Floor, cold, warm, cold by stages, warm by stages; and again. As often each: the best of more would be better."""
    times = Times()
    reference = case.frames[len(case.frames) // 2].pixels
    for _ in range(rounds):
        times.floor.append(floor_pass(case.frames, reference))
        appearance = Appearance.from_bytes(case.appearance)
        for temperature in ("cold", "warm"):
            gc.collect()
            state = models.inspection.begin(appearance)
            times.whole[temperature].append(path_pass(case.frames, state, times.states))
        watch = Stopwatch()
        with wrapped(watch):
            appearance = Appearance.from_bytes(case.appearance)
            watch.split()
            for temperature in ("cold", "warm"):
                gc.collect()
                state = models.inspection.begin(appearance)
                times.stages[temperature].append(stage_pass(case.frames, state, watch))
    times.ecc = ecc_pass(case)
    return times


def microseconds(rounds: Sequence[Sequence[float]], choose: Callable[..., np.ndarray] = np.min) -> float:
    """Of a frame: each one's best (or median) over the rounds, averaged over the frames."""
    return float(choose(np.array(rounds, float), axis=0).mean()) / 1000


def of_stage(rounds: Sequence[Sequence[dict[str, int]]], stage: str) -> list[list[int]]:
    return [[frame.get(stage, 0) for frame in frames] for frames in rounds]


def report(case: Case, times: Times) -> None:
    h, w = case.frames[0].pixels.shape[:2]
    kind = "colour" if case.frames[0].pixels.ndim == 3 else "grey"
    states = ", ".join(f"{count / times.states.total():.0%} {state}" for state, count in times.states.most_common())
    print(f"\n{case.name}: {w}x{h} {kind}, {len(case.frames)} frames ({states}), {len(times.floor)} rounds")
    whole_floor = [[sum(frame.values()) for frame in frames] for frames in times.floor]
    best = microseconds(whole_floor)
    print(f"{'':28}{'cold':>9}{'':>9}{'warm':>9}\n{'':28}{'µs':>9}{'x floor':>9}{'µs':>9}{'x floor':>9}")

    def row(name: str, *values: float) -> None:
        print(f"{name:28}" + "".join(f"{value:9.0f}{value / best:9.2f}" for value in values))

    for stage in FLOOR:
        row(f"floor: {stage}", microseconds(of_stage(times.floor, stage)))
    row("floor", best)
    for stage in (DECODE, *STAGES):
        row(stage, *(microseconds(of_stage(times.stages[each], stage)) for each in ("cold", "warm")))
    totals = [microseconds(times.whole[each]) for each in ("cold", "warm")]
    row("whole path", *totals)
    middle = microseconds(whole_floor, np.median)
    medians = [microseconds(times.whole[each], np.median) / middle for each in ("cold", "warm")]
    print(f"{'by medians':28}" + "".join(f"{'':9}{ratio:9.2f}" for ratio in medians))
    print(f"{'target':28}" + "".join(f"{'met' if t <= TARGET * best else 'MISSED':>9}{TARGET:9.2f}" for t in totals))
    if times.ecc:
        ecc = float(np.mean(times.ecc)) / 1000
        row("the ECC way", ecc)
        met = "met" if max(totals) <= OF_ECC * ecc else "MISSED"
        print(
            f"{'  of which we take':28}" + "".join(f"{'':9}{t / ecc:9.3f}" for t in totals) + f"  {met}: {OF_ECC:.3f}"
        )
    if case.recorded:
        share = len(case.appearance) / case.recorded
        met = "met" if share <= FILE else "MISSED"
        print(f"learnt file {len(case.appearance) / 1e6:.2f} MB, {share:.2f} x the recording  {met}: {FILE:.2f}")
    print(f"decoders: inspector.pictures {microseconds(of_stage(times.floor, DECODE)):.0f} µs, {plain_decoder(case)}")


def plain_decoder(case: Case) -> str:
    """What OpenCV's decoder, which lets damage pass, would take."""
    best = np.full(len(case.frames), np.inf)
    for _ in range(5):
        for i, frame in enumerate(case.frames):
            data = np.frombuffer(encoded(frame).data, np.uint8)
            start = thread_time_ns()
            cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
            best[i] = min(best[i], thread_time_ns() - start)
    return f"cv2.imdecode {best.mean() / 1000:.0f} µs"


def with_pictures(frames: Iterable[Frame]) -> list[Frame]:
    """The frames, each with the bytes that it is decoded from."""
    return [Frame(frame.pixels, frame.t_ns, frame.sequence, encoded=encoded(frame)) for frame in frames]


def sweep(url: str) -> list[Frame]:
    with open_camera(url) as camera:
        return with_pictures(camera.frames())


def cases(given: argparse.Namespace) -> Iterator[Case]:
    if given.recording:
        golden, test = given.recording
        yield learnt(test.name, with_pictures(SweepReader(golden)), with_pictures(SweepReader(test)))
        return
    for colour in given.colours:
        for size in given.sizes:
            url = f"{SWEEPS[size]}&colour={int(colour == 'colour')}"
            yield learnt("simulated", sweep(f"{url}&{GOLDEN}"), sweep(f"{url}&{PART}"))


def learnt(name: str, golden: list[Frame], test: list[Frame]) -> Case:
    return Case(name, learn([golden]).to_bytes(), test, sum(len(encoded(frame).data) for frame in golden))


def prolonged(appearance: Appearance, times: int) -> Appearance:
    """The same sweep, and so many times as many places after it that look like nothing of it."""
    n, k = appearance.places, appearance.eigenspace.k
    rng = np.random.default_rng(1)
    others = [appearance.manifold.samples @ np.linalg.qr(rng.standard_normal((k, k)))[0] for _ in range(times - 1)]
    z = np.concatenate([appearance.manifold.samples, *others]).astype(np.float32)
    s = np.linspace(0, 1, n * times)
    return replace(
        appearance,
        manifold=Manifold.over(s, z),
        slope=np.tile(appearance.slope, (times, 1, 1)),
        motion=np.tile(appearance.motion, (times, 1)),
        keys=np.concatenate([appearance.keys + i * n for i in range(times)]),
        points=np.tile(appearance.points, (times, 1)),
        rivals=np.tile(appearance.rivals, times),
        reached=np.tile(appearance.reached, times),
        pictures=appearance.pictures * times,
        tolerance=appearance.tolerance * times,
    )


def growth(rounds: int) -> None:
    """What a frame costs where the appearance has a hundred times as many places."""
    url = "simulated:?size=320x240&frames=100"
    appearance, frames = learn([sweep(f"{url}&{GOLDEN}")]), sweep(f"{url}&{PART}")
    kept = [each.to_bytes() for each in (appearance, prolonged(appearance, 100))]
    spent: defaultdict[tuple[int, str], list[list[int]]] = defaultdict(list)
    states = Counter[str]()
    for _ in range(rounds):
        for which, data in enumerate(kept):
            loaded = Appearance.from_bytes(data)
            loaded.guide, loaded.track.known  # noqa: B018 (made once, when an inspection begins)
            for temperature in ("cold", "warm"):
                gc.collect()
                state = models.inspection.begin(loaded)
                spent[which, temperature].append(path_pass(frames, state, states))
    print(f"\n100 frames among {appearance.places} places and among {100 * appearance.places}: {dict(states)}")
    for temperature in ("cold", "warm"):
        few, many = (microseconds(spent[which, temperature]) for which in (0, 1))
        met = "met" if many <= GROWTH * few else "MISSED"
        print(f"{temperature:8}{few:9.0f} µs{many:9.0f} µs{many / few:9.2f}  {met}: {GROWTH:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", nargs="+", choices=tuple(SWEEPS), default=list(SWEEPS))
    parser.add_argument("--colours", nargs="+", choices=("grey", "colour"), default=["grey", "colour"])
    parser.add_argument("--growth", action="store_true", help="only this: 100 places against 10,000")
    parser.add_argument("--recording", nargs=2, type=Path, metavar=("GOLDEN", "TEST"), help="instead of the simulation")
    parser.add_argument("--rounds", type=int, default=7)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    if given.growth:
        growth(given.rounds)
        return
    for case in cases(given):
        report(case, measure(case, given.rounds))


if __name__ == "__main__":
    main()
