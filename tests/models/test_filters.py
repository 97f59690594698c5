"""Filters: what the preparation does not already prove."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models import filters

VALUES = np.random.default_rng(0).random((24, 32)).astype(np.float32)


@pytest.mark.parametrize(
    "filtered", [filters.gradient, filters.derivatives, lambda values: filters.smooth(values, 0.6)]
)
def test_bytes_do_not_depend_on_where_in_memory_a_picture_lies(filtered):
    seen: set[bytes] = set()
    kept: list[np.ndarray] = []
    for offset in range(0, 256, 4):
        # What stays allocated in between moves the results about, too.
        kept.append(np.zeros(16 * offset + 9, np.uint8))
        room = np.zeros(VALUES.nbytes + 256, np.uint8)
        moved = room[offset : offset + VALUES.nbytes].view(np.float32).reshape(VALUES.shape)
        moved[...] = VALUES
        seen.add(filtered(moved).tobytes())
    assert len(seen) == 1


@given(width=st.integers(1, 200), height=st.integers(1, 150), to=st.tuples(st.integers(1, 40), st.integers(1, 30)))
@settings(max_examples=60, deadline=None)
def test_scaling_keeps_one_grey_as_it_is(width: int, height: int, to: tuple[int, int]):
    picture = np.full((height, width), 173, np.uint8)
    small = filters.scaled(picture, to)
    assert small.shape == (to[1], to[0])
    assert (small == 173).all()


def test_a_size_of_none_or_its_own_is_the_picture_itself():
    assert filters.scaled(VALUES, None) is VALUES
    assert filters.scaled(VALUES, (32, 24)) is VALUES


@given(height=st.integers(1, 12), width=st.integers(1, 12), seed=st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_the_spectrum_holds_the_energy_of_the_picture(height: int, width: int, seed: int):
    values = np.random.default_rng(seed).random((height, width)).astype(np.float32)
    power = filters.power_spectrum(values, np.ones((height, width), np.bool_), taper=False)[..., 0]
    # Parseval: all but the first column, and the last one of even widths, stand for two of the whole plane.
    twice = np.full(width // 2 + 1, 2.0)
    twice[0] = 1
    if width % 2 == 0:
        twice[-1] = 1
    assert float((power * twice).sum()) == pytest.approx(float(np.sum(values.astype(np.float64) ** 2)), rel=1e-4)
