"""Inspection: a pure step, a digest that repeats, and the same part judged alike at every pace, place and light."""

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from models.appearance import Appearance
from models.errors import PictureError
from models.frame import Frame
from models.inspection import Inspection, begin, conclude, digest, explain, out_of_tolerance, step
from models.judging import rescaled
from models.limits import promise
from models.verdict import FrameState, Judgement, Policy, Result, ScoredFrame
from tests.models.parts import (
    FIRST,
    FRAMES,
    STEP,
    View,
    frame,
    golden,
    inspected,
    places,
    shot,
    surface,
    swept,
    with_spot,
)

SEEN = View(seed=21)
SPOT = (230, 110)
"""Where the spot lies on the part; the camera stands over it at place 35."""


@lru_cache
def good() -> tuple[Frame, ...]:
    return tuple(swept(surface(), view=SEEN))


@lru_cache
def spotted(level: float = 60) -> tuple[Frame, ...]:
    return tuple(swept(with_spot(surface(), *SPOT, level=level), view=SEEN))


def after(frames: tuple[Frame, ...], policy: Policy | None = None) -> Inspection:
    state = begin(golden(), policy)
    for each in frames:
        state, _ = step(state, each)
    return state


def peak(scored: tuple[ScoredFrame, ...]) -> ScoredFrame:
    return max(scored, key=lambda each: each.score)


def result_of(frames: Iterable[Frame], policy: Policy | None = None) -> Result:
    return _result(tuple(frames), policy)


@lru_cache
def _result(frames: tuple[Frame, ...], policy: Policy | None) -> Result:
    return inspected(golden(), frames, policy)[0]


def test_a_good_part_is_ok_and_all_of_it_was_seen():
    result = result_of(good())
    assert (result.verdict, result.coverage, result.deviations) == (Judgement.OK, 1.0, ())
    assert (result.frames_scored, result.frames_dropped, result.appearance_id) == (FRAMES, 0, golden().id)
    assert peak(result.frames).score < 0.5


@pytest.mark.parametrize(("level", "polarity"), [(60, "bright"), (-50, "dark")])
def test_a_defect_is_ng_in_its_place_and_with_its_sign(level: float, polarity: str):
    result = result_of(spotted(level))
    assert result.verdict is Judgement.NG
    assert {d.polarity for d in result.deviations} == {polarity}
    # it is in the picture while the camera is less than half a picture away
    inside = [abs(FIRST + STEP * at - SPOT[0]) <= 86 for at in places()]
    for each, may in zip(result.frames, inside, strict=True):
        assert each.score < 1 or may
        for region in each.regions:
            x, y = SPOT[0] - FIRST - STEP * each.index + 79.5, SPOT[1] - 110 + 59.5
            assert region.x - 8 <= x <= region.x + region.width + 8
            assert region.y - 8 <= y <= region.y + region.height + 8
            assert region.polarity == polarity
    assert any(d.s_start < 35 / (FRAMES - 1) < d.s_end for d in result.deviations)


def test_a_step_changes_nothing_of_the_state_passed_in():
    state = after(spotted()[:30])
    before = digest(state)
    once, twice = step(state, spotted()[30]), step(state, spotted()[30])
    assert once[1] == twice[1]
    assert digest(once[0]) == digest(twice[0]) != before
    assert digest(state) == before
    np.testing.assert_array_equal(once[0].memory.trail.places.cost, twice[0].memory.trail.places.cost)


def test_a_state_kept_aside_goes_on_as_if_nothing_had_been():
    whole, kept = after(spotted()), after(spotted()[:25])
    after(good())
    for each in spotted()[25:]:
        kept, _ = step(kept, each)
    assert conclude(kept) == conclude(whole)


def test_two_parts_at_once_do_not_disturb_each_other():
    one, other = begin(golden()), begin(golden())
    for a, b in zip(good(), spotted(), strict=True):
        (one, _), (other, _) = step(one, a), step(other, b)
    assert (conclude(one), conclude(other)) == (result_of(good()), result_of(spotted()))


def test_the_digest_repeats_and_tells_frames_and_policies_apart():
    digests = [
        digest(after(good())),
        digest(after(spotted())),
        digest(after(good()[:-1])),
        digest(after(good(), Policy(coverage=0.9))),
    ]
    assert digests[0] == digest(after(good()))
    assert len(set(digests)) == len(digests)
    assert all(each.startswith("sha256:") for each in digests)


