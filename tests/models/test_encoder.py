"""Encoder: a help where the picture leaves it open, and no harm where it lies."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.appearance import Appearance
from models.encoder import Encoder, Reading, positions
from models.errors import AppearanceError
from models.frame import Frame
from models.learning import learn
from models.verdict import FrameState, Judgement
from tests.models.parts import FRAMES, MANY, View, golden, inspected, places, surface, swept, with_spot

SEEN = View(seed=31)
PERIOD = 56
"""Pixels: fourteen places."""


def with_encoder(frames: Sequence[Frame], values: Sequence[float]) -> list[Frame]:
    return [replace(frame, encoder=float(value)) for frame, value in zip(frames, values, strict=True)]


@lru_cache
def knowing() -> Appearance:
    """Like `golden()`, of a sweep whose encoder counts half millimetres from 7 on."""
    again = View(dx=0.7, dy=-1.2, gain=1.04, seed=2)
    return learn([with_encoder(swept(surface()), 7 + 0.5 * places()), swept(surface(), view=again)])


@lru_cache
def repeating(marks: float, begins: bool = False) -> np.ndarray:
    """A part that repeats itself but for faint marks, and, if wanted, for how it begins."""
    one = cv2.GaussianBlur(surface(5)[:, :PERIOD], (0, 0), 1)
    drawn = np.tile(one, (1, 8))[:, :440] + marks * (surface(6) - 110)
    if begins:
        drawn[:, :150] = surface(6)[:, :150]
    return np.clip(drawn, 20, 235).astype(np.float32)


STEPS = st.lists(st.floats(0.01, 5), min_size=2, max_size=30)


@given(steps=STEPS, share=st.floats(0, 1), way=st.sampled_from((1, -1)), zero=st.floats(-1e3, 1e3))
@MANY
def test_the_place_by_the_encoder_is_between_its_neighbours_whatever_its_way_and_zero(
    steps: list[float], share: float, way: int, zero: float
):
    encoder = Encoder(way * np.cumsum(steps))
    at = share * (len(steps) - 1)
    position = float(np.interp(at, np.arange(len(steps)), encoder.positions))
    assert encoder.place(position) == pytest.approx(at, abs=1e-6)
    begun = Reading(float(encoder.positions[0]) + zero, 0.0)
    assert encoder.place(position + zero, begun) == pytest.approx(at, abs=1e-6)


@pytest.mark.parametrize("pace", [0.0, 0.8, 1.0, 2.0])
def test_an_encoder_that_moves_as_the_pictures_do_is_honest_and_another_one_is_not(pace: float):
    encoder = Encoder(np.arange(50.0))
    true = still = double = back = None
    for i in range(12):
        at = 10 + pace * i
        true, still = encoder.read(at + 500, at, true), encoder.read(3.0, at, still)
        double, back = encoder.read(3 * at, at, double), encoder.read(-at, at, back)
    readings = [true, still, double, back]
    assert all(reading is not None for reading in readings)
    # from a standstill nothing can be told
    assert [reading.honest for reading in readings if reading] == [True, pace == 0, pace == 0, pace == 0]


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ([3.0, 2.0, 2.0, -1.0], True),
        ([0.0, 1.0, 0.5, 2.0], False),
        ([1.0, 1.0, 1.0], False),
        ([0.0, None, 2.0], False),
        ([0.0, float("nan"), 2.0], False),
        ([0.0, 1.0, float("inf")], False),
    ],
)
def test_positions_are_kept_where_all_places_have_one_and_none_turns_back(given: list[float | None], kept: bool):
    assert positions(given).tolist() == (given if kept else [])


def test_learning_keeps_one_position_a_place_and_the_file_too():
    again = Appearance.from_bytes(knowing().to_bytes())
    np.testing.assert_array_equal(again.encoder, 7 + 0.5 * places())
    assert again.to_bytes() == knowing().to_bytes()
    assert len(golden().encoder) == 0


@pytest.mark.parametrize(
    "spoilt", [np.arange(5.0), np.zeros(FRAMES), np.full(FRAMES, np.nan), np.abs(places() - 9), np.arange(FRAMES)]
)
def test_positions_of_no_use_are_refused_in_a_file(spoilt: np.ndarray):
    with pytest.raises(AppearanceError, match="encoder"):
        Appearance.from_bytes(replace(knowing(), encoder=spoilt).to_bytes())


LIES: dict[str, Callable[[int], np.ndarray]] = {
    "random": lambda n: np.random.default_rng(3).uniform(0, 40, n),
    "constant": lambda n: np.full(n, 20.0),
    "another scale": lambda n: 7 + 1.7 * np.arange(n),
    "reversed": lambda n: 7 + 0.5 * np.arange(n)[::-1],
    "far off": lambda n: 1e9 + 0.5 * np.arange(n),
    "no number": lambda n: np.full(n, np.nan),
    "infinite": lambda n: np.full(n, np.inf),
}
PARTS = {
    "good": (surface(), View(seed=31)),
    "shifted and turned": (surface(), View(dx=2, dy=-3, turn=0.01, seed=4)),
    "with a defect": (with_spot(surface(), 230, 110), View(seed=31)),
    "another one": (surface(2), View(seed=31)),
}


@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize("part", PARTS)
def test_a_lying_encoder_moves_no_frame_and_changes_no_verdict(lie: str, part: str):
    frames = swept(PARTS[part][0], view=PARTS[part][1])
    true, said = inspected(golden(), frames)[0], inspected(knowing(), with_encoder(frames, LIES[lie](FRAMES)))[0]
    assert said.verdict is true.verdict
    for one, other in zip(true.frames, said.frames, strict=True):
        assert one.state is other.state
        assert one.s is None or abs(one.s - other.s) * (FRAMES - 1) < 0.2


@pytest.mark.parametrize("told", [True, False], ids=["learnt with one", "inspected with one"])
def test_an_encoder_on_one_side_alone_changes_nothing(told: bool):
    frames = swept(surface(), view=SEEN)
    plain = inspected(golden(), frames)[0]
    other = inspected(knowing(), frames)[0] if told else inspected(golden(), with_encoder(frames, places()))[0]
    assert plain.verdict is other.verdict is Judgement.OK
    assert [frame.s for frame in plain.frames] == [frame.s for frame in other.frames]


def wrong(part: np.ndarray, ats: np.ndarray, values: np.ndarray | None) -> int:
    """How many frames are not scored, or at a wrong place, where the encoder of the reference sweep told the truth."""
    appearance = learn([with_encoder(swept(part), 7 + 0.5 * places())])
    frames = swept(part, ats, SEEN)
    _, said = inspected(appearance, frames if values is None else with_encoder(frames, values))
    return sum(
        each.state is not FrameState.SCORED or abs(each.s * (FRAMES - 1) - at) > 0.5
        for each, at in zip(said, ats, strict=True)
    )


JUMP = np.concatenate([places(last=15), places(first=36)])


@pytest.mark.parametrize("zero", [7.0, 300.0], ids=["as learnt", "another zero"])
def test_after_a_jump_on_a_part_that_repeats_the_encoder_knows_at_once(zero: float):
    part = repeating(0, begins=True)
    assert wrong(part, JUMP, None) > 10
    assert wrong(part, JUMP, zero + 0.5 * JUMP) == 0


def test_where_a_sweep_begins_late_on_a_part_that_repeats_the_encoder_knows_at_once():
    part, ats = repeating(0.03), places(first=30)
    assert wrong(part, ats, None) > 10
    assert wrong(part, ats, 7 + 0.5 * ats) == 0
