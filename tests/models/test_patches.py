"""Patches: squares hold what lies about the cells asked for, wherever these lie, and values go back to their cells."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.patches import Patches
from tests.models.parts import MANY

SIZES = st.tuples(st.integers(150, 260), st.integers(150, 260))


def some(seed: int, size: tuple[int, int], cell: int) -> np.ndarray:
    """A few groups of cells."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((-(-size[1] // cell), -(-size[0] // cell)), np.uint8)
    cells.flat[rng.integers(0, cells.size, 2)] = 255
    return cv2.dilate(cells, np.ones((3, 3), np.uint8))


@given(seed=st.integers(0, 999), size=SIZES, cell=st.sampled_from((4, 8)), colour=st.booleans())
@MANY
def test_what_is_cut_at_some_cells_goes_back_to_them(seed: int, size: tuple[int, int], cell: int, colour: bool):
    w, h = size
    shape = (h, w, 3) if colour else (h, w)
    picture = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    wanted = some(seed, size, cell)
    patches = Patches.about(wanted, cell, shape)
    assert patches is not None
    cut = patches.cut(picture)
    assert cut.shape[2:] == shape[2:]
    values = (cut if not colour else cut[..., 1])[::2, ::2].astype(np.float32)
    kept = np.full(wanted.shape, -1, np.float32)
    put = patches.put(values, kept, cell)
    # the last rows and columns of an odd picture, and cells cut by its end, lie in no square
    rows, cols = (h - 1) // cell, (w - 1) // cell
    everywhere = (picture if not colour else picture[..., 1])[::cell, ::cell][:rows, :cols].astype(np.float32)
    asked = wanted[:rows, :cols] > 0
    np.testing.assert_array_equal(put[:rows, :cols][asked], everywhere[asked])
    others = put[:rows, :cols] != everywhere
    assert np.all(put[:rows, :cols][others] == -1)
    assert np.all(kept == -1)


def test_several_pictures_lie_side_by_side_in_their_order():
    first = np.random.default_rng(1).integers(0, 256, (160, 200), dtype=np.uint8)
    patches = Patches.about(some(3, (200, 160), 4), 4, first.shape)
    assert patches is not None
    both = patches.cut(first, 255 - first)
    half = both.shape[1] // 2
    np.testing.assert_array_equal(both[:, :half], patches.cut(first))
    np.testing.assert_array_equal(both[:, half:], 255 - both[:, :half])


@pytest.mark.parametrize("size", [(40, 30), (200, 160)])
def test_where_nearly_all_is_asked_for_or_the_picture_is_small_there_are_no_squares(size: tuple[int, int]):
    cells = np.full((size[1] // 4, size[0] // 4), 255, np.uint8)
    assert Patches.about(cells, 4, (size[1], size[0])) is None
