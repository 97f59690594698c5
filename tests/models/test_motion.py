"""A moving thing whose place is measured: closed forms of straight, curved and unseen motion."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from models.motion import Agility, Motion

FRAME = 33_333_333
SURE = np.array([1e-4])


def followed(places: np.ndarray, times: list[int], error: np.ndarray = SURE) -> Motion:
    motion = Motion.seen(times[0], places[:1], error, Agility())
    for t, place in zip(times[1:], places[1:], strict=True):
        motion = motion.at(t).corrected(np.array([place]), error)
    return motion


def test_what_moves_straight_has_its_velocity_and_is_expected_on_its_line() -> None:
    times = [n * FRAME for n in range(30)]
    motion = followed(np.array([3 * t / 1e9 for t in times]), times)
    assert motion.velocity == pytest.approx([3.0], abs=0.01)
    assert motion.at(times[-1] + 2 * FRAME).place == pytest.approx([3 * (times[-1] + 2 * FRAME) / 1e9], abs=0.001)


def test_two_measurements_give_a_velocity() -> None:
    motion = followed(np.array([0.0, 0.1]), [0, FRAME])
    assert motion.velocity == pytest.approx([3.0], rel=0.05)


def test_uneven_frames_and_gaps_do_not_change_what_is_believed() -> None:
    times = np.cumsum([0, 1, 1, 3, 1, 2, 1, 1, 5, 1, 1, 1]).tolist()
    times = [n * FRAME for n in times]
    motion = followed(np.array([3 * t / 1e9 for t in times]), times)
    assert motion.velocity == pytest.approx([3.0], abs=0.02)


def test_a_constant_acceleration_is_followed_without_a_lag() -> None:
    times = [n * FRAME for n in range(30)]
    motion = followed(np.array([4 * (t / 1e9) ** 2 for t in times]), times)
    then = (times[-1] + 2 * FRAME) / 1e9
    assert motion.at(times[-1] + 2 * FRAME).place == pytest.approx([4 * then**2], abs=0.002)


def test_in_one_step_or_in_many_time_passes_alike() -> None:
    motion = followed(np.array([0.0, 0.1, 0.25, 0.3]), [0, FRAME, 2 * FRAME, 3 * FRAME])
    end = 3 * FRAME + 400_000_000
    once, often = motion.at(end), motion
    for t in range(3 * FRAME, end, 10_000_000):
        often = often.at(t)
    often = often.at(end)
    np.testing.assert_allclose(often.state, once.state, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(often.spread, once.spread, rtol=1e-2, atol=1e-6)


def test_the_unseen_becomes_less_sure_and_a_measurement_surer() -> None:
    motion = followed(np.array([0.0, 0.1, 0.2]), [0, FRAME, 2 * FRAME])
    waiting = [motion.at((2 + n) * FRAME) for n in range(10)]
    assert all(before.error < after.error for before, after in pairwise(waiting))
    assert waiting[-1].corrected(np.array([1.1]), SURE).error < waiting[-1].error


def test_between_a_forecast_and_a_measurement_the_surer_counts_more() -> None:
    motion = followed(np.array([0.0, 0.1, 0.2]), [0, FRAME, 2 * FRAME]).at(3 * FRAME)
    trusted = motion.corrected(np.array([0.5]), np.array([1e-6]))
    doubted = motion.corrected(np.array([0.5]), np.array([10.0]))
    assert trusted.place == pytest.approx([0.5], abs=1e-4)
    assert doubted.place == pytest.approx(motion.place, abs=1e-3)


def test_spreads_stay_symmetric_and_positive_over_a_long_time() -> None:
    rng = np.random.default_rng(1)
    motion = Motion.seen(0, np.zeros(2), np.full(2, 0.01), Agility())
    for n in range(1, 3000):
        motion = motion.at(n * FRAME).corrected(rng.standard_normal(2) * 0.01, np.full(2, 1e-6))
    np.testing.assert_allclose(motion.spread, motion.spread.transpose(0, 2, 1), rtol=1e-9)
    assert (np.linalg.eigvalsh(motion.spread) > -1e-12).all()


def test_an_earlier_time_changes_nothing() -> None:
    motion = followed(np.array([0.0, 0.1]), [0, FRAME])
    assert motion.at(0) is motion
