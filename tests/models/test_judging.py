"""Judging: scored frames in, verdict out; no picture anywhere."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.fixture import Path
from models.judging import judge, rescaled
from models.verdict import Deviation, FrameState, Judgement, Policy, Region, Residuals, Result, ScoredFrame
from tests.models.parts import MANY

N = 100
S = np.linspace(0, 1, N)
PATH = Path(np.tile([-20.0, 0.0], (N, 1)))
LIMIT = {"hysteresis": 0.7, "review_margin": 0.1, "coverage": 0.95, "invalid_share": 0.5}
POLICY = Policy(**LIMIT)
RANK = [Judgement.OK, Judgement.REVIEW, Judgement.NG]


def scored(index: int, score: float = 0.0, *, position: float = 0.0, timing: float = 0.0) -> ScoredFrame:
    """Frame `index` of N at its own place."""
    regions = (Region(3, 4, 5, 6, score, "dark"),) if score >= 1 else ()
    residuals = Residuals(score, position, timing)
    return ScoredFrame(index, 40 * index, FrameState.SCORED, S[index], score, 10 * score, residuals, regions)


def unscored(index: int, state: FrameState) -> ScoredFrame:
    return ScoredFrame(index, 40 * index, state, None, 0.0, 0.0, Residuals(0.0, 0.0, 0.0))


def sweep(**scores: float) -> list[ScoredFrame]:
    """All places, with the score `f12=1.5` at frame 12."""
    return [scored(i, scores.get(f"f{i}", 0.1)) for i in range(N)]


def judged(frames: Sequence[ScoredFrame], policy: Policy = POLICY, stopped: bool = False) -> Result:
    return judge(frames, policy, S, PATH, appearance_id="a", dropped=3, digest="d", stopped=stopped)


def deviations(frames: Sequence[ScoredFrame], policy: Policy = POLICY) -> tuple[Deviation, ...]:
    return judged(frames, policy).deviations


def but(change: Callable[[int], bool], state: FrameState) -> list[ScoredFrame]:
    return [unscored(f.index, state) if change(f.index) else f for f in sweep()]


TABLE = {
    "all within tolerance": (sweep(), Judgement.OK),
    "raised, but not near the limit": (sweep(f40=0.85), Judgement.OK),
    "just below the limit": (sweep(f40=0.97), Judgement.REVIEW),
    "at the limit": (sweep(f40=1.0), Judgement.NG),
    "one frame far beyond it": (sweep(f40=9.0), Judgement.NG),
    "too fast all the time": ([scored(i, timing=1.2) for i in range(N)], Judgement.REVIEW),
    "off the curve for a while": ([scored(i, position=1.5 * (30 < i < 50)) for i in range(N)], Judgement.REVIEW),
    "off the curve in one frame": ([scored(i, position=1.5 * (i == 30)) for i in range(N)], Judgement.OK),
    "a third not seen": (sweep()[:66], Judgement.INCOMPLETE),
    "the middle not seen": (sweep()[:40] + sweep()[60:], Judgement.INCOMPLETE),
    "a defect, and a third not seen": (sweep(f20=3.0)[:66], Judgement.INCOMPLETE),
    "a third not seen, three lost": (but(lambda i: i in (20, 21, 22), FrameState.LOST)[:66], Judgement.INCOMPLETE),
    "lost for a third": (but(lambda i: 40 <= i < 70, FrameState.LOST), Judgement.INVALID),
    "one frame lost": (but(lambda i: i == 40, FrameState.LOST), Judgement.OK),
    "mostly lost": (but(lambda i: i % 5 > 1, FrameState.LOST), Judgement.INVALID),
    "mostly ambiguous": (but(lambda i: i > 20, FrameState.AMBIGUOUS), Judgement.INVALID),
    "lamp out": (but(lambda i: True, FrameState.BLIND), Judgement.INVALID),
    "never began": (but(lambda i: True, FrameState.WAITING), Judgement.INVALID),
    "four frames": (sweep()[:4], Judgement.INVALID),
    "no frame": ([], Judgement.INVALID),
}


@pytest.mark.parametrize("name", TABLE)
def test_the_verdict_is_that_of_the_table_and_says_why(name: str):
    frames, verdict = TABLE[name]
    result = judged(frames)
    assert result.verdict is verdict
    assert result.reasons
    assert all(reason.strip() for reason in result.reasons)


def test_only_a_sweep_stopped_because_ng_was_certain_is_ng_before_its_end():
    assert judged(sweep(f20=3.0)[:66], stopped=True).verdict is Judgement.NG
    assert judged(sweep()[:66], stopped=True).verdict is Judgement.INCOMPLETE
    assert judged(sweep(f20=0.95)[:66], stopped=True).verdict is Judgement.INCOMPLETE
    assert judged(sweep(f20=3.0)[:4], stopped=True).verdict is Judgement.INVALID


def test_the_result_carries_what_it_was_given():
    frames = but(lambda i: i == 7, FrameState.LOST)
    result = judged(frames)
    assert (result.appearance_id, result.digest, result.frames_dropped, result.frames_scored) == ("a", "d", 3, N - 1)
    assert result.frames == tuple(frames)


def test_a_deviation_begins_and_ends_by_hysteresis_and_needs_its_peak():
    (found,) = deviations(sweep(f39=0.6, f40=0.75, f41=1.4, f42=2.5, f43=0.72, f44=0.6))
    assert (found.index_start, found.index_end, found.peak_index, found.peak_score) == (40, 44, 42, 2.5)
    assert found.s_start == S[40]
    assert S[43] < found.s_end <= S[44] + 1e-9
    assert (found.kind, found.polarity, found.regions) == ("appearance", "dark", (Region(3, 4, 5, 6, 2.5, "dark"),))
    assert not deviations(sweep(f40=0.9, f41=0.99))


def test_a_long_dip_below_the_hysteresis_makes_two_of_them():
    one = deviations(sweep(f40=2, f41=0.8, f42=2))
    two = deviations(sweep(f40=2, f55=2))
    assert [(d.index_start, d.index_end) for d in one] == [(40, 43)]
    assert [(d.index_start, d.index_end) for d in two] == [(40, 41), (55, 56)]


SCORES = st.lists(st.floats(0, 3), min_size=N, max_size=N)


@given(scores=SCORES, low=st.floats(0.1, 1), backwards=st.booleans())
@MANY
def test_deviations_are_ordered_disjoint_and_hold_every_frame_at_the_limit(
    scores: list[float], low: float, backwards: bool
):
    frames = [scored(i, score) for i, score in enumerate(scores)]
    if backwards:
        frames = [replace(f, index=i, s=1 - f.s) for i, f in enumerate(frames)]
    found = deviations(frames, replace(POLICY, hysteresis=low))
    held = [i for d in found for i in range(d.index_start, d.index_end)]
    assert held == sorted(set(held))
    assert {i for i, score in enumerate(scores) if score >= 1} <= set(held)
    for d in found:
        inside = scores[d.index_start : d.index_end]
        assert (d.peak_score, d.peak_score) == (max(inside), scores[d.peak_index])
        assert min(inside[0], inside[-1]) >= low
        assert d.index_start <= d.peak_index < d.index_end
        assert d.s_start <= frames[d.peak_index].s <= d.s_end
        assert 0 <= d.s_start < d.s_end <= 1


def test_a_deviation_of_several_frames_has_an_extent():
    (found,) = deviations(sweep(f40=2, f41=2, f42=2))
    assert found.s_start < found.s_end


@pytest.mark.parametrize("at", [0, 1, 40, N - 2])
def test_a_deviation_of_a_single_frame_reaches_to_the_next_place(at: int):
    (found,) = deviations(sweep(**{f"f{at}": 2.0}))
    assert (found.s_start, found.s_end) == (pytest.approx(S[at]), pytest.approx(S[at + 1]))


def test_a_deviation_in_the_last_frame_ends_with_the_sweep_and_has_an_extent():
    (found,) = deviations(sweep(**{f"f{N - 1}": 2.0}))
    assert (found.s_start, found.s_end) == (pytest.approx(S[-2]), 1.0)


def test_kinds_are_told_apart():
    frames = [scored(i, 2.0 * (i == 50), position=1.5 * (i < 20), timing=2.0 * (i > 70)) for i in range(N)]
    found = deviations(frames)
    assert [d.kind for d in found] == ["position", "appearance", "timing"]
    assert judged(frames).verdict is Judgement.NG


@given(scores=SCORES, raised=st.dictionaries(st.integers(0, N - 1), st.floats(0, 3)))
@MANY
def test_raising_a_score_never_makes_the_verdict_better(scores: list[float], raised: dict[int, float]):
    higher = [max(score, raised.get(i, 0.0)) for i, score in enumerate(scores)]
    before, after = (judged([scored(i, s) for i, s in enumerate(given)]) for given in (scores, higher))
    assert RANK.index(after.verdict) >= RANK.index(before.verdict)


@given(seen=st.lists(st.booleans(), min_size=N, max_size=N))
@MANY
def test_coverage_grows_with_the_frames_and_is_whole_only_without_long_gaps(seen: list[bool]):
    frames = [f for f, here in zip(sweep(), seen, strict=True) if here]
    fewer = frames[::2]
    assert 0 <= judged(fewer).coverage <= judged(frames).coverage <= 1
    assert judged(frames).coverage >= np.mean(seen)


@pytest.mark.parametrize("gap", [20, 40, 60])
def test_a_gap_costs_its_share_of_the_coverage_and_is_told(gap: int):
    result = judged(sweep()[:20] + sweep()[20 + gap :])
    # what the frames beside the gap show still counts
    assert gap - 8 <= (1 - result.coverage) * N <= gap
    (told,) = [reason for reason in result.reasons if "not seen" in reason]
    start, end = (float(word) for word in told.replace("s =", "").split()[3::2])
    assert S[20] <= start < S[26]
    assert S[14 + gap] < end <= S[20 + gap]


def test_a_sweep_backwards_covers_what_a_sweep_forwards_covers():
    frames = [replace(f, s=1 - f.s) for f in sweep()]
    assert judged(frames).coverage == 1


def backwards(frames: list[ScoredFrame]) -> list[ScoredFrame]:
    """The same scores in the same places, from the end to the beginning."""
    return [replace(f, index=i) for i, f in enumerate(reversed(frames))]


@pytest.mark.parametrize(
    ("frames", "verdict"),
    [
        (backwards(sweep()), Judgement.REVIEW),
        (backwards([scored(i, timing=1.2) for i in range(N)]), Judgement.REVIEW),
        (backwards(sweep(f20=0.95)), Judgement.REVIEW),
        (backwards(sweep(f20=3.0)), Judgement.NG),
        (backwards(sweep()[:66]), Judgement.INCOMPLETE),
    ],
    ids=["good", "at a wrong pace", "near the limit", "with a defect", "not all of it"],
)
def test_a_sweep_backwards_is_for_review_where_nothing_weighs_more(frames: list[ScoredFrame], verdict: Judgement):
    result = judged(frames)
    assert result.verdict is verdict
    assert any("ran backwards" in reason for reason in result.reasons) is (verdict is Judgement.REVIEW)


@given(scores=st.lists(st.floats(0, 3), min_size=N, max_size=N), by=st.floats(0.2, 5))
@MANY
def test_stored_scores_are_judged_again_for_other_limits(scores: list[float], by: float):
    stored = [scored(i, score) for i, score in enumerate(scores)]
    again = rescaled(stored, by)
    assert [f.score for f in again] == pytest.approx([by * score for score in scores])
    assert [(f.index, f.s, f.raw_score) for f in again] == [(f.index, f.s, f.raw_score) for f in stored]
    assert all(region.score >= 1 for f in again for region in f.regions)
    highest = max(f.score for f in again)
    assert (judged(again).verdict is Judgement.NG) is (highest >= 1)


@given(turns=st.tuples(st.integers(20, N - 2), st.integers(1, 18)))
@MANY
def test_a_sweep_that_went_back_for_a_while_is_none_backwards(turns: tuple[int, int]):
    turn, back = turns
    way = [*range(turn), *range(turn, turn - back, -1), *range(turn - back, N)]
    result = judged([replace(scored(at, 0.1), index=i) for i, at in enumerate(way)])
    assert result.verdict is Judgement.OK


@pytest.mark.parametrize(
    ("frames", "policy", "verdict"),
    [
        (sweep(f40=0.85), {"review_margin": 0.2}, Judgement.REVIEW),
        (sweep(f40=0.95), {"review_margin": 0.01}, Judgement.OK),
        (sweep()[:66], {"coverage": 0.5}, Judgement.OK),
        (sweep(f20=3.0)[:66], {"coverage": 0.5}, Judgement.NG),
        (but(lambda i: i % 5 > 1, FrameState.LOST), {"invalid_share": 0.7, "coverage": 0.9}, Judgement.OK),
    ],
)
def test_the_policy_decides_on_the_same_scores(frames: list[ScoredFrame], policy: dict[str, float], verdict: Judgement):
    assert judged(frames).verdict is not verdict
    assert judged(frames, Policy(**LIMIT | policy)).verdict is verdict


def not_seen(frames: Sequence[ScoredFrame]) -> list[str]:
    return [reason for reason in judged(frames).reasons if "not seen" in reason]


WHYS = {
    FrameState.AMBIGUOUS: "20 frames looked like more than one place, or like none for certain",
    FrameState.LOST: "20 frames agreed with no place",
    FrameState.WAITING: "20 frames agreed with no place",
    FrameState.STRANGE: "20 frames did not look as the part does there",
    FrameState.BLIND: "20 frames showed nothing",
}


@pytest.mark.parametrize("state", WHYS)
@pytest.mark.parametrize("start", [0, 40, N - 20])
@pytest.mark.parametrize("turned", [False, True], ids=["forwards", "backwards"])
def test_a_stretch_that_was_not_seen_is_told_with_what_became_of_its_frames(
    state: FrameState, start: int, turned: bool
):
    frames = but(lambda i: start <= i < start + 20, state)
    (told,) = not_seen(backwards(frames) if turned else frames)
    assert told.endswith(f": {WHYS[state]}")


def test_each_stretch_has_its_own_reason_and_one_without_frames_has_none():
    frames = but(lambda i: 10 <= i < 30 or 50 <= i < 70, FrameState.BLIND)
    frames[62] = unscored(62, FrameState.AMBIGUOUS)
    first, second, third = not_seen(frames[:85])
    assert first.endswith(": 20 frames showed nothing")
    assert ": 19 frames showed nothing, 1 frame looked like more than one place" in second
    assert third.endswith("and 1.000")


def test_frames_that_led_to_a_loss_were_lost_too():
    frames = but(lambda i: 40 <= i < 59, FrameState.AMBIGUOUS)
    frames[59] = unscored(59, FrameState.LOST)
    (told,) = not_seen(frames)
    assert told.endswith(": 20 frames agreed with no place")


@pytest.mark.parametrize("state", WHYS)
def test_frames_that_cost_no_coverage_are_not_told(state: FrameState):
    result = judged(but(lambda i: i == 40, state))
    assert (result.verdict, len(result.reasons)) == (Judgement.OK, 1)
