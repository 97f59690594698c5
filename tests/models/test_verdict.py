"""Verdict: a policy that means nothing is refused with what was allowed."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.errors import NumericError, PolicyError
from models.verdict import Policy

SHARES = ("review_margin", "hysteresis", "coverage", "invalid_share")
ALL = ("false_rejects", "sensitivity", *SHARES)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -0.001, 100.5])
def test_a_threshold_that_means_nothing_is_refused_by_name_value_and_range(name: str, value: float):
    with pytest.raises(PolicyError, match=rf"^{name} is {value}, allowed are \d+\.\d+ to \d+\.\d+$"):
        Policy(**{name: value})


@pytest.mark.parametrize("value", [0.0, 0.0099])
def test_a_sensitivity_that_finds_nothing_is_refused(value: float):
    with pytest.raises(PolicyError, match=rf"^sensitivity is {value}, allowed are 0\.01 to 100\.0$"):
        Policy(sensitivity=value)


@pytest.mark.parametrize("value", [0.0, 0.00009, 0.51, 1.0])
def test_a_false_reject_target_that_nobody_can_mean_is_refused(value: float):
    with pytest.raises(PolicyError, match=rf"^false_rejects is {value}, allowed are 0\.0001 to 0\.5$"):
        Policy(false_rejects=value)


@pytest.mark.parametrize("name", SHARES)
def test_a_share_is_from_nothing_to_all_with_both(name: str):
    assert [getattr(Policy(**{name: value}), name) for value in (0.0, 1.0)] == [0.0, 1.0]
    with pytest.raises(PolicyError, match=rf"^{name} is 1\.0001, allowed are 0\.0 to 1\.0$"):
        Policy(**{name: 1.0001})


@given(target=st.floats(0.0001, 0.5), sensitivity=st.floats(0.01, 100), share=st.floats(0, 1))
def test_what_is_allowed_is_kept_as_it_is(target: float, sensitivity: float, share: float):
    policy = Policy(target, sensitivity, *(share,) * len(SHARES))
    assert [getattr(policy, name) for name in ALL] == [target, sensitivity, *(share,) * len(SHARES)]


def test_whoever_catches_what_models_raise_catches_this():
    with pytest.raises(NumericError):
        Policy(coverage=2.0)
