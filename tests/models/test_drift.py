"""Drift: a step is found where and when it is; chance, single bad parts and small steps are not taken for one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.drift import changes


def noise(n: int, bins: int = 50, seed: int = 0) -> np.ndarray:
    return 0.3 + 0.05 * np.random.default_rng(seed).standard_normal((n, bins))


@given(since=st.integers(30, 70), bin=st.integers(0, 49), step=st.sampled_from([-0.25, 0.3]), seed=st.integers(0, 99))
def test_a_step_is_found_where_it_is_and_since_when(since: int, bin: int, step: float, seed: int) -> None:
    profiles = noise(100, seed=seed)
    profiles[since:, bin] += step
    (found,) = changes(profiles)
    assert (found.s_start, found.s_end) == (bin / 50, (bin + 1) / 50)
    assert abs(found.since - since) <= 2
    assert found.after - found.before == pytest.approx(step, abs=0.06)


def test_without_a_step_nothing_is_found() -> None:
    assert sum(len(changes(noise(100, seed=seed))) for seed in range(100)) <= 3


def test_single_bad_parts_are_no_drift() -> None:
    profiles = noise(200)
    profiles[::25] += 5.0
    assert changes(profiles) == ()


def test_steps_too_small_to_matter_are_not_told() -> None:
    profiles = noise(2000)
    profiles[1000:, 7] += 0.03
    assert changes(profiles) == ()


def test_what_was_not_seen_does_not_count() -> None:
    profiles = noise(90)
    profiles[60:, 10:13] += 0.4
    profiles[1::2, 11] = np.nan
    profiles[:, 40] = np.nan
    (found,) = changes(profiles)
    assert (found.s_start, found.s_end) == (10 / 50, 13 / 50)
    assert abs(found.since - 60) <= 2


@pytest.mark.parametrize("n", [0, 1, 19])
def test_of_few_parts_nothing_is_said(n: int) -> None:
    profiles = noise(n)
    profiles[n // 2 :] += 1
    assert changes(profiles) == ()