@pytest.mark.parametrize("by", [-(10**15), 1, 3_600 * 10**9, 1_767_225_600 * 10**9])
def test_a_shift_in_time_changes_nothing_at_all(by: int):
    shifted = [replace(each, t_ns=each.t_ns + by) for each in spotted()]
    one, other = result_of(spotted()), result_of(shifted)
    assert other.digest == one.digest
    assert [replace(each, t_ns=each.t_ns - by) for each in other.frames] == list(one.frames)


def test_where_a_frame_came_from_changes_nothing():
    renumbered = [replace(each, sequence=each.sequence + 500, encoder=1.5) for each in good()]
    assert result_of(renumbered) == result_of(good())


@pytest.mark.parametrize("pace", [0.8, 1.25])
def test_a_constant_pace_changes_the_scores_by_less_than_a_fifth(pace: float):
    part = with_spot(surface(), *SPOT)
    result = result_of(swept(part, places(pace), SEEN))
    assert result.verdict is Judgement.NG
    assert peak(result.frames).score == pytest.approx(peak(result_of(spotted()).frames).score, rel=0.2)
    clean = result_of(swept(surface(), places(pace), SEEN))
    assert clean.verdict is Judgement.OK
    assert peak(clean.frames).score < 0.5


@pytest.mark.parametrize(
    "view",
    [View(dx=2, dy=-3, seed=3), View(dy=2, turn=0.01, seed=4), View(gain=0.85, shade=0.05, offset=5, seed=5)],
    ids=["shifted", "turned", "another lamp"],
)
def test_placement_and_light_do_not_make_a_good_part_bad_nor_a_bad_one_good(view: View):
    assert result_of(swept(surface(), view=view)).verdict is Judgement.OK
    assert result_of(swept(with_spot(surface(), *SPOT), view=view)).verdict is Judgement.NG


def test_a_sweep_cut_short_is_incomplete_and_one_stopped_for_a_defect_is_ng():
    assert result_of(good()[:30]).verdict is Judgement.INCOMPLETE
    assert result_of(spotted()[:45]).verdict is Judgement.INCOMPLETE
    assert conclude(after(spotted()[:45]), stopped=True).verdict is Judgement.NG
    assert conclude(after(good()[:45]), stopped=True).verdict is Judgement.INCOMPLETE


@pytest.mark.parametrize("seed", [2, 3])
def test_another_part_is_invalid(seed: int):
    assert result_of(swept(surface(seed), view=SEEN)).verdict is Judgement.INVALID


def test_a_part_the_wrong_way_round_is_invalid():
    turned = [frame(np.ascontiguousarray(each.pixels[::-1, ::-1]), i) for i, each in enumerate(good())]
    assert result_of(turned).verdict is Judgement.INVALID


@pytest.mark.parametrize("level", [0, 128, 255])
def test_frames_that_show_nothing_are_blind_and_all_of_them_invalid(level: int):
    empty = np.full((120, 160), level, np.uint8)
    result = result_of([frame(empty, i) for i in range(30)])
    assert {each.state for each in result.frames} == {FrameState.BLIND}
    assert result.verdict is Judgement.INVALID
    assert "show nothing" in result.reasons[0]


def test_a_good_part_swept_backwards_is_for_review_and_says_so():
    result = result_of(swept(surface(), places()[::-1], SEEN))
    assert (result.verdict, result.deviations, result.coverage) == (Judgement.REVIEW, (), 1.0)
    assert any("ran backwards" in reason for reason in result.reasons)
    for each in result.frames:
        if each.s is not None:
            assert abs((1 - each.s) * (FRAMES - 1) - each.index) < 0.5


def test_a_defect_found_backwards_is_ng_and_a_step_back_on_the_way_is_nothing():
    assert result_of(swept(with_spot(surface(), *SPOT), places()[::-1], SEEN)).verdict is Judgement.NG
    ats = np.concatenate([places(last=30), places(first=21, last=29)[::-1], places(first=22)])
    assert result_of(swept(surface(), ats, SEEN)).verdict is Judgement.OK


def test_a_few_blind_frames_are_told_scored_zero_and_forgotten():
    frames = list(good())
    for i in (20, 21, 22):
        frames[i] = frame(np.zeros((120, 160), np.uint8), i)
    result = result_of(frames)
    assert [each.index for each in result.frames if each.state is FrameState.BLIND] == [20, 21, 22]
    assert all(each.score == 0 and each.s is None for each in result.frames[20:23])
    assert result.verdict is Judgement.OK
    assert abs(result.frames[24].s * (FRAMES - 1) - 24) < 0.5


