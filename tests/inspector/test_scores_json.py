"""Stored scores come back to the last bit, and judge as they did; what cannot be read says so."""

from __future__ import annotations

import zlib

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from inspector.errors import WorldError
from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.scores_json import ScoresUnreadable, scores_from_bytes, scores_to_bytes
from models.judging import judge
from models.verdict import FrameState, Policy, Region, Residuals, ScoredFrame
from tests.inspector.conftest import Line

NUMBER = st.floats(allow_nan=False)
WHOLE = st.integers(-(2**63), 2**63 - 1)
REGION = st.builds(Region, WHOLE, WHOLE, WHOLE, WHOLE, NUMBER, st.sampled_from(["bright", "dark"]))
FRAME = st.builds(
    ScoredFrame,
    index=WHOLE,
    t_ns=WHOLE,
    state=st.sampled_from(FrameState),
    s=st.none() | NUMBER,
    score=NUMBER,
    raw_score=NUMBER,
    residuals=st.builds(Residuals, NUMBER, NUMBER, NUMBER),
    regions=st.lists(REGION, max_size=3).map(tuple),
    reference=WHOLE,
    placement=st.lists(NUMBER, max_size=6).map(tuple),
    light=st.lists(NUMBER, max_size=4).map(tuple),
)


@given(st.lists(FRAME, max_size=4))
def test_every_field_comes_back_to_the_last_bit(frames: list[ScoredFrame]) -> None:
    again = scores_from_bytes(scores_to_bytes(frames))
    assert again == tuple(frames)
    assert repr(again) == repr(tuple(frames))


def test_real_scores_come_back_and_give_the_same_result(line: Line) -> None:
    learnt = line.appearance
    result = replay(SweepReader(line.spot), learnt).result
    data = scores_to_bytes(result.frames)
    assert scores_from_bytes(data) == result.frames
    assert len(data) < 400 * len(result.frames)
    again = judge(
        scores_from_bytes(data), Policy(), learnt.s, learnt.path,
        appearance_id=learnt.id, dropped=result.frames_dropped, digest=result.digest,
    )  # fmt: skip
    assert again == result


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "stored scores cannot be read"),
        (zlib.compress(b"{}"), "allowed is version 1"),
        (zstandard.compress(b"[]"), "stored scores cannot be read"),
        (zstandard.compress(b'{"version": 2, "frames": []}'), "they are of version 2"),
        (zstandard.compress(b'{"version": 1, "frames": [[1]]}'), "not enough values"),
        (scores_to_bytes([])[:-1], "stored scores cannot be read"),
    ],
)
def test_what_cannot_be_read_is_told(data: bytes, said: str) -> None:
    with pytest.raises(ScoresUnreadable, match=said) as caught:
        scores_from_bytes(data)
    assert isinstance(caught.value, WorldError)
