"""Every part of a labelled set through the one scoring path, and the worst cases once more, as pictures."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import UInt8

from inspector.errors import NotARecording
from inspector.evaluation.labelled_set import Part
from inspector.executors import Executor
from inspector.filmstrip import filmstrips, peak_of
from inspector.learner import packed, unpacked
from inspector.locations import Location
from inspector.pictures import encode_jpeg
from inspector.recording import SweepReader, count_frames
from inspector.replay import OnScored, replay
from inspector.result_json import number
from models.appearance import Appearance
from models.errors import InspectionError
from models.frame import Frame
from models.labelled import Label, Outcome, outcome, worst
from models.verdict import FrameState, Policy, Result, ScoredFrame

WORST = 4
"""Cases shown of each label."""
AROUND = (-1, 0, 1)
"""Frames of a strip, in steps from the peak: three and a close-up are legible across a page."""
QUALITY = 88
"""Of the strips' JPEG."""


@dataclass(frozen=True)
class Inspected:
    """One part, inspected."""

    outcome: Outcome
    peak_index: int | None
    """Frame of the highest score, in the recording; None where none was scored."""
    peak_s: float | None
    coverage: float
    reasons: tuple[str, ...]
    digest: str
    recording: str
    """`sha256:` of the recording's bytes."""
    facts: Mapping[str, str]
    """What was said of the sweep when it was recorded: `product_id`, `part_id`, ..."""
    losses: tuple[str, ...]
    """A sentence for each thing that the recording has lost."""


@dataclass(frozen=True)
class Failed:
    """A recording that no inspection could be made of."""

    name: str
    label: Label
    why: str


@dataclass(frozen=True, eq=False)
class Run:
    """A labelled set, inspected by one appearance and one policy."""

    appearance: Appearance
    policy: Policy
    inspected: tuple[Inspected, ...]
    failed: tuple[Failed, ...]
    results: Mapping[str, Result]
    """Of the worst cases, by name."""

    @property
    def outcomes(self) -> list[Outcome]:
        """What is counted."""
        return [each.outcome for each in self.inspected]

    def worst(self, label: Label) -> list[Inspected]:
        """The worst cases, the worst first."""
        by_name = {each.outcome.name: each for each in self.inspected}
        return [by_name[each.name] for each in worst(self.outcomes, label, WORST)]


def run(
    parts: Sequence[Part],
    appearance: Appearance,
    policy: Policy,
    progress: Callable[[float], object] = lambda share: None,
    *,
    topic: str | None = None,
    executor: Executor | None = None,
) -> Run:
    """Inspect every part, with an executor several at a time. One that cannot be read is kept in `failed`, and the
    rest goes on. Raises WorkersLost.
    """
    inspected: list[Inspected] = []
    failed: list[Failed] = []
    results: dict[str, Result] = {}
    for count, became in enumerate(
        _became(parts, appearance, policy, progress, topic=topic, executor=executor), start=1
    ):
        if isinstance(became, Failed):
            failed.append(became)
        else:
            now, result = became
            inspected.append(now)
            results[now.outcome.name] = result
            results = _kept(results, [each.outcome for each in inspected])
        progress(count / len(parts))
    order = {(part.name, part.label): place for place, part in enumerate(parts)}
    inspected.sort(key=lambda each: order[each.outcome.name, each.outcome.label])
    failed.sort(key=lambda each: order[each.name, each.label])
    return Run(appearance, policy, tuple(inspected), tuple(failed), results)


def _became(
    parts: Sequence[Part],
    appearance: Appearance,
    policy: Policy,
    progress: Callable[[float], object],
    *,
    topic: str | None,
    executor: Executor | None,
) -> Iterator[tuple[Inspected, Result] | Failed]:
    """What became of the parts, in the order in which they are done."""
    if executor is not None:
        yield from executor.each(_elsewhere, parts, packed(appearance), policy, topic, lost=_lost)
        return
    for count, part in enumerate(parts):
        yield _tried(part, appearance, policy, _share_of(progress, count, len(parts), part.path), topic)