def test_lost_frames_are_counted_and_what_they_would_have_shown_is_missed():
    kept = [each for each in good() if each.sequence % 7]
    result = result_of(kept)
    # frame 0 is not missed: nothing tells that it was to come
    assert result.frames_dropped == sum(1 for i in range(1, FRAMES) if i % 7 == 0)
    assert result.verdict is Judgement.OK
    gap = result_of([*good()[:20], *good()[45:]])
    assert (gap.frames_dropped, gap.verdict) == (25, Judgement.INCOMPLETE)


@pytest.mark.parametrize(
    "view", [View(size=(80, 60)), View(colour=True), View(deep=True)], ids=["another size", "colour", "sixteen bits"]
)
def test_another_kind_of_picture_is_refused_and_nothing_has_changed(view: View):
    state = after(good()[:10])
    before = digest(state)
    with pytest.raises(PictureError, match=r"frame 10 is .*, the appearance was learnt from 160x120 grey"):
        step(state, frame(shot(surface(), FIRST + 10 * STEP, view), 10))
    assert digest(state) == before
    for each in good()[10:]:
        state, _ = step(state, each)
    assert conclude(state) == result_of(good())


def test_twice_the_sensitivity_gives_twice_the_score():
    once, twice = (result_of(spotted(), Policy(sensitivity=by)).frames for by in (1.0, 2.0))
    for one, two in zip(once, twice, strict=True):
        assert two.score == pytest.approx(2 * one.score, rel=1e-4, abs=1e-6)
        assert two.raw_score == pytest.approx(one.raw_score, rel=1e-4, abs=1e-6)


def learnt_with(peak: float) -> Appearance:
    """As if ten golden sweeps had reached that."""
    return replace(golden(), peaks=(peak,) * 10)


@pytest.mark.parametrize("target", [0.0001, 0.05, 0.5])
def test_scores_are_in_units_of_what_the_golden_sweeps_promise_at_the_target(target: float):
    for peak in (0.1, 1.5):
        appearance = learnt_with(peak)
        usual, asked = (inspected(appearance, spotted(), policy)[0] for policy in (None, Policy(false_rejects=target)))
        by = promise(appearance.peaks, Policy.false_rejects).factor / promise(appearance.peaks, target).factor
        for one, two in zip(rescaled(usual.frames, by), asked.frames, strict=True):
            assert two.raw_score == pytest.approx(one.raw_score, rel=1e-4, abs=1e-6) or max(one.score, two.score) < 0.5
            assert two.score == pytest.approx(one.score, rel=1e-4, abs=1e-6) or max(one.score, two.score) < 0.5


def test_golden_sweeps_that_differ_more_score_less():
    quiet, loud = (inspected(learnt_with(peak), spotted())[0] for peak in (0.1, 2.0))
    assert peak(quiet.frames).score > 2 * peak(loud.frames).score


def test_no_frame_at_all_is_invalid():
    result = conclude(begin(golden()))
    assert (result.verdict, result.coverage, result.frames) == (Judgement.INVALID, 0.0, ())


def test_what_is_shown_beside_each_other_is_the_expected_and_the_seen():
    state = after(spotted()[:35])
    each = spotted()[35]
    shown = explain(golden(), each, step(state, each)[1])
    assert shown.expected.shape == shown.seen.shape == shown.difference.shape == (120, 160)
    assert (shown.expected.dtype, shown.seen.dtype, shown.difference.dtype) == (np.uint8, np.uint8, np.float32)
    np.testing.assert_allclose(shown.difference, shown.seen.astype(float) - shown.expected, atol=1)
    y, x = np.unravel_index(shown.difference[8:-8, 8:-8].argmax(), (104, 144))
    assert abs(x + 8 - 79.5) < 7
    assert abs(y + 8 - 59.5) < 7
    assert np.median(np.abs(shown.difference)) < 2


def test_the_placement_told_lays_the_frame_on_its_reference():
    view = View(dx=2, dy=-3, turn=0.01, gain=0.9, seed=8)
    frames = swept(surface(), view=view)
    _, scored = inspected(golden(), frames)
    for i in (10, 30, 50):
        shown = explain(golden(), frames[i], scored[i])
        assert shown.placement == scored[i].placement
        assert np.abs(shown.difference[10:-10, 10:-10]).mean() < 3


