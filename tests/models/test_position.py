"""Position: a smooth curve in many dimensions, walked at every pace; the filter says where."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from models.position import Places, Standing, Track, move, standing, start, vouch
from tests.models.parts import FEW

N, K = 200, 12
NOISE = 0.02
NOWHERE = np.zeros(3)


def track(seed: int = 1) -> Track:
    """A curve that bends over six places; pictures move by four pixels to the left from place to place."""
    rng = np.random.default_rng(seed)
    z = gaussian_filter1d(rng.standard_normal((N, K)), 6, axis=0, mode="nearest")
    z /= z.std()
    slope = 0.02 * rng.standard_normal((N, 5, K))
    motion = np.tile([-4.0, 0.0], (N, 1))
    slope[:, 0] = np.gradient(z, axis=0) / -4
    return Track(z, slope, motion, NOISE)


CURVE = track()


def seen(at: float, rng: np.random.Generator) -> np.ndarray:
    """z at a place between the samples."""
    i = min(int(at), N - 2)
    return CURVE.z[i] + (at - i) * (CURVE.z[i + 1] - CURVE.z[i]) + NOISE * rng.standard_normal(K)


def walk(ats: Iterable[float], elapsed: Iterable[float] | None = None, places: Places | None = None) -> list[Standing]:
    """What the filter answers after each frame."""
    rng, found = np.random.default_rng(5), list[Standing]()
    places = start(CURVE) if places is None else places
    ats = list(ats)
    for at, dt in zip(ats, np.ones(len(ats)) if elapsed is None else elapsed, strict=True):
        places = move(CURVE, places, seen(at, rng), dt, NOWHERE)
        found.append(standing(places))
    return found


def off(found: list[Standing], ats: Iterable[float]) -> np.ndarray:
    return np.abs([each.at for each in found] - np.array(list(ats)))


@pytest.mark.parametrize("pace", [0.5, 0.8, 1.0, 1.3, 2.0])
def test_a_constant_pace_is_followed_within_a_place(pace: float):
    ats = np.arange(0, N - 1, pace)
    found = walk(ats)
    assert off(found, ats).max() < 1
    assert found[-1].pace == pytest.approx(pace, abs=0.15)


def test_a_standstill_stays_where_it_is():
    ats = np.concatenate([np.arange(0, 60.0), np.full(80, 60.0), np.arange(60, 120.0)])
    assert off(walk(ats), ats).max() < 1


@pytest.mark.parametrize(("first", "frames"), [(5, 1), (15, 1), (40, 5), (60, 12), (100, 12)])
def test_a_late_start_is_found_in_a_few_frames(first: int, frames: int):
    ats = np.arange(first, N - 1.0)
    assert off(walk(ats), ats)[frames:].max() < 1


def test_lost_frames_are_time_that_went_on():
    gone = np.random.default_rng(3).random(N - 1) < 0.4
    gone[0] = False
    ats = np.flatnonzero(~gone).astype(float)
    found = walk(ats, np.diff(ats, prepend=-1))
    assert off(found, ats).max() < 1
    assert found[-1].pace == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize("jump", [-70, -25, 40, 80])
def test_after_a_jump_it_finds_itself_again(jump: int):
    ats = np.concatenate([np.arange(0, 100.0), np.arange(100 + jump, min(N - 1, 120 + jump), 1.0)])
    error = off(walk(ats), ats)
    assert error[:100].max() < 1
    assert error[112:].max() < 1


def test_after_looks_of_nothing_known_it_finds_itself_again():
    rng = np.random.default_rng(9)
    places = start(CURVE)
    for at in range(60):
        places = move(CURVE, places, seen(at, rng), 1.0, NOWHERE)
    for _ in range(10):
        places = move(CURVE, places, 5 * rng.standard_normal(K), 1.0, NOWHERE)
    ats = np.arange(70, 110.0)
    assert off(walk(ats, places=places), ats)[8:].max() < 1


def test_one_strange_look_moves_nobody():
    rng = np.random.default_rng(4)
    places = start(CURVE)
    for at in range(80):
        z = seen(at, rng) if at != 50 else seen(170, rng)
        places = move(CURVE, places, z, 1.0, NOWHERE)
        assert abs(standing(places).at - at) < 1.5


def test_the_sweep_is_expected_to_begin_in_its_first_tenth():
    cost = start(CURVE).cost
    assert np.all(cost[: N // 10] == 0)
    assert np.all(np.diff(cost) >= 0)
    assert cost[-1] > 0


@given(at=st.integers(30, 150), seed=st.integers(0, 99))
@FEW
def test_looking_about_the_best_place_only_costs_the_same_as_looking_everywhere(at: int, seed: int):
    rng = np.random.default_rng(seed)
    cost = np.full(N, 40.0)
    cost[at - 2 : at + 3] = rng.uniform(0, 3, 5)
    places = Places(cost, np.arange(N, dtype=float), rng.uniform(0.8, 1.2, N))
    z = seen(at + 1, rng)
    about = move(CURVE, places, z, 1.0, NOWHERE)
    everywhere = move(CURVE, replace(places, unseen=1000), z, 1.0, NOWHERE)
    assert (about.unseen, everywhere.unseen) == (1, 0)
    near = slice(at - 25, at + 25)
    np.testing.assert_allclose(about.cost[near], everywhere.cost[near], atol=1e-9)
    np.testing.assert_allclose(about.at[near], everywhere.at[near])
    assert standing(about).index == standing(everywhere).index


def test_a_step_changes_nothing_that_was_passed_in():
    places = start(CURVE)
    kept = [array.copy() for array in (places.cost, places.at, places.pace)]
    move(CURVE, places, CURVE.z[3], 1.0, NOWHERE)
    for array, before in zip((places.cost, places.at, places.pace), kept, strict=True):
        np.testing.assert_array_equal(array, before)


@given(place=st.integers(0, N - 1), dx=st.floats(-2, 2), dy=st.floats(-2, 2))
@FEW
def test_shifts_are_taken_out_of_a_look_and_told(place: int, dx: float, dy: float):
    fit = np.array([dx, dy, 0, 0, 0])
    z = CURVE.z[place] + fit @ CURVE.slope[place]
    cost, found = CURVE.looks(z, slice(place, place + 1))
    clean, _ = CURVE.looks(CURVE.z[place], slice(place, place + 1))
    np.testing.assert_allclose(found[0, :2], fit[:2], atol=0.35)
    assert CURVE.misfit(place, z) < 0.5
    assert cost[0] < clean[0] + 1.5


def test_the_misfit_of_a_good_look_is_about_one_and_grows_with_the_distance():
    rng = np.random.default_rng(2)
    good = [CURVE.misfit(i, CURVE.z[i] + CURVE.noise * rng.standard_normal(K)) for i in range(N)]
    assert 0.3 < np.mean(good) < 1.2
    away = rng.standard_normal(K)
    distances = [CURVE.misfit(50, CURVE.z[50] + far * away) for far in (0, 0.5, 1, 2, 4)]
    assert np.all(np.diff(distances) > 0)
    assert distances[-1] == pytest.approx(2 * distances[-2], rel=0.01)


def test_the_margin_is_the_cost_of_the_best_place_elsewhere():
    cost = np.full(N, 30.0)
    cost[[20, 50, 52, 90, 140]] = [9, 0, 1, 7, 4]
    found = standing(Places(cost, np.arange(N) + 0.25, np.full(N, 1.1)))
    assert (found.index, found.at, found.pace, found.margin) == (50, 50.25, 1.1, 4)
    assert found.others == (140, 90, 20)


def test_a_place_vouched_for_stays_and_others_become_costlier():
    places = Places(np.array([0.0, 0, 0, 0, 0, 0]), np.arange(6.0), np.ones(6))
    cost = vouch(places, 2.0, 3.0).cost
    assert cost.argmin() == 2
    assert cost[2] == 0
    assert np.all(np.diff(cost[2:]) >= 0)
    assert cost.max() <= 3.0
