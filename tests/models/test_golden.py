"""Golden sweep: s is the share of the way where the way can be told, and of the frames where it cannot."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.golden import GoldenSweep, collect, coordinates
from tests.models.parts import FRAMES, MANY, View, frame, places, shot, surface, swept

SURE, BLURRED, UNKNOWN = 1e-6, 0.08, np.inf
"""How well a motion of four pixels is known: exactly, to a fiftieth, not at all."""


def travelled(
    ways: np.ndarray, unsure: float | np.ndarray = SURE, frames: list[int] | None = None, pause: int = 0
) -> GoldenSweep:
    """A sweep that went so many pixels from place to place, along a slight curve; a pause before the sixth."""
    turns = 0.1 * np.arange(len(ways))
    motion = np.stack([ways * np.cos(turns), ways * np.sin(turns)], axis=1)
    unsure = np.broadcast_to(unsure, ways.shape)
    stood = [pause * (i == 5) for i in range(len(ways))]
    frames = frames or list(range(len(ways) + 1))
    return GoldenSweep(frames=frames, motion=list(motion), stood=stood, unsure=unsure.tolist())


def shares(steps: np.ndarray) -> np.ndarray:
    """From 0 to 1 in steps of these lengths."""
    return np.concatenate([[0.0], np.cumsum(steps)]) / np.sum(steps)


@given(ways=st.lists(st.floats(3.2, 4.8), min_size=1, max_size=40).map(np.array))
@MANY
def test_s_is_the_share_of_the_way_where_every_motion_is_known(ways: np.ndarray):
    np.testing.assert_allclose(coordinates(travelled(ways)), shares(ways), atol=1e-6)


@pytest.mark.parametrize("corner", [3, 7])
def test_where_the_way_turns_the_picture_cuts_the_corner_and_the_usual_pace_knows_better(corner: int):
    ways = np.array([4.0, 4.2, 3.8, 4.0, 4.0, 4.1, 4.0, 3.9, 4.0, 4.0, 4.0, 4.0])
    golden = travelled(np.where(np.arange(12) == corner, 2.9, ways))
    along = [np.array([way, 0.0]) for way in ways[:corner]]
    golden.motion = [*along, np.array([2.0, 2.1]), *(np.array([0.0, way]) for way in ways[corner + 1 :])]
    # the places beside the corner lie between motions that point elsewhere, too
    ways[corner - 1 : corner + 2] = 4.0
    np.testing.assert_allclose(coordinates(golden), shares(ways), atol=1e-6)


@given(ways=st.lists(st.floats(3.2, 4.8), min_size=1, max_size=40).map(np.array))
@MANY
def test_motions_that_nothing_is_known_of_are_as_long_as_usual(ways: np.ndarray):
    np.testing.assert_allclose(coordinates(travelled(ways, UNKNOWN)), np.linspace(0, 1, len(ways) + 1), atol=1e-9)


def test_one_motion_that_could_not_be_measured_is_taken_as_usual_and_the_others_as_they_were():
    ways = np.array([4.0, 4.2, 3.8, 0.0, 4.0, 4.0, 5.0, 4.0])
    unsure = np.where(ways == 0, UNKNOWN, SURE)
    np.testing.assert_allclose(coordinates(travelled(ways, unsure)), shares(np.where(ways == 0, 4.0, ways)), atol=1e-6)


def test_a_motion_known_to_a_fiftieth_of_the_pace_counts_half():
    ways = np.array([4.0, 4.0, 4.0, 5.0, 4.0])
    unsure = np.array([SURE, SURE, SURE, BLURRED, SURE])
    expected = shares(np.array([4.0, 4.0, 4.0, 4.5, 4.0]))
    np.testing.assert_allclose(coordinates(travelled(ways, unsure)), expected, atol=1e-6)


@pytest.mark.parametrize("ways", [np.zeros(12), np.array([1.0, 9.0] * 6), np.array([4.0] + [0.0] * 11)])
def test_where_the_way_cannot_be_told_s_is_the_share_of_frames(ways: np.ndarray):
    frames = [2, 3, 4, 5, 8, 9, 10, 11, 12, 13, 14, 15, 17]
    expected = (np.array(frames) - 2) / 15
    np.testing.assert_allclose(coordinates(travelled(ways, SURE, frames)), expected, atol=1e-12)


@given(
    legs=st.lists(
        st.tuples(st.floats(0.1, 50), st.integers(1, 5), st.sampled_from((0.0, SURE, 0.01, BLURRED, 1.0, UNKNOWN))),
        min_size=1,
        max_size=40,
    )
)
@MANY
def test_s_grows_from_0_to_1_whatever_was_measured(legs: list[tuple[float, int, float]]):
    ways, steps, unsure = (np.array(each) for each in zip(*legs, strict=True))
    s = coordinates(travelled(ways, unsure, [0, *np.cumsum(steps).tolist()]))
    assert (s[0], s[-1]) == (0.0, pytest.approx(1.0, abs=1e-12))
    assert np.all(np.diff(s) > 0)


def off(ats: np.ndarray, view: View = View()) -> float:  # noqa: B008 (a frozen value)
    """How far s of a golden sweep is from the truth at the worst, in places of the even sweep."""
    _, golden = collect(swept(surface(), ats, view), None)
    true = ats[golden.frames]
    true = (true - true[0]) / (true[-1] - true[0])
    return float(np.abs(coordinates(golden) - true).max()) * (ats[-1] - ats[0])


def paused(frames: int) -> np.ndarray:
    return np.concatenate([places(last=20), np.full(frames, 20.0), places(first=21)])


def swinging(by: float) -> np.ndarray:
    """Places at a pace that goes up and down by a share of itself, three times in a sweep."""
    ats = np.cumsum(1 + by * np.sin(6 * np.pi * np.arange(FRAMES) / FRAMES))
    return ats - ats[0]


@pytest.mark.parametrize(
    "ats",
    [places(), paused(10), swinging(0.1), swinging(0.3), np.delete(places(), [20, 21, 22])],
    ids=["even", "a pause", "a tenth up and down", "a third up and down", "frames lost"],
)
def test_an_uneven_pace_moves_s_by_less_than_half_a_place(ats: np.ndarray):
    assert off(ats) < 0.5


def test_a_jitter_of_a_tenth_moves_s_by_less_than_half_a_place():
    rng = np.random.default_rng(1)
    ats = np.concatenate([[0.0], np.cumsum(1 + 0.1 * rng.uniform(-1, 1, FRAMES - 1))])
    assert off(ats) < 0.5


@pytest.mark.parametrize(("pause", "unsure"), [(9, BLURRED), (300, 0.0125)], ids=["poor texture", "a long pause"])
def test_a_pause_is_no_way_however_long_and_wherever(pause: int, unsure: float):
    frames = [*range(6), *range(6 + pause, 11 + pause)]
    s = coordinates(travelled(np.full(10, 4.0), unsure, frames, pause))
    np.testing.assert_allclose(s, np.linspace(0, 1, 11), atol=0.01)


def test_a_pause_in_colour_moves_s_by_less_than_half_a_place():
    assert off(paused(30), View(colour=True, deep=True)) < 0.5


def test_pictures_that_have_nothing_to_do_with_each_other_are_places_by_their_number():
    pictures = [shot(surface(10 + i), 200.0) for i in range(12)]
    _, golden = collect([frame(picture, i) for i, picture in enumerate(pictures)], None)
    np.testing.assert_allclose(coordinates(golden), np.linspace(0, 1, 12), atol=1e-9)
