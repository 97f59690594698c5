"""Deviations as they open and close, frame by frame, are those that are told in the end."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from models.deviations import DIP, Deviations, deviations
from models.verdict import Deviation, FrameState, Policy, Residuals, ScoredFrame

PLACE = 0.01
HEIGHTS = st.lists(
    st.one_of(st.none(), st.tuples(*(st.sampled_from([0.0, 0.5, 0.7, 0.9, 1.0, 1.5, 3.0]) for _ in range(3)))),
    max_size=60,
)


def scored(index: int, heights: tuple[float, float, float] | None) -> ScoredFrame:
    if heights is None:
        return ScoredFrame(index, index, FrameState.LOST, None, 0.0, 0.0, Residuals(0.0, 0.0, 0.0))
    return ScoredFrame(index, index, FrameState.SCORED, index * PLACE, heights[0], 0.0, Residuals(*heights))


def appearance(*heights: float | None) -> list[ScoredFrame]:
    return [scored(i, None if h is None else (h, 0.0, 0.0)) for i, h in enumerate(heights)]


@given(HEIGHTS)
def test_each_opens_once_closes_once_and_only_the_last_may_stay_open(heights: list[tuple[float, ...] | None]):
    state, opened, closed = Deviations(Policy(), PLACE), list[Deviation](), list[Deviation]()
    frames = [scored(i, h) for i, h in enumerate(heights)]
    for frame in frames:
        state, new, ended = state.step(frame)
        opened += new
        closed += ended
    told = deviations(frames, Policy(), PLACE)
    assert state.all == told
    assert [(d.kind, d.index_start) for d in sorted(opened, key=lambda d: (d.index_start, d.kind))] == [
        (d.kind, d.index_start) for d in told
    ]
    assert set(closed) <= set(told)
    still = [d for d in told if d not in closed]
    assert len(still) == len({d.kind for d in still})
    assert all(len(frames) - d.index_end <= DIP for d in still)


def test_it_opens_with_the_frame_that_reaches_the_threshold_and_closes_after_the_dip():
    state, said = Deviations(Policy(), PLACE), list[tuple[int, str]]()
    for frame in appearance(0.2, 0.8, 1.2, 0.9, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1):
        state, opened, closed = state.step(frame)
        said += [(frame.index, "opened")] * len(opened) + [(frame.index, "closed")] * len(closed)
    assert said == [(2, "opened"), (8, "closed")]
    (only,) = state.all
    assert (only.index_start, only.index_end, only.peak_index, only.peak_score) == (1, 4, 2, 1.2)


def test_frames_without_a_place_end_one_too():
    state = Deviations(Policy(), PLACE)
    ended = 0
    for frame in appearance(1.2, *[None] * (DIP + 1)):
        state, _, closed = state.step(frame)
        ended += len(closed)
    assert ended == 1


def test_a_position_off_for_a_moment_is_none():
    frames = [scored(i, (0.0, 2.0 if 3 <= i < 7 else 0.0, 0.0)) for i in range(20)]
    assert deviations(frames, Policy(), PLACE) == ()
    frames = [scored(i, (0.0, 2.0 if 3 <= i < 8 else 0.0, 0.0)) for i in range(20)]
    assert [d.kind for d in deviations(frames, Policy(), PLACE)] == ["position"]
