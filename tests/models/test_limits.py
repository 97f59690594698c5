"""Limits: a floor and a share of the contrast, times what keeps false rejects at the target that was asked for."""

import math
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models import limits
from models.errors import PolicyError
from models.limits import FINE, Limits, promise
from models.verdict import ALLOWED, Policy
from tests.models.parts import FEW, MANY

CONTRASTS = st.lists(st.floats(0, 255), min_size=2, max_size=9).map(np.array)
PEAKS = st.lists(st.floats(0.01, 20), max_size=8).map(tuple)
TARGETS = st.floats(*ALLOWED["false_rejects"])
USUAL = (0.55, 0.62, 0.5, 0.7, 0.58, 0.66)


@given(contrast=CONTRASTS, floor=st.floats(0.5, 20), share=st.floats(0, 1), factor=st.floats(0.2, 9))
@MANY
def test_the_threshold_is_linear_in_the_contrast(contrast: np.ndarray, floor: float, share: float, factor: float):
    found = Limits(floor, share, factor).threshold(contrast)
    np.testing.assert_allclose(found, [factor * (floor + share * c) for c in contrast])


@given(contrast=CONTRASTS)
@MANY
def test_the_usual_threshold_is_positive_and_grows_with_the_contrast(contrast: np.ndarray):
    found = FINE.threshold(np.sort(contrast))
    assert np.all(found > 0)
    assert np.all(np.diff(found) >= 0)


def test_one_golden_sweep_at_the_usual_target_leaves_the_assumed_limits_as_they_are():
    found = promise((), Policy.false_rejects)
    assert found.factor == pytest.approx(1.0, abs=0.005)
    assert found.expected == pytest.approx(Policy.false_rejects, rel=1e-3)
    assert (found.sweeps, found.unassumed) == (1, 1.0)


@pytest.mark.parametrize("peaks", [(0.06, 0.07), (0.5, 0.45), (0.7, 0.7), (0.3, 0.6)])
def test_two_usual_golden_sweeps_hardly_move_the_limit(peaks: tuple[float, ...]):
    assert 0.88 < promise(peaks, Policy.false_rejects).factor < 1.06


@given(peaks=PEAKS, targets=st.tuples(TARGETS, TARGETS))
@MANY
def test_who_allows_more_false_rejects_gets_a_limit_no_higher(peaks: tuple[float, ...], targets: tuple[float, float]):
    strict, loose = (promise(peaks, target) for target in sorted(targets))
    assert loose.factor <= strict.factor
    assert loose.needed <= strict.needed


@given(peaks=PEAKS, target=TARGETS)
@MANY
def test_a_promise_expects_no_more_than_the_target_and_lies_in_its_interval(peaks: tuple[float, ...], target: float):
    found = promise(peaks, target)
    assert found.expected <= target * (1 + 1e-4)
    assert 0 <= found.low <= found.high <= 1
    assert found.low <= found.expected
    assert found.factor >= limits.LEAST * promise((), target).factor


@given(peaks=st.lists(st.floats(0.4, 5), min_size=3, max_size=6), by=st.floats(1.0, 3.0), target=TARGETS)
@FEW
def test_louder_golden_sweeps_never_lower_the_limit_where_three_agree(peaks: list[float], by: float, target: float):
    # Two that agree far from all that is assumed may still be spoilt, both of them.
    level = peaks[0]
    quiet, loud = (promise((each,) * len(peaks), target).factor for each in (level, level * by))
    assert loud >= quiet * (1 - 1e-6)


@given(peaks=PEAKS, target=TARGETS, seed=st.integers(0, 99))
@FEW
def test_the_order_of_the_golden_sweeps_does_not_matter(peaks: tuple[float, ...], target: float, seed: int):
    other = tuple(np.random.default_rng(seed).permutation(peaks))
    assert promise(other, target).factor == pytest.approx(promise(peaks, target).factor, rel=1e-6)


@lru_cache
def _drawn(count: int = 400_000) -> tuple[np.ndarray, np.ndarray]:
    """Products as assumed: middle and spread of the logarithm of their peaks."""
    rng = np.random.default_rng(5)
    middles = math.log(limits.USUAL) + limits.PRODUCTS * rng.standard_t(limits.FREEDOM, count)
    return middles, limits.SPREAD * np.exp(limits.SPREADS * rng.standard_normal(count))


def _beyond(z: np.ndarray) -> np.ndarray:
    return np.array([math.erfc(each / math.sqrt(2)) / 2 for each in z])


