"""Spread: what golden sweeps showed comes back from its picture, and what each reaches alone has closed forms."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.spread import (
    ODD,
    Odd,
    Shown,
    against,
    grown,
    highest,
    leave_one_out,
    odd,
    pack,
    tolerated,
    unpack_cells,
)
from tests.models.parts import FEW, MANY

SHAPES = ((6, 9, 2), (6, 9, 4))
SHAPE = SHAPES[1]


def cells(**at: float) -> np.ndarray:
    """A map of two scales: `c0` is bright and `c3` coarse and dark, in the middle; `far2` the same, in a corner."""
    made = np.zeros(SHAPE, np.float32)
    for name, value in at.items():
        made[(0, 0) if name.startswith("far") else (3, 4)][int(name[-1])] = value
    return made


def sweep(*maps: np.ndarray, first: int = 0) -> Shown:
    """One golden sweep that came by some key places, one after the other."""
    return {first + i: pack(each) for i, each in enumerate(maps)}


@given(seed=st.integers(0, 999), shape=st.sampled_from(SHAPES))
@MANY
def test_a_map_comes_back_rounded_up_to_a_sixteenth(seed: int, shape: tuple[int, int, int]):
    shown = np.random.default_rng(seed).uniform(0, 15.9, shape).astype(np.float32)
    back = unpack_cells(pack(shown), shape)
    assert np.all(back >= shown)
    assert np.all(back < shown + 1 / 16)
    assert pack(back) == pack(shown)


def test_what_is_more_than_a_map_can_hold_stays_the_most_that_it_can():
    assert unpack_cells(pack(cells(c1=99.0)), SHAPE).max() == 255 / 16


@pytest.mark.parametrize("data", [b"", b"nothing", pack(np.zeros((9, 6, 4), np.float32)), pack(cells()[:, :, :2])])
def test_what_is_no_map_of_the_cells_is_refused(data: bytes):
    with pytest.raises(ValueError, match="no map of 6 x 9 cells, 4 channels"):
        unpack_cells(data, SHAPE)


def test_a_picture_of_sixteen_bits_is_refused():
    with pytest.raises(ValueError, match="no map"):
        unpack_cells(cv2.imencode(".png", np.zeros((24, 9), np.uint16))[1].tobytes(), SHAPE)


def test_what_is_tolerated_is_the_most_that_any_sweep_showed_and_a_cell_about_it():
    some = [sweep(cells(c0=1.0)), sweep(cells(c0=3.0, far2=2.0)), {}]
    np.testing.assert_array_equal(unpack_cells(highest(some, 0, SHAPE), SHAPE), cells(c0=3.0, far2=2.0))
    found = unpack_cells(tolerated(some, 0, SHAPE), SHAPE)
    np.testing.assert_array_equal(found, grown(cells(c0=3.0, far2=2.0)))
    assert np.argwhere(found[:, :, 0]).tolist() == [[row, col] for row in (2, 3, 4) for col in (3, 4, 5)]
    assert np.count_nonzero(found[:, :, 2]) == 4
    assert tolerated(some, 1, SHAPE) == highest(some, 1, SHAPE) == b""


def test_against_what_is_tolerated_a_score_goes_with_one_over_one_more():
    tolerance, shown = sweep(cells(c0=3.0)), sweep(cells(c0=2.0, far1=0.25, c3=1.5), cells(c3=4.0))
    np.testing.assert_array_equal(against(tolerance, shown, SHAPE), [0.5, 4.0])
    np.testing.assert_array_equal(against({}, shown, SHAPE), [2.0, 4.0])
    np.testing.assert_array_equal(against(tolerance, {}, SHAPE), [0.0, 0.0])


def test_what_one_sweep_shows_is_its_own_and_what_two_show_is_shared():
    alone, shared = 6.0, 3.0
    some = [sweep(cells(c0=alone)), sweep(cells(far3=shared)), sweep(cells(far3=shared))]
    peaks = leave_one_out(some, SHAPE)
    # nobody else shows the first; the two others explain each other
    np.testing.assert_array_equal(peaks[1:], [[alone, 0], [0, shared / (1 + shared)], [0, shared / (1 + shared)]])
    np.testing.assert_array_equal(peaks[0], [0, 0])


def test_what_all_others_show_is_the_reference_sweeps_own():
    some = [sweep(cells(c2=level)) for level in (5.0, 4.0, 6.0)]
    np.testing.assert_array_equal(leave_one_out(some, SHAPE)[0], [0.0, 4.0])
    # one that did not come by cannot say so
    assert not leave_one_out([*some, sweep(cells(), first=1)], SHAPE)[0].any()
    assert not leave_one_out(some[:1], SHAPE)[0].any()


def test_what_is_shown_a_cell_beside_is_the_same():
    here = cells(c0=3.0)
    for cols, reached in ((1, 0.75), (2, 3.0)):
        there = np.roll(here, cols, axis=1)
        np.testing.assert_array_equal(leave_one_out([sweep(here), sweep(there)], SHAPE)[1:, 0], [reached, reached])


@given(seed=st.integers(0, 999), count=st.integers(1, 5))
@FEW
def test_leaving_one_out_is_judging_it_against_what_the_others_leave_tolerated(seed: int, count: int):
    rng = np.random.default_rng(seed)
    some = [
        {key: pack(rng.gamma(0.5, 1.0, SHAPE).astype(np.float32)) for key in range(4) if rng.random() < 0.8}
        for _ in range(count)
    ]
    for i, peaks in enumerate(leave_one_out(some, SHAPE)[1:]):
        others = [*some[:i], *some[i + 1 :]]
        tolerance = {key: data for key in range(4) if (data := tolerated(others, key, SHAPE))}
        np.testing.assert_allclose(peaks, against(tolerance, some[i], SHAPE), rtol=1e-6)


KEPT = np.ones(4, bool)


def test_the_odd_one_reaches_far_more_than_is_usual_at_one_of_the_scales():
    peaks = np.array([[0.5, 1.0], [0.6, 1.2], [0.4, 6.0], [0.5, 1.1]], np.float32)
    assert odd(peaks, KEPT) == Odd(2, pytest.approx(6.0), pytest.approx(1.15))


def test_of_two_odd_ones_the_worse_is_named_first_and_the_other_without_it():
    peaks = np.array([[1.0], [5.0], [1.0], [9.0], [1.0]], np.float32)
    kept = np.ones(5, bool)
    assert odd(peaks, kept) == Odd(3, 9.0, 1.0)
    kept[3] = False
    assert odd(peaks, kept) == Odd(1, 5.0, 1.0)


@pytest.mark.parametrize("loud", [0.95 * ODD, 1.05 * ODD])
def test_among_quiet_sweeps_the_assumed_limit_is_usual(loud: float):
    peaks = np.array([[0.1], [0.1], [0.1], [loud]], np.float32)
    assert (odd(peaks, KEPT) is None) == (loud < ODD)


def test_among_loud_sweeps_a_loud_one_is_not_odd():
    assert odd(np.array([[4.0], [5.0], [6.0], [9.0]], np.float32), KEPT) is None


def test_two_cannot_tell_which_of_them_is_odd():
    assert odd(np.array([[0.1], [9.0]], np.float32), np.ones(2, bool)) is None