@pytest.mark.parametrize(("level", "sign"), [(60, 1), (-50, -1)])
def test_what_is_out_of_tolerance_is_the_spot_with_its_sign_and_nothing_else(level: float, sign: int):
    state = after(spotted(level)[:34])
    each = spotted(level)[34]
    scored = step(state, each)[1]
    shown = explain(golden(), each, scored)
    beyond = out_of_tolerance(golden(), Policy(), scored, shown)
    over = np.argwhere(np.abs(beyond) >= 1)
    assert (beyond.shape, beyond.dtype, len(over) > 20) == ((120, 160), np.float32, True)
    assert (sign * beyond[tuple(over.T)] >= 1).all()
    a, b, c, d, e, f = scored.placement
    y, x = over.mean(axis=0)
    # The camera stands over place 34, a step before the spot.
    assert (a * x + b * y + c, d * x + e * y + f) == pytest.approx((SPOT[0] - FIRST - STEP * 34 + 79.5, 59.5), abs=2)
    half = out_of_tolerance(golden(), Policy(sensitivity=0.5), scored, shown)
    np.testing.assert_allclose(half, 0.5 * beyond, rtol=1e-5)
    ignore = np.zeros((120, 160), bool)
    ignore[:, 40:120] = True
    masked = replace(golden(), preparation=replace(golden().preparation, ignore=ignore))
    assert np.abs(out_of_tolerance(masked, Policy(), scored, shown)).max() < 1


def test_a_frame_that_was_not_compared_cannot_be_explained():
    empty = frame(np.zeros((120, 160), np.uint8), 0)
    assert explain(golden(), empty, step(begin(golden()), empty)[1]) is None


def test_three_residuals_tell_a_bad_part_a_bumped_fixture_and_a_quick_robot_apart():
    bad = result_of(spotted()).frames
    bumped = result_of(swept(surface(), view=View(dy=9, seed=6))).frames
    quick = result_of(swept(surface(), places(2.0), SEEN)).frames

    def usual(frames: tuple[ScoredFrame, ...], kind: str) -> float:
        return float(np.median([getattr(each.residuals, kind) for each in frames[15:]]))

    assert usual(bad, "appearance") > 3 * max(usual(bumped, "appearance"), usual(quick, "appearance"))
    assert usual(bumped, "position") > max(usual(bad, "position"), usual(quick, "position"))
    assert usual(quick, "timing") > 3 * max(usual(bad, "timing"), usual(bumped, "timing"))


def test_what_was_said_of_every_frame_is_kept_in_order_however_many_there_are():
    part = surface()
    frames = [replace(each, sequence=i, t_ns=i * 40_000_000) for i, each in enumerate([swept(part, [20.0])[0]] * 280)]
    state = begin(golden())
    said = list[ScoredFrame]()
    middle = None
    for each in frames:
        state, scored = step(state, each)
        said.append(scored)
        middle = state if len(said) == 200 else middle
    assert state.frames == tuple(said)
    assert (state.count, [each.index for each in state.frames]) == (280, list(range(280)))
    # an earlier state goes on as if nothing had come after it
    assert middle is not None
    assert middle.frames == tuple(said[:200])
    assert step(middle, frames[200])[1] == said[200]


WAYS = {
    "turns back": np.concatenate([places(last=30), places(first=12, last=29)[::-1], places(first=13)]),
    "stands still": np.concatenate([places(last=25), np.full(40, 25.0), places(first=26)]),
    "jumps ahead": np.concatenate([places(last=20), places(first=38)]),
    "starts late": places(first=10),
    "starts very late": places(first=30),
}


@pytest.mark.parametrize("part", ["good", "spotted"])
@pytest.mark.parametrize("way", WAYS)
def test_whatever_way_a_sweep_takes_no_frame_is_scored_at_a_wrong_place(way: str, part: str):
    ats = WAYS[way]
    result = result_of(swept(surface() if part == "good" else with_spot(surface(), *SPOT), ats, SEEN))
    assert {d.kind for d in result.deviations} == (set() if part == "good" else {"appearance"})
    for each, at in zip(result.frames, ats, strict=True):
        assert each.s is None or abs(each.s * (FRAMES - 1) - at) < 0.5
    # found again within a few frames
    assert result.frames_scored >= len(ats) - 5


@pytest.mark.parametrize("blank", [3, 8, 12])
def test_a_sweep_that_goes_blank_in_the_middle_is_placed_right_when_it_is_back(blank: int):
    frames = list(good())
    for i in range(20, 20 + blank):
        frames[i] = frame(np.full((120, 160), 30, np.uint8), i)
    result = result_of(frames)
    assert (result.deviations, result.frames_scored) == ((), FRAMES - blank)
    assert all(each.s is None or abs(each.s * (FRAMES - 1) - each.index) < 0.5 for each in result.frames)


def test_a_long_blank_stretch_is_told_with_its_reason():
    frames = list(good())
    for i in range(20, 40):
        frames[i] = frame(np.full((120, 160), 30, np.uint8), i)
    result = result_of(frames)
    (told,) = [reason for reason in result.reasons if "not seen" in reason]
    assert told.endswith(": 20 frames showed nothing")
