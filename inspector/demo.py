"""The demo: a simulated line learns from two golden sweeps and inspects good and defective parts; the truth judges it.

Nothing is told to the inspection but frames. What was planted, and where, comes from the simulated camera's `truth()`
afterwards, and only to say whether the verdict was right.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.cameras.simulated.truth import FrameTruth
from inspector.filmstrip import write_filmstrips
from inspector.learner import learn_recordings
from inspector.live import inspect_live
from inspector.recorder import record
from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.result_json import result_record, write_result
from models.appearance import Appearance
from models.verdict import Deviation, Judgement, Region, Result

CLOSE = 3.0
"""Pixels by which a region may miss the planted defect's box and still be on it."""


@dataclass(frozen=True)
class Sample:
    """One part that comes to the demo's line."""

    name: str
    options: str
    """Of the simulated camera."""
    defect: str | None = None


GOLDEN = ("unit=1", "unit=2&pace=0.15&place=1.5,-1,0.15&gain=0.96&drift=0.03")
"""Two good parts, swept as two days differ."""
GOOD = (
    Sample("good", "pace=0.1"),
    Sample("good, lies off, quicker", "pace=0.25&place=3,-2,0.3&late=4&pause=12"),
    Sample("good, lamp weak, frames lost", "gain=0.85&drift=0.05&shade=0.06&lost=0.03"),
)
DEFECTS = ("scratch", "spot", "missing", "extra", "stain", "crack", "pinhole", "bent")
CONDITIONS = ("", "&pace=0.2&late=3", "&place=-2,1.5,-0.25", "&gain=0.9&drift=0.04", "&vibration=0.3&blur=2")


def samples() -> tuple[Sample, ...]:
    """Good parts, then one part with each kind of defect, swept under changing conditions."""
    defective = (
        Sample(kind, f"defect={kind}{CONDITIONS[number % len(CONDITIONS)]}", kind)
        for number, kind in enumerate(DEFECTS)
    )
    return (*GOOD, *defective)


@dataclass(frozen=True)
class Row:
    """What became of one part."""

    name: str
    """Its serial number."""
    sample: Sample
    result: Result
    planted: float | None
    """Sweep coordinate at which the defect is nearest to the middle of the picture; None on a good part."""
    on_it: tuple[bool, ...]
    """For each deviation, whether it lies on the planted defect."""

    @property
    def found(self) -> tuple[Deviation, ...]:
        """The deviations that lie on the planted defect."""
        return tuple(each for each, on_it in zip(self.result.deviations, self.on_it, strict=True) if on_it)

    @property
    def expected(self) -> Judgement:
        """The verdict that is right."""
        return Judgement.NG if self.sample.defect else Judgement.OK

    @property
    def right(self) -> bool:
        """A good part OK, a defective one NG with a deviation on its defect."""
        return self.result.verdict is self.expected and bool(self.found) == bool(self.sample.defect)


@dataclass(frozen=True)
class Demo:
    """All of it."""

    folder: Path
    rows: tuple[Row, ...]
    same_digest: bool
    """Whether a recording, replayed, gave the digest of the live inspection."""

    @property
    def right(self) -> bool:
        """Whether everything came out as it should."""
        return self.same_digest and all(row.right for row in self.rows)


def run_demo(
    folder: Path,
    *,
    part: str = "plate",
    seed: int = 1,
    options: str = "&step=10",
    parts: Sequence[Sample] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Demo:
    """Record, learn, inspect; leaves recordings, appearance, results and filmstrips in `folder`, which must be new.

    `options` are given to every sweep: the size of the picture, the step.
    """
    parts, common = samples() if parts is None else parts, f"simulated:?part={part}{options}"
    with open_camera(f"{common}&seed={100 * seed}"):
        # What is not allowed is refused before anything is written.
        folder.mkdir(parents=True)
    for kind in ("recordings", "results", "filmstrips"):
        (folder / kind).mkdir()
    line = _Line(folder, part, _learn(folder, part, common, seed, lambda share: progress(0.2 * share)))
    rows: list[Row] = []
    for number, sample in enumerate(parts, start=1):
        url = f"{common}&unit={100 * seed + number}&seed={100 * seed + 10 + number}&{sample.options}"
        rows.append(line.inspect(f"{number:02}-{sample.defect or 'good'}", url, sample))
        progress(0.2 + 0.8 * number / len(parts))
    return Demo(folder, tuple(rows), line.replays(rows[-1]))


def _learn(folder: Path, part: str, common: str, seed: int, progress: Callable[[float], None]) -> Appearance:
    paths = [folder / "recordings" / f"golden-{number}.mcap" for number in (1, 2)]
    for number, (path, options) in enumerate(zip(paths, GOLDEN, strict=True)):
        with open_camera(f"{common}&seed={100 * seed + number}&{options}") as camera:
            record(camera, path, product_id=part, part_id=path.stem, lossless=True)
    return learn_recordings(paths, folder / f"{part}.appearance", progress)


@dataclass(frozen=True)
class _Line:
    """The station, once it has learnt."""

    folder: Path
    part: str
    appearance: Appearance

    def inspect(self, name: str, url: str, sample: Sample) -> Row:
        """Sweep one part; leaves recording, result and filmstrips."""
        path = self._recording(name)
        with open_camera(url) as camera:
            assert isinstance(camera, SimulatedCamera)
            result = inspect_live(camera, self.appearance, record_to=path, product_id=self.part, part_id=name)
            truth = camera.truth()
        facts = {"product_id": self.part, "part_id": name}
        write_result(self.folder / "results" / f"{name}.json", result_record(result, facts, is_simulated=True))
        for _ in write_filmstrips(self.folder / "filmstrips", SweepReader(path), self.appearance, result, name):
            pass
        on_it = tuple(lies_on_defect(deviation, truth) for deviation in result.deviations)
        return Row(name, sample, result, planted_at(truth, self.appearance.size), on_it)

    def replays(self, row: Row) -> bool:
        """Whether the recording of a part, replayed, gives the digest of its live inspection."""
        return replay(SweepReader(self._recording(row.name)), self.appearance).result.digest == row.result.digest

    def _recording(self, name: str) -> Path:
        return self.folder / "recordings" / f"{name}.mcap"


def planted_at(truth: Sequence[FrameTruth], size: tuple[int, int]) -> float | None:
    """Sweep coordinate of the frame that has a defect nearest to its middle; None where none is ever seen."""
    seen: list[tuple[float, float]] = []
    for frame in truth:
        for defect in frame.defects:
            x0, y0, x1, y1 = defect.box
            off = ((x0 + x1) / 2 - size[0] / 2, (y0 + y1) / 2 - size[1] / 2)
            seen.append((off[0] ** 2 + off[1] ** 2, frame.s))
    return min(seen)[1] if seen else None


def lies_on_defect(deviation: Deviation, truth: Sequence[FrameTruth]) -> bool:
    """Whether a region of the deviation, in its peak frame, touches the box of a planted defect."""
    boxes = [defect.box for defect in truth[deviation.peak_index].defects]
    return any(_touch(region, box) for region in deviation.regions for box in boxes)


def _touch(region: Region, box: tuple[float, float, float, float]) -> bool:
    x0, y0, x1, y1 = box
    across = region.x <= x1 + CLOSE and region.x + region.width >= x0 - CLOSE
    return across and region.y <= y1 + CLOSE and region.y + region.height >= y0 - CLOSE
