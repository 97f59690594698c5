"""Parts of which it is known whether they are good: what an inspection made of them, one by one and all together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from models.measures import Proportion, auroc
from models.verdict import FrameState, Judgement, Region, Result, ScoredFrame

SLACK = 10.0
"""Pixels by which a region's centre may lie outside of a defect's box and still find it."""
BLANKET = 9.0
"""Times the area of the box with its slack: larger regions point at nothing."""
ONE_FRAME = 1.0

Box = tuple[float, float, float, float]
DefectId = int | str


class Label(StrEnum):
    """What is known of a part before it is inspected."""

    GOOD = "good"
    BAD = "bad"


@dataclass(frozen=True)
class DefectSeen:
    """A defect as it is in one frame."""

    id: DefectId
    """The same defect in other frames has the same."""
    box: Box
    """x1, y1, x2, y2 in pixels of the frame; may reach beyond it."""
    inside: bool
    """Whether all of the box is in the frame."""


@dataclass(frozen=True)
class FrameTruth:
    """What one frame really shows."""

    index: int
    """Counts the frames of the recording from 0."""
    s: float
    """Place on the reference path that is nearest to what the camera sees."""
    commanded: float
    """Where the robot believed to be, in frames of the nominal sweep."""
    defects: tuple[DefectSeen, ...] = ()


@dataclass(frozen=True)
class Truth:
    """What a recording really shows."""

    nominal_frames: int
    """Frames of a sweep at the nominal pace: what a frame is along s."""
    frames: tuple[FrameTruth, ...]


@dataclass(frozen=True)
class Tally:
    """One part's frames against the truth."""

    clean: tuple[float, ...]
    """Scores of frames that show no defect; 0.0 of those that were not scored."""
    defective: tuple[float, ...]
    """Scores of frames that show a whole defect."""
    within: Proportion
    """Frames whose place is right to one frame, of those that have a place."""
    missing: int
    """Frames that the truth knows and the inspection never saw."""
    shown: tuple[DefectId, ...]
    """Defects that were whole in a frame."""
    found: tuple[DefectId, ...]
    """Those of them that a region pointed at in a frame at or above the limit."""

    @property
    def flagged(self) -> Proportion:
        """Clean frames at or above the limit."""
        return Proportion(sum(score >= 1.0 for score in self.clean), len(self.clean))


@dataclass(frozen=True)
class Outcome:
    """What became of one part."""

    name: str
    label: Label
    verdict: Judgement
    score: float | None
    """The highest of a frame; None where none was scored."""
    frames: int
    unscored: int
    """Frames without a score, whatever the reason."""
    tally: Tally | None = None
    """Against the truth, where it is known."""

    @property
    def right(self) -> bool:
        """A good part is OK, a bad one is anything else."""
        return (self.verdict is Judgement.OK) == (self.label is Label.GOOD)


def outcome(name: str, label: Label, result: Result, truth: Truth | None) -> Outcome:
    """The part's outcome, by its result."""
    scores = [frame.score for frame in result.frames if frame.state is FrameState.SCORED]
    known = tally(result.frames, truth, label) if truth else None
    unscored = len(result.frames) - len(scores)
    return Outcome(name, label, result.verdict, max(scores, default=None), len(result.frames), unscored, known)


def tally(frames: Sequence[ScoredFrame], truth: Truth, label: Label) -> Tally:
    """Every frame of one part against what it really shows.

    Of a bad part whose defects the truth does not place, no frame is known to be clean.
    """
    by_index = {frame.index: frame for frame in frames}
    placed = label is Label.GOOD or any(known.defects for known in truth.frames)
    clean: list[float] = []
    defective: list[float] = []
    pointed: set[DefectId] = set()
    near: list[bool] = []
    missing = 0
    for known in truth.frames:
        frame = by_index.get(known.index)
        if frame is None:
            missing += 1
            continue
        if frame.s is not None:
            near.append(within_one_frame(frame.s, known, truth.nominal_frames))
        if any(defect.inside for defect in known.defects):
            defective.append(frame.score)
        elif not known.defects and placed:
            clean.append(frame.score)
        if frame.score >= 1.0:
            pointed |= {d.id for d in known.defects if any(points_at(region, d.box) for region in frame.regions)}
    shown = dict.fromkeys(d.id for known in truth.frames for d in known.defects if d.inside)
    return Tally(
        tuple(clean),
        tuple(defective),
        Proportion(sum(near), len(near)),
        missing,
        tuple(shown),
        tuple(defect for defect in shown if defect in pointed),
    )