@pytest.mark.parametrize("target", [0.01, 0.05])
@pytest.mark.parametrize("peaks", [(), (0.8, 0.7), (0.3, 0.6, 0.45), (0.9, 1.1, 1.0, 0.8), (0.6, 0.7, 0.65, 4.0)])
def test_the_limit_is_the_quantile_that_brute_force_finds(peaks: tuple[float, ...], target: float):
    """Every product drawn, weighed by how likely it shows these peaks, asked how often it exceeds the limit."""
    middles, spreads = _drawn()
    weight = np.ones_like(middles)
    for peak in peaks:
        z = (math.log(max(peak, limits.QUIET)) - middles) / spreads
        if peak < limits.QUIET:
            weight *= (1 - limits.SPOILT) * (1 - _beyond(z)) + limits.SPOILT / 2
        else:
            normal = np.exp(-(z**2) / 2) / (math.sqrt(2 * math.pi) * spreads)
            weight *= (1 - limits.SPOILT) * normal + limits.SPOILT / 2 / math.log(20 / limits.QUIET)
    found = promise(peaks, target)
    rate = _beyond((math.log(found.factor) - middles) / spreads)
    weight /= weight.sum()
    assert float(weight @ rate) == pytest.approx(found.expected, rel=0.06)
    inside = weight[(found.low <= rate) & (rate <= found.high)].sum()
    assert inside == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize(("sweeps", "target"), [(2, 0.01), (3, 0.05), (10, 0.01), (10, 0.05)])
def test_promises_are_kept_over_many_products(sweeps: int, target: float):
    """Draw a product, learn from some of its sweeps, look at its true rate: inside for nine of ten, and on target."""
    rng = np.random.default_rng(sweeps)
    kept, rates, products = 0, list[float](), 250
    for middle, spread in zip(*(each[:products] for each in _drawn()), strict=True):
        peaks = np.exp(middle + spread * rng.standard_normal(sweeps))
        found = promise(tuple(peaks), target)
        rate = math.erfc((math.log(found.factor) - middle) / spread / math.sqrt(2)) / 2
        rates.append(rate)
        kept += found.low <= rate <= found.high
    assert 0.85 * products <= kept <= 0.97 * products
    assert 0.3 * target < np.mean(rates) < 1.5 * target


@pytest.mark.parametrize("level", [0.2, 0.6, 1.5, 4.0])
@pytest.mark.parametrize("shape", ["gumbel", "normal"])
def test_a_product_of_another_kind_keeps_about_the_target_too(level: float, shape: str):
    """Peaks that are not log-normal, and far from the usual, ten golden sweeps: no more than thrice the target."""
    rng = np.random.default_rng(3)
    many = rng.gumbel(level, 0.13 * level, 20_000) if shape == "gumbel" else rng.normal(level, 0.2 * level, 20_000)
    many = np.maximum(many, 0.05)
    rates = [np.mean(many >= promise(tuple(many[i * 10 : i * 10 + 10]), 0.01).factor) for i in range(40)]
    assert np.mean(rates) < 0.03


def test_one_bad_sweep_among_ten_is_not_believed_and_ten_that_agree_are():
    usual = promise((*USUAL, 0.6, 0.55, 0.65), 0.01).factor
    assert promise((*USUAL, 0.6, 0.55, 0.65, 6.0), 0.01).factor == pytest.approx(usual, rel=0.05)
    assert promise(tuple(5 * peak for peak in USUAL), 0.01).factor == pytest.approx(5 * 0.86, rel=0.15)


def test_quiet_golden_sweeps_may_all_be_of_one_part_and_lower_nothing():
    assert promise((0.06,) * 10, 0.01).factor > 0.97
    assert promise((0.3, 0.2, 0.25, 0.45, 0.3, 0.41, 0.35, 0.3, 0.44, 0.42), 0.01).factor < 0.85


def test_the_limit_falls_little_by_little():
    few, more = (promise((0.45,) * count, 0.01).factor for count in (2, 3))
    assert promise((), 0.01).factor * 0.9 <= few
    assert promise((), 0.01).factor * 0.85 <= more


@pytest.mark.parametrize(("target", "needed"), [(0.01, 99), (0.05, 19), (0.25, 3), (0.03, 33), (0.001, 999)])
def test_how_many_sweeps_would_do_without_assumptions(target: float, needed: int):
    assert promise(USUAL, target).needed == needed
    enough, one_less = (promise((0.5,) * count, target) for count in (needed, needed - 1))
    assert enough.unassumed <= target < one_less.unassumed


def test_what_is_borne_out_without_assumptions_counts_the_peaks_beyond_the_limit():
    assert promise(USUAL, 0.01).unassumed == pytest.approx(1 / 7)
    assert promise((*USUAL, 9.0), 0.01).unassumed == pytest.approx(2 / 8)


def test_the_sentence_says_what_it_rests_on():
    assert promise((0.6, 0.7), 0.02).sentence() == (
        "3 golden sweeps: limit at 0.92 of the assumed tolerance; 2 % false rejects expected, 0 % to 8.7 % (90 %), "
        "resting on the stated assumptions; 49 golden sweeps would promise 2 % without them"
    )
    assert promise((0.6,) * 20, 0.05).sentence().endswith("; at most 4.8 % without any assumption")


@pytest.mark.parametrize("target", [0.0, -0.1, 0.51, math.nan, math.inf])
def test_a_target_that_nobody_can_mean_is_refused(target: float):
    with pytest.raises(PolicyError, match=rf"^false_rejects is {target}, allowed are 0\.0001 to 0\.5$"):
        promise((), target)


def test_peaks_of_nothing_at_all_are_quiet():
    assert promise((0.0, 0.0), 0.01).factor > 0.9
