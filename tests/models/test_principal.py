"""Principal directions: how many are kept, and that iterating agrees with the Gram matrix."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models import principal
from models.principal import Choice, principal_directions

VALUES = st.lists(st.floats(1e-3, 10), min_size=1, max_size=20).map(lambda given: np.sort(np.array(given))[::-1])


@given(values=VALUES, share=st.floats(0.01, 0.99), k_max=st.integers(1, 25))
def test_the_count_is_the_fewest_that_hold_the_share(values: np.ndarray, share: float, k_max: int):
    count = Choice(None, share, k_max).count(values, float(values.sum()))
    assert 1 <= count <= min(k_max, len(values))
    fewer = values[: count - 1].sum()
    assert fewer <= share * values.sum()
    assert count in (k_max, len(values)) or values[:count].sum() >= share * values.sum() * (1 - 1e-6)


@given(values=VALUES, k=st.integers(1, 25))
def test_a_fixed_count_is_reached_when_so_many_are_known(values: np.ndarray, k: int):
    choice = Choice(k, 1.0, k)
    assert choice.count(values, 99.0) == min(k, len(values))
    assert choice.reached(values, 99.0) == (len(values) >= k)


@pytest.mark.parametrize("k", [1, 4, 10])
def test_iterating_in_memory_agrees_with_the_gram_matrix(monkeypatch: pytest.MonkeyPatch, k: int):
    rng = np.random.default_rng(0)
    frames = ((rng.standard_normal((200, 20)) * 0.7 ** np.arange(20)) @ rng.standard_normal((20, 90))).astype(
        np.float32
    )
    exact = principal_directions(lambda: frames, Choice(k, 1.0, k), 2**28)
    monkeypatch.setattr(principal, "GRAM_FRAMES", 10)
    iterated = principal_directions(lambda: frames, Choice(k, 1.0, k), 2**28)
    assert iterated.values.tobytes() != exact.values.tobytes()
    np.testing.assert_allclose(iterated.values, exact.values, rtol=1e-4)
    np.testing.assert_allclose(np.abs(np.sum(iterated.rows * exact.rows, axis=1)), 1, atol=1e-3)
    np.testing.assert_allclose(iterated.mean, exact.mean, atol=1e-6)
