"""Labelled parts: frames against the truth, counted by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from models.labelled import (
    Box,
    DefectSeen,
    FrameTruth,
    Label,
    Outcome,
    Truth,
    outcome,
    points_at,
    summarise,
    within_one_frame,
    worst,
)
from models.measures import Proportion
from models.verdict import FrameState, Judgement, Region, Residuals, Result, ScoredFrame

BOX: Box = (20, 20, 40, 30)
ON_IT = Region(25, 20, 10, 10, 2.0, "dark")


def frame(index: int, score: float, s: float | None, *regions: Region) -> ScoredFrame:
    state = FrameState.LOST if s is None else FrameState.SCORED
    return ScoredFrame(index, index, state, s, score, score, Residuals(score, 0, 0), regions)


def result(*frames: ScoredFrame, verdict: Judgement = Judgement.NG) -> Result:
    return Result(verdict, (), 1.0, len(frames), 0, (), "", "", frames)


def seen(defect: int, inside: bool = True) -> DefectSeen:
    return DefectSeen(defect, BOX, inside)


TRUTH = Truth(
    5,
    (
        FrameTruth(0, 0.0, 0.0),
        FrameTruth(1, 0.25, 1.0, (seen(1, inside=False),)),
        FrameTruth(2, 0.5, 2.0, (seen(1),)),
        FrameTruth(3, 0.75, 3.0, (seen(2),)),
        FrameTruth(4, 1.0, 4.0),
        FrameTruth(5, 1.0, 4.0),
    ),
)
FRAMES = (
    frame(0, 1.1, 0.0),
    frame(1, 1.5, 0.25, ON_IT),
    frame(2, 0.9, 0.4, ON_IT),
    frame(3, 1.4, 0.1, Region(60, 60, 5, 5, 2.0, "dark")),
    frame(4, 0.0, None),
)


def test_every_frame_is_counted_as_what_it_shows() -> None:
    found = outcome("a", Label.BAD, result(*FRAMES), TRUTH)
    tally = found.tally
    assert tally is not None
    assert (tally.clean, tally.defective) == ((1.1, 0.0), (0.9, 1.4))
    assert tally.flagged == Proportion(1, 2)
    assert (tally.shown, tally.found) == ((1, 2), (1,))
    assert tally.within == Proportion(3, 4)
    assert tally.missing == 1
    assert (found.score, found.frames, found.unscored) == (1.5, 5, 1)


def test_of_a_bad_part_without_placed_defects_no_frame_is_known_to_be_clean() -> None:
    bare = Truth(5, tuple(replace(each, defects=()) for each in TRUTH.frames))
    bad, good = (outcome("a", label, result(*FRAMES), bare).tally for label in (Label.BAD, Label.GOOD))
    assert bad is not None
    assert good is not None
    assert (bad.clean, len(good.clean)) == ((), 5)


def test_a_part_without_a_scored_frame_has_no_score() -> None:
    found = outcome("a", Label.BAD, result(frame(0, 0.0, None), verdict=Judgement.INVALID), None)
    assert (found.score, found.unscored, found.right) == (None, 1, True)
    assert summarise([found, replace(found, name="b", label=Label.GOOD, score=0.3)]).part_auroc is None


@pytest.mark.parametrize(
    ("region", "finds"),
    [
        ((25, 20, 10, 10), True),
        ((46, 20, 8, 10), True),  # its centre at 50: the box and ten pixels
        ((47, 20, 8, 10), False),
        ((25, 37, 10, 6), True),
        ((25, 38, 10, 6), False),
        ((-15, -10, 90, 70), True),
        ((-50, -50, 160, 150), False),  # a blanket: more than nine times 40 x 30
    ],
)
def test_a_region_finds_a_defect_near_its_centre_unless_it_is_a_blanket(
    region: tuple[int, int, int, int], finds: bool
) -> None:
    assert points_at(Region(*region, 1.0, "dark"), BOX) is finds


def test_between_the_place_seen_and_the_place_commanded_all_is_right() -> None:
    known = FrameTruth(0, s=0.5, commanded=53.0)
    right = [at for at in range(101) if within_one_frame(at / 100, known, 101)]
    assert right == [49, 50, 51, 52, 53, 54]


def parts() -> list[Outcome]:
    good = ((Judgement.OK, 0.2), (Judgement.REVIEW, 0.97), (Judgement.OK, 0.6))
    bad = ((Judgement.NG, 3.0), (Judgement.OK, 0.5), (Judgement.INVALID, None))
    known = [*((Label.GOOD, *each) for each in good), *((Label.BAD, *each) for each in bad)]
    return [Outcome(f"p{n}", label, verdict, score, 10, 0) for n, (label, verdict, score) in enumerate(known)]


def test_figures_without_a_truth_are_not_known_and_the_others_are() -> None:
    found = summarise(parts())
    assert (found.false_rejects, found.escapes) == (Proportion(1, 3), Proportion(1, 3))
    assert found.part_auroc == pytest.approx((3 + 1) / 6)
    assert found.confusion[Judgement.OK] == {Label.GOOD: 2, Label.BAD: 1}
    unknown = (found.frame_auroc, found.defects_found, found.clean_flagged, found.within_one_frame, found.missing)
    assert unknown == (None,) * 5
    assert found.unscored == Proportion(0, 60)


def test_the_worst_are_those_judged_wrongly_then_those_that_nearly_were() -> None:
    assert [each.name for each in worst(parts(), Label.GOOD, 2)] == ["p1", "p2"]
    assert [each.name for each in worst(parts(), Label.BAD, 3)] == ["p4", "p3", "p5"]