def within_one_frame(s: float, known: FrameTruth, nominal_frames: int) -> bool:
    """Whether a place is right to one frame of the nominal sweep.

    A part that lies off along the path is seen at another place than the robot was sent to; all between is right.

    >>> known = FrameTruth(0, s=0.5, commanded=52.0)
    >>> [within_one_frame(at / 100, known, 101) for at in (48.9, 49.1, 52.9, 53.1)]
    [False, True, True, False]
    """
    at = s * (nominal_frames - 1)
    low, high = sorted((known.commanded, known.s * (nominal_frames - 1)))
    return low - ONE_FRAME <= at <= high + ONE_FRAME


def points_at(region: Region, box: Box) -> bool:
    """Whether a region finds a defect: its centre lies in the box with some slack, and it is no blanket.

    >>> [points_at(Region(x, 20, 8, 8, 1.2, "dark"), (10, 10, 30, 30)) for x in (36, 37)]
    [True, False]
    """
    x1, y1, x2, y2 = box[0] - SLACK, box[1] - SLACK, box[2] + SLACK, box[3] + SLACK
    x, y = region.x + region.width / 2, region.y + region.height / 2
    return region.width * region.height <= BLANKET * (x2 - x1) * (y2 - y1) and x1 <= x <= x2 and y1 <= y <= y2


@dataclass(frozen=True)
class Summary:
    """Figures over all parts; None is not known, and never none."""

    confusion: dict[Judgement, dict[Label, int]]
    false_rejects: Proportion
    """Good parts with a verdict other than OK."""
    escapes: Proportion
    """Bad parts that are OK."""
    part_auroc: float | None
    """By the highest score of a frame; parts without a scored frame say nothing."""
    frame_auroc: float | None
    """Frames with a whole defect against frames without any."""
    defects_found: Proportion | None
    """Of the defects that were shown by bad parts."""
    clean_flagged: Proportion | None
    within_one_frame: Proportion | None
    """Of the frames that have a place."""
    unscored: Proportion
    """Of all frames."""
    missing: int | None
    """Frames that the truth knows and no inspection saw."""


def summarise(outcomes: Sequence[Outcome]) -> Summary:
    """Every figure, over these parts."""
    good = [each for each in outcomes if each.label is Label.GOOD]
    bad = [each for each in outcomes if each.label is Label.BAD]
    known = [each.tally for each in outcomes if each.tally]
    return Summary(
        {verdict: _labels([each for each in outcomes if each.verdict is verdict]) for verdict in Judgement},
        Proportion(sum(not each.right for each in good), len(good)),
        Proportion(sum(not each.right for each in bad), len(bad)),
        auroc(_scores(good), _scores(bad)),
        auroc([s for t in known for s in t.clean], [s for t in known for s in t.defective]),
        _pooled([Proportion(len(each.tally.found), len(each.tally.shown)) for each in bad if each.tally]),
        _pooled([each.flagged for each in known]),
        _pooled([each.within for each in known]),
        Proportion(sum(each.unscored for each in outcomes), sum(each.frames for each in outcomes)),
        sum(each.missing for each in known) if known else None,
    )


def _labels(outcomes: Sequence[Outcome]) -> dict[Label, int]:
    return {label: sum(each.label is label for each in outcomes) for label in Label}


def _scores(outcomes: Sequence[Outcome]) -> list[float]:
    return [each.score for each in outcomes if each.score is not None]


def _pooled(proportions: Sequence[Proportion]) -> Proportion | None:
    """All of them as one; None of nothing."""
    of = sum(each.of for each in proportions)
    return Proportion(sum(each.count for each in proportions), of) if of else None


def worst(outcomes: Sequence[Outcome], label: Label, count: int) -> list[Outcome]:
    """Good parts with the highest scores, or bad ones with the lowest; those that were judged wrongly come first.

    A part without a score comes last: there is nothing to look at.
    """
    sign = -1 if label is Label.GOOD else 1
    mine = [each for each in outcomes if each.label is label]
    return sorted(mine, key=lambda each: (each.score is None, each.right, sign * (each.score or 0.0), each.name))[
        :count
    ]
