"""Fixture: the Kalman filter against its closed forms, and what it learns from exact measurements."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.fixture import Fixture, Path
from tests.models.parts import MANY

N = 60
STRAIGHT = Path(np.tile([-4.0, 0.0], (N, 1)))
SLANTED = Path(np.tile([-3.0, 2.0], (N, 1)))
PRECISE = np.diag(np.square([0.05, 0.05, 0.0002]))
SEEDS = st.integers(0, 2**31)


def gaussian(seed: int, at: float = 20.0) -> Fixture:
    """Any covariance, and a mean well inside the sweep."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((5, 5)) * np.array([0.5, 0.1, 1, 1, 0.01])[:, None]
    mean = np.array([at, 1.0, *rng.standard_normal(2), 0.003 * rng.standard_normal()])
    return Fixture(mean, root @ root.T + np.diag([1e-3, 1e-3, 1e-3, 1e-3, 1e-6]))


def test_the_path_is_the_sum_of_its_motion_and_is_held_at_its_ends():
    path = Path(np.array([[1.0, 0.0], [2.0, 1.0], [4.0, 0.0], [4.0, 0.0]]))
    np.testing.assert_allclose(path.at(1.5), [2.0, 0.5])
    np.testing.assert_allclose(path.at(-3), [0, 0])
    np.testing.assert_allclose(path.at(9), [7, 1])
    np.testing.assert_allclose(path.between(2, 0.5), [-2.5, -1.0])
    np.testing.assert_allclose(path.speed(1.2), [2, 1])


@given(seed=SEEDS, places=st.lists(st.floats(-5, 20), min_size=1, max_size=9))
@MANY
def test_many_places_are_where_each_of_them_is(seed: int, places: list[float]):
    path = Path(np.random.default_rng(seed).standard_normal((12, 2)))
    np.testing.assert_allclose(path.along(np.array(places)), [path.at(place) for place in places], atol=1e-12)


@given(seed=SEEDS, at=st.floats(-2, 14), apart=st.lists(st.integers(1, 4), min_size=1, max_size=4))
@MANY
def test_the_key_of_a_place_is_the_nearest_by_travel_of_those_about_it(seed: int, at: float, apart: list[int]):
    motion = np.random.default_rng(seed).uniform(0.5, 3, (1 + sum(apart), 1)) * (0.8, -0.6)
    path = Path(motion, np.cumsum([0, *apart]))
    off = [float(np.hypot(*path.between(key, at))) for key in path.keys]
    assert off[path.keys.tolist().index(path.key(at))] == pytest.approx(min(off), abs=1e-9)


def test_where_nothing_moves_the_key_is_the_nearest_by_number():
    still = Path(np.zeros((9, 2)), np.array([0, 2, 8]))
    assert [still.key(at) for at in (0, 0.9, 1.1, 4.9, 5.1, 8)] == [0, 0, 2, 2, 8, 8]
    assert [Path(np.zeros((9, 2))).key(at) for at in (-1, 0.4, 0.6, 7.6, 9)] == [0, 0, 1, 8, 8]


@given(turn=st.floats(-0.02, 0.02), reference=st.integers(0, N - 1))
@MANY
def test_a_turned_part_lies_on_any_reference_as_rotation_says(turn: float, reference: int):
    fixture = Fixture(np.array([20.0, 1.0, 0.4, -0.3, turn]), np.eye(5))
    c, s = np.cos(turn), np.sin(turn)
    pose = np.array([[c, -s], [s, c]]) @ SLANTED.between(reference, 20.0) + (0.4, -0.3)
    np.testing.assert_allclose(fixture.pose(reference, SLANTED)[0], [*pose, turn], atol=0.03)


@given(seed=SEEDS, elapsed=st.floats(0.5, 5))
@MANY
def test_prediction_moves_on_by_the_pace_and_spreads_as_the_closed_form_says(seed: int, elapsed: float):
    old = gaussian(seed)
    wander = Fixture(old.mean, np.zeros((5, 5))).predict(1.0, STRAIGHT).covariance
    new = old.predict(elapsed, STRAIGHT)
    f = np.eye(5)
    f[0, 1] = elapsed
    assert new.at == pytest.approx(old.at + elapsed * old.mean[1])
    assert new.mean[1] == old.mean[1]
    np.testing.assert_allclose(new.covariance, f @ old.covariance @ f.T + elapsed * wander, atol=1e-9)
    assert np.all(np.diag(wander) > 0)


@given(turn=st.floats(-0.02, 0.02), elapsed=st.floats(0.1, 9))
@MANY
def test_a_rotation_turns_travel_into_offset(turn: float, elapsed: float):
    # a part turned about the world's origin lies (R - 1) c off where the camera is at c, and pictures move by -c
    old = Fixture(np.array([20.0, 1.0, 0.4, -0.3, turn]), np.eye(5))
    new = old.predict(elapsed, SLANTED)
    c, s = np.cos(turn), np.sin(turn)
    moved = (np.array([[c, -s], [s, c]]) - np.eye(2)) @ -SLANTED.between(old.at, new.at)
    np.testing.assert_allclose(new.offset[:2] - old.offset[:2], moved, atol=0.01)


