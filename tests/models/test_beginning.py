"""Beginning: the right part passes, another one or one that lies upside down is INVALID before a tenth is over."""

from collections.abc import Iterable, Sequence
from functools import lru_cache

import cv2
import numpy as np
import pytest

from models.frame import Frame
from models.inspection import Inspection, begin, conclude, digest, step
from models.learning import learn
from models.recognition import Card, Other
from models.verdict import FrameState, Judgement, Recognised, Result
from tests.models.parts import FIRST, FRAMES, View, frame, golden, places, pose_of, shot, surface, swept, with_spot

SEEN = View(seed=31)
TENTH = FRAMES // 10


def after(frames: Iterable[Frame]) -> Inspection:
    state = begin(golden())
    for each in frames:
        state, _ = step(state, each)
    return state


def upside_down(frames: Sequence[Frame]) -> list[Frame]:
    """What the same camera sees of a part that lies turned by 180 degrees: its end first."""
    return [frame(cv2.rotate(each.pixels, cv2.ROTATE_180), i) for i, each in enumerate(reversed(frames))]


@lru_cache
def other(seed: int) -> Other:
    appearance = learn([swept(surface(seed))])
    return Other(f"part{seed}", Card.of(appearance), lambda: appearance)


def early(frames: Sequence[Frame], others: Sequence[Other] = ()) -> Result:
    return conclude(after(frames[:TENTH]), others=others)


@pytest.mark.parametrize(
    "view",
    [SEEN, View(dx=2, dy=-2, turn=0.006, seed=3), View(gain=0.7, offset=9, shade=0.1, seed=4), View(noise=4, seed=5)],
)
@pytest.mark.parametrize("pace", [0.6, 1.0, 1.5])
def test_the_learnt_part_passes_at_every_pace_place_and_light(view: View, pace: float):
    state = begin(golden())
    for each in swept(surface(), places(pace), view):
        state, _ = step(state, each)
        assert not state.beginning.failed
    assert state.beginning.confirmed
    assert not state.beginning.kept


@pytest.mark.parametrize("seed", [2, 3])
def test_another_part_is_invalid_before_a_tenth_is_over_and_is_named(seed: int):
    frames, others = swept(surface(seed), view=SEEN), [other(2), other(3)]
    told = early(frames, others)
    assert told.verdict is Judgement.INVALID
    assert told.recognised is not None
    assert (told.recognised.part, told.recognised.turned) == (f"part{seed}", False)
    assert told.reasons[0] == told.recognised.sentence()
    whole = conclude(after(frames), others=others)
    assert (whole.verdict, whole.recognised) == (Judgement.INVALID, told.recognised)


def test_a_part_that_lies_upside_down_is_told_so():
    frames = upside_down(swept(surface(), view=SEEN))
    told = early(frames, [other(2), other(3)])
    assert told.verdict is Judgement.INVALID
    assert told.recognised is not None
    assert (told.recognised.part, told.recognised.turned) == (None, True)
    assert "upside down, turned by 180 degrees" in told.reasons[0]
    twice = early(upside_down(swept(surface(3), view=SEEN)), [other(2), other(3)])
    assert twice.recognised is not None
    assert (twice.recognised.part, twice.recognised.turned) == ("part3", True)


@pytest.mark.parametrize(("dy", "turn"), [(40, 0.0), (-30, 0.0), (-25, 0.15), (0, -0.2)])
def test_how_a_part_lies_that_is_too_far_off_is_told(dy: float, turn: float):
    view = View(dy=dy, turn=turn, seed=8)
    told = early(swept(surface(), view=view), [other(2)])
    assert told.verdict is Judgement.INVALID
    assert told.recognised is not None
    assert told.recognised.part is None
    assert told.recognised.off is not None
    across, degrees = told.recognised.off
    # the camera goes to the right, so that pictures go to the left, and down is to their left
    assert across == pytest.approx(-pose_of(view, FIRST)[1], abs=1.0)
    assert degrees == pytest.approx(np.rad2deg(turn), abs=0.3)
    assert "the part lies off" in told.reasons[0]


