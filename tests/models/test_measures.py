"""Measures: areas, shares and intervals against what they are by definition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from models.measures import Proportion, auroc, auroc_without_each, jackknife, paired, roc
from tests.models.parts import MANY

SCORES = st.lists(st.integers(0, 9).map(float), max_size=12)
SOME = st.lists(st.integers(0, 9).map(float), min_size=1, max_size=12)


@given(negative=SOME, positive=SOME)
@MANY
def test_the_area_is_the_share_of_pairs_in_the_right_order(negative: list[float], positive: list[float]) -> None:
    pairs = [(p > n) + 0.5 * (p == n) for p in positive for n in negative]
    assert auroc(negative, positive) == pytest.approx(np.mean(pairs))


@given(negative=SOME, positive=SOME)
@MANY
def test_the_curve_rises_from_corner_to_corner_and_has_that_area_below_it(
    negative: list[float], positive: list[float]
) -> None:
    points = roc(negative, positive)
    assert points[0].tolist() == [0, 0]
    assert points[-1].tolist() == [1, 1]
    assert np.all(np.diff(points, axis=0) >= 0)
    assert np.trapezoid(points[:, 1], points[:, 0]) == pytest.approx(auroc(negative, positive))


def test_of_nothing_there_is_no_area() -> None:
    assert auroc([], [1.0]) is None
    assert auroc([1.0], []) is None


@given(groups=st.lists(st.tuples(SCORES, SCORES), max_size=5))
@MANY
def test_leaving_a_group_out_is_counting_the_others(groups: list[tuple[list[float], list[float]]]) -> None:
    for left, found in enumerate(auroc_without_each(groups)):
        rest = groups[:left] + groups[left + 1 :]
        expected = auroc([n for group in rest for n in group[0]], [p for group in rest for p in group[1]])
        assert found == (None if expected is None else pytest.approx(expected))


@given(of=st.integers(1, 400), data=st.data())
@MANY
def test_at_the_ends_of_the_interval_what_was_seen_is_as_rare_as_said(of: int, data: st.DataObject) -> None:
    count = data.draw(st.integers(0, of))
    low, high = Proportion(count, of).interval or (2.0, 2.0)
    assert 0 <= low <= count / of <= high <= 1
    if count:
        assert binom.sf(count - 1, of, low) == pytest.approx(0.025, rel=1e-6)
    if count < of:
        assert binom.cdf(count, of, high) == pytest.approx(0.025, rel=1e-6)


@pytest.mark.parametrize("of", [1, 7, 40, 300])
def test_of_none_and_of_all_the_interval_has_a_closed_form(of: int) -> None:
    end = 0.025 ** (1 / of)
    assert Proportion(0, of).interval == pytest.approx((0, 1 - end))
    assert Proportion(of, of).interval == pytest.approx((end, 1))


def test_of_nothing_there_is_neither_share_nor_interval() -> None:
    assert (Proportion(0, 0).share, Proportion(0, 0).interval, paired(0, 0, 0)) == (None, None, None)


def test_of_a_mean_the_jackknife_is_students_interval() -> None:
    x = np.array([0.2, 1.3, 0.7, 2.2, 0.4])
    without = [float(np.delete(x, i).mean()) for i in range(len(x))]
    half = 2.7764451052 * x.std(ddof=1) / np.sqrt(len(x))
    assert jackknife(float(x.mean()), without) == pytest.approx((x.mean() - half, x.mean() + half))
    assert jackknife(1.0, [1.0]) is None


@given(gained=st.integers(0, 30), lost=st.integers(0, 30), same=st.integers(1, 30))
@MANY
def test_a_paired_difference_is_in_its_interval_and_turns_with_the_sides(gained: int, lost: int, same: int) -> None:
    of = gained + lost + same
    low, high = paired(gained, lost, of) or (2.0, 2.0)
    assert low <= (gained - lost) / of <= high
    assert paired(lost, gained, of) == pytest.approx((-high, -low))


def test_six_changes_one_way_are_beyond_chance_and_five_are_not() -> None:
    # Both tails of a fair coin: 2 / 2**5 = 0.0625, 2 / 2**6 = 0.03125.
    for gained, beyond in ((5, False), (6, True)):
        low, _ = paired(gained, 0, 100) or (2.0, 2.0)
        assert (low > 0) is beyond