def test_prediction_does_not_leave_the_sweep():
    far = Fixture(np.array([N - 1.0, 3.0, 0, 0, 0]), np.eye(5)).predict(50, STRAIGHT)
    assert far.at <= N


@given(seed=SEEDS, reference=st.integers(18, 22))
@MANY
def test_measurement_is_the_product_of_two_gaussians(seed: int, reference: int):
    old, noise = gaussian(seed), np.diag([0.04, 0.09, 1e-5])
    pose = np.array([0.5, -0.2, 0.002]) + np.append(SLANTED.between(reference, old.at), 0)
    new = old.measure(reference, pose, noise, SLANTED)
    # in information form: precisions add up, and so do precision times what is told
    h = np.zeros((3, 5))
    h[:2, 0], h[:, 2:] = SLANTED.speed(old.at), np.eye(3)
    # a turn about the picture's centre moves what lies beside it
    h[:2, 4] = SLANTED.between(reference, old.at)[::-1] * (-1, 1)
    told = pose - old.pose(reference, SLANTED)[0] + h @ old.mean
    weight = np.linalg.inv(noise)
    precision = np.linalg.inv(old.covariance) + h.T @ weight @ h
    mean = np.linalg.solve(precision, np.linalg.solve(old.covariance, old.mean) + h.T @ weight @ told)
    np.testing.assert_allclose(new.covariance, np.linalg.inv(precision), rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(np.delete(new.mean, 1), np.delete(mean, 1), rtol=1e-5, atol=1e-5)
    assert new.mean[1] == pytest.approx(np.clip(mean[1], 0, 4), abs=1e-5)


@given(seed=SEEDS, reference=st.integers(0, N - 1))
@MANY
def test_a_measurement_as_expected_moves_nothing(seed: int, reference: int):
    old = gaussian(seed)
    pose, _ = old.pose(reference, SLANTED)
    np.testing.assert_allclose(old.measure(reference, pose, PRECISE, SLANTED).mean, old.mean, atol=1e-9)


def follow(path: Path, start: float, pace: float, offset: np.ndarray, frames: int) -> tuple[Fixture, float]:
    """The filter after exact measurements of a part that lies off, and the true place."""
    filtered, at = Fixture.unknown(start + 0.7), start
    for _ in range(frames):
        at += pace
        filtered = filtered.predict(1.0, path)
        reference = round(filtered.at)
        pose = offset + np.append(path.between(reference, at), 0)
        filtered = filtered.measure(reference, pose, PRECISE, path).settled(path)
    return filtered, at


@pytest.mark.parametrize("path", [STRAIGHT, SLANTED])
@given(pace=st.floats(0.5, 1.6), start=st.floats(2, 8))
@MANY
def test_the_place_follows_a_constant_pace(path: Path, pace: float, start: float):
    filtered, at = follow(path, start, pace, np.zeros(3), 25)
    assert abs(filtered.seen(path) - at) < 0.05
    assert filtered.mean[1] == pytest.approx(pace, abs=0.05)
    assert filtered.uncertainty < Fixture.unknown(start).uncertainty


@given(off=st.floats(-4, 4), turn=st.floats(-0.01, 0.01))
@MANY
def test_an_offset_across_the_path_is_learnt(off: float, turn: float):
    filtered, _ = follow(STRAIGHT, 5.0, 1.0, np.array([0.0, off, turn]), 25)
    assert filtered.offset[1] == pytest.approx(off, abs=0.25)
    assert filtered.offset[2] == pytest.approx(turn, abs=0.001)


@given(off=st.floats(-4, 4))
@MANY
def test_an_offset_along_the_path_is_told_as_the_place_that_the_picture_shows(off: float):
    filtered, at = follow(STRAIGHT, 5.0, 1.0, np.array([off, 0.0, 0.0]), 25)
    assert filtered.seen(STRAIGHT) == pytest.approx(at - off / 4, abs=0.05)


def test_settling_takes_from_the_offset_along_the_path_only():
    old = Fixture(np.array([20.0, 1.0, 2.0, 3.0, 0.01]), np.eye(5))
    new = old.settled(STRAIGHT)
    assert 0 < new.offset[0] < old.offset[0]
    np.testing.assert_allclose(new.offset[1:], old.offset[1:])
    still = Path(np.zeros((N, 2)))
    assert old.settled(still) is old


def test_a_robot_that_halts_is_where_it_was_and_less_sure_of_it():
    old = gaussian(3)
    halted = old.halted()
    np.testing.assert_array_equal(halted.mean, old.mean)
    assert halted.uncertainty > old.uncertainty


def test_the_covariance_stays_a_covariance_over_a_long_sweep():
    path = Path(np.tile([-3.0, 2.0], (500, 1)))
    filtered, _ = follow(path, 5.0, 1.0, np.array([2.0, -1.0, 0.005]), 400)
    np.testing.assert_allclose(filtered.covariance, filtered.covariance.T, atol=1e-9)
    assert np.linalg.eigvalsh(filtered.covariance).min() > 0