def test_a_part_that_nobody_knows_is_invalid_without_a_name():
    told = early(swept(surface(6), view=SEEN), [other(2), other(3)])
    assert (told.verdict, told.recognised) == (Judgement.INVALID, None)
    assert "another part" in told.reasons[0]


def test_which_others_are_known_changes_neither_verdict_nor_digest():
    state = after(swept(surface(2), view=SEEN))
    alone, asked = conclude(state), conclude(state, others=[other(2), other(3)])
    assert alone.digest == asked.digest == digest(state)
    assert (alone.verdict, alone.deviations, alone.frames) == (asked.verdict, asked.deviations, asked.frames)
    assert asked.reasons[1:] == alone.reasons
    assert alone.recognised is None


def test_where_all_is_well_nobody_is_asked():
    def never() -> None:
        pytest.fail("asked for an appearance")

    told = conclude(after(swept(surface(), view=SEEN)), others=[Other("x", other(2).card, never)])  # type: ignore[arg-type]
    assert (told.verdict, told.recognised) == (Judgement.OK, None)


def test_the_line_may_wait_for_the_part():
    rng, empty = np.random.default_rng(7), shot(surface(9), 100.0)
    still = [np.clip(empty + rng.standard_normal(empty.shape), 0, 255).astype(np.uint8) for _ in range(30)]
    frames = [frame(each, i) for i, each in enumerate(still)]
    frames += [frame(each.pixels, 30 + i) for i, each in enumerate(swept(surface(), view=SEEN))]
    state = begin(golden())
    for each in frames:
        state, _ = step(state, each)
        assert not state.beginning.failed
    assert conclude(state).verdict is Judgement.OK


def test_a_part_that_comes_after_something_else_is_inspected_all_the_same():
    before = swept(surface(9), places(last=14), view=SEEN)
    frames = [*before, *(frame(each.pixels, 15 + i) for i, each in enumerate(swept(surface(), view=SEEN)))]
    state = after(before)
    assert state.beginning.failed
    state = after(frames)
    assert state.beginning.confirmed
    assert conclude(state).verdict is Judgement.OK
    assert all(each.state is FrameState.SCORED for each in state.frames[15:])


def test_another_part_keeps_its_name_where_a_stretch_of_it_is_as_learnt():
    frames = [*swept(surface(2), view=SEEN)[:30], *swept(surface(), view=SEEN)[30:45]]
    state = after(frame(each.pixels, i) for i, each in enumerate(frames))
    told = conclude(state, others=[other(2)])
    assert state.beginning.confirmed
    assert told.verdict is Judgement.INVALID
    assert told.recognised is not None
    assert told.recognised.part == "part2"


def test_a_part_with_defects_from_its_beginning_on_is_no_other_part():
    spoilt = surface()
    for x, y in ((70, 100), (120, 130), (150, 70)):
        spoilt = with_spot(spoilt, x, y, size=14, level=70)
    state = begin(golden())
    for each in swept(spoilt, view=SEEN):
        state, _ = step(state, each)
        assert not state.beginning.failed
    assert conclude(state).verdict is Judgement.NG


def test_frames_that_cannot_be_compared_are_not_of_another_part():
    dark = [frame(np.full((120, 160), 30, np.uint8), i) for i in range(20)]
    state = after(dark)
    assert not state.beginning.failed
    assert conclude(state, others=[other(2)]).recognised is None


def test_a_sentence_names_part_and_way():
    assert (
        Recognised("lid", "sha256:0", False, 5, 6).sentence()
        == "another part: lid fits better: 5 of 6 frames agree with it"
    )
    assert "lid fits better, upside down" in Recognised("lid", "sha256:0", True, 5, 6).sentence()