def _elsewhere(
    part: Part, appearance: UInt8[np.ndarray, " bytes"], policy: Policy, topic: str | None
) -> tuple[Inspected, Result] | Failed:
    return _tried(part, unpacked(appearance), policy, lambda frame, scored: None, topic)


def _tried(
    part: Part, appearance: Appearance, policy: Policy, on_scored: OnScored, topic: str | None
) -> tuple[Inspected, Result] | Failed:
    try:
        return _inspected(part, appearance, policy, on_scored, topic)
    except InspectionError as error:
        return _lost(part, str(error))


def _lost(part: Part, why: str) -> Failed:
    return Failed(part.name, part.label, why)


def _kept(results: Mapping[str, Result], outcomes: Sequence[Outcome]) -> dict[str, Result]:
    """Results are large: only those of the worst cases so far."""
    names = {each.name for label in Label for each in worst(outcomes, label, WORST)}
    return {name: result for name, result in results.items() if name in names}


def _share_of(progress: Callable[[float], object], before: int, parts: int, path: Location) -> OnScored:
    total = count_frames(path)

    def tell(frame: Frame, scored: ScoredFrame) -> None:
        if total:
            progress((before + min(1.0, (scored.index + 1) / total)) / parts)

    return tell


def _inspected(
    part: Part,
    appearance: Appearance,
    policy: Policy,
    on_scored: OnScored,
    topic: str | None,
) -> tuple[Inspected, Result]:
    recording = SweepReader(part.path, topic=topic)
    replayed = replay(recording, appearance, policy, on_scored=on_scored)
    result = _as_published(replayed.result)
    what = outcome(part.name, part.label, result, part.truth)
    scored = [frame for frame in result.frames if frame.state is FrameState.SCORED]
    peak = max(scored, key=lambda frame: frame.score, default=None)
    return Inspected(
        what,
        peak.index if peak else None,
        peak.s if peak else None,
        result.coverage,
        result.reasons,
        result.digest,
        _sha256(part.path),
        replayed.facts,
        replayed.losses,
    ), result


def _as_published(result: Result) -> Result:
    """With the numbers that scripts read in its JSON: two ways of counting must not differ in the last bit."""
    frames = (replace(f, score=number(f.score), s=None if f.s is None else number(f.s)) for f in result.frames)
    return replace(result, frames=tuple(frames), coverage=number(result.coverage))


def _sha256(path: Location) -> str:
    try:
        sha256 = hashlib.sha256()
        with path.open("rb") as file:
            while piece := file.read(1 << 20):
                sha256.update(piece)
        return f"sha256:{sha256.hexdigest()}"
    except OSError as error:
        raise NotARecording(path, error.strerror or str(error)) from error


@dataclass(frozen=True, eq=False)
class Case:
    """A part to look at."""

    inspected: Inspected
    result: Result
    part: Part
    strip: bytes | None
    """JPEG: expected, seen, difference about the peak; None where no frame was compared."""


def cases(run: Run, parts: Sequence[Part], label: Label, *, topic: str | None = None) -> list[Case]:
    """The worst cases with their filmstrips: the recordings are read once more."""
    by_name = {part.name: part for part in parts}
    found: list[Case] = []
    for each in run.worst(label):
        part, result = by_name[each.outcome.name], run.results[each.outcome.name]
        found.append(Case(each, result, part, _strip(part, result, run.appearance, topic)))
    return found


def _strip(part: Part, result: Result, appearance: Appearance, topic: str | None) -> bytes | None:
    peak = peak_of(result)
    if peak is None:
        return None
    frames = SweepReader(part.path, topic=topic)
    for _, picture in filmstrips(frames, appearance, result, [peak], part.name, around=AROUND):
        return encode_jpeg(picture, QUALITY).data
    return None
