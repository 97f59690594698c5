"""Tolerance: nothing inside the band, closed forms beyond it, and cells that the frame does not show."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.registration import affine
from models.tolerance import BRIGHT, DARK, Band, aligned, beyond, cell_size, evidence, levels, outside
from tests.models.parts import FEW, MANY, View, pose_of, shot, surface

CELL = 4
UNLIT = np.array([1.0, 0.0, 0.0, 0.0])
KINDS = ("grey", "colour", "deep")


def picture(kind: str = "grey", level: int = 100, size: tuple[int, int] = (80, 60)) -> np.ndarray:
    """One grey, in the levels that comparison works on."""
    full, of = (257, np.uint16) if kind == "deep" else (1, np.uint8)
    pixels = np.full((size[1], size[0]), level * full, of)
    return levels(pixels if kind != "colour" else np.stack([pixels, pixels, pixels], axis=2))


def band(reference: np.ndarray, excess: np.ndarray | None = None) -> Band:
    return Band.of(reference, excess, CELL)


@given(seed=st.integers(0, 99), width=st.integers(16, 70), height=st.integers(16, 60), colour=st.booleans())
@FEW
def test_the_band_holds_its_reference_and_its_cells_cover_it(seed: int, width: int, height: int, colour: bool):
    shape = (height, width, 3) if colour else (height, width)
    reference = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    made = band(reference)
    assert np.all(made.low <= reference)
    assert np.all(reference <= made.high)
    assert made.contrast.shape == (-(-height // CELL), -(-width // CELL))
    found = evidence(made, reference, CELL)
    assert found.shape == (*made.contrast.shape, 2)
    assert not found.any()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("polarity", "by"), [(BRIGHT, 30), (DARK, -30)])
def test_a_planted_square_gives_its_own_excess_in_its_own_place(kind: str, polarity: int, by: int):
    seen = picture(kind)
    seen[20:32, 40:52] = 100 + by
    found = evidence(band(picture(kind)), seen, CELL)
    assert found[6, 11, polarity] == pytest.approx(30, abs=0.01)
    assert not found[:, :, 1 - polarity].any()
    rows, cols = np.nonzero(found[:, :, polarity])
    # a box of some pixels reaches into the neighbouring cells, not further
    assert (rows.min(), rows.max(), cols.min(), cols.max()) == pytest.approx((4.5, 7.5, 9.5, 12.5), abs=0.5)


@given(side=st.sampled_from((2, 4)), by=st.integers(8, 100))
@FEW
def test_a_square_smaller_than_the_box_is_diluted_by_its_area(side: int, by: int):
    seen = picture()
    seen[24 : 24 + side, 40 : 40 + side] += by
    assert evidence(band(picture()), seen, CELL).max() == pytest.approx(by * side**2 / 36, rel=1e-5)


def test_one_channel_is_enough_in_colour():
    seen = picture("colour")
    seen[20:32, 40:52, 0] += 25
    assert evidence(band(picture("colour")), seen, CELL)[6, 11, BRIGHT] == pytest.approx(25)


def test_sixteen_bits_say_the_same_as_eight():
    rng = np.random.default_rng(1)
    reference, seen = (rng.integers(60, 120, (60, 80), dtype=np.uint8) for _ in range(2))
    deep = [levels(p.astype(np.uint16) * 257) for p in (reference, seen)]
    eight, sixteen = evidence(band(reference), seen, CELL), evidence(band(deep[0]), deep[1], CELL)
    # halving rounds to whole levels in eight bits
    np.testing.assert_allclose(eight, sixteen, atol=0.6)
    assert eight.max() > 1


@given(dx=st.floats(-2, 2), dy=st.floats(-2, 2), kind=st.sampled_from(KINDS))
@FEW
def test_edges_that_moved_by_up_to_two_pixels_are_allowed(dx: float, dy: float, kind: str):
    reference = picture(kind, 60)
    reference[20:40, 30:50] = 200
    reference[10:14] = 120
    moved = aligned(reference, np.array([dx, dy, 0.0]), UNLIT)
    assert evidence(band(reference), moved, CELL).max() <= 1


def test_an_edge_that_moved_further_is_found():
    reference = picture(level=60)
    reference[:, 40:] = 200
    moved = np.roll(reference, 6, axis=1)
    moved[:, :6] = 60
    found = evidence(band(reference), moved, CELL)
    assert found[:, 10:12, DARK].max() > 40
    assert not found[:, :8].any()


def test_a_long_edge_that_strays_by_four_pixels_is_forgiven_and_a_notch_in_it_is_not():
    reference = picture(level=60)
    reference[:, 40:] = 200
    strayed, notched = reference.copy(), reference.copy()
    strayed[:, 36:40] = 200
    notched[28:34, 36:40] = 200
    assert evidence(band(reference), strayed, CELL).max() <= 1
    assert evidence(band(reference), notched, CELL)[7:9, 8:10, BRIGHT].max() > 20


def grooved(kind: str, width: int, at: int = 40, level: int = 60, across: bool = False) -> np.ndarray:
    """A bright picture with a dark groove through all of it."""
    drawn = picture(kind, 200, (90, 90))
    drawn[np.s_[at : at + width] if across else np.s_[:, at : at + width]] = level
    return drawn


GROOVES = pytest.mark.parametrize(
    ("kind", "across", "width"), [("grey", False, 5), ("grey", True, 6), ("colour", False, 7), ("deep", True, 7)]
)


@GROOVES
@pytest.mark.parametrize("by", [-4, -3, 3, 4])
def test_a_groove_that_strayed_is_forgiven(kind: str, across: bool, width: int, by: int):
    made = band(grooved(kind, width, across=across))
    assert evidence(made, grooved(kind, width, 40 + by, across=across), CELL).max() <= 1


@GROOVES
@pytest.mark.parametrize("level", [200, 130])
def test_a_groove_that_is_gone_or_half_gone_is_not_forgiven(kind: str, across: bool, width: int, level: int):
    made = band(grooved(kind, width, across=across))
    found = evidence(made, grooved(kind, width, level=level, across=across), CELL)
    # the band may reach two pixels over either edge; the box is six wide
    assert (level - 60) * (width - 4) / 6 - 0.5 <= found[:, :, BRIGHT].max() <= level - 60
    assert not found[:, :, DARK].any()


def blobs(seed: int, sizes: tuple[int, int]) -> np.ndarray:
    """One grey with squares of other greys on it."""
    rng, drawn = np.random.default_rng(seed), picture()
    for x, y, side, level in rng.integers((0, 0, sizes[0], 0), (70, 50, sizes[1], 256), (6, 4)):
        drawn[y : y + side, x : x + side] = level
    return drawn


def test_a_square_is_beyond_the_band_where_it_is_and_not_beside_it():
    seen = picture()
    seen[20:32, 40:52] += 30
    np.testing.assert_array_equal(beyond(band(picture()), seen)[BRIGHT], seen - 100)


@given(seed=st.integers(0, 999))
@MANY
def test_bright_and_dark_are_the_distances_from_the_band(seed: int):
    made, seen = band(picture()), blobs(seed, (4, 12))
    bright, dark = beyond(made, seen)
    np.testing.assert_array_equal(bright, np.maximum(seen.astype(int) - 100, 0))
    np.testing.assert_array_equal(dark, np.maximum(100 - seen.astype(int), 0))


@given(seed=st.integers(0, 999))
@MANY
def test_what_is_forgiven_is_never_more_than_what_there_is(seed: int):
    made, seen = band(blobs(seed, (4, 30))), blobs(seed + 1000, (1, 30))
    bright, dark = beyond(made, seen)
    wide = seen.astype(int)
    assert np.all(bright <= np.maximum(wide - made.high, 0))
    assert np.all(dark <= np.maximum(made.low.astype(int) - wide, 0))
    deep = beyond(band(made.reference.astype(np.float32)), seen.astype(np.float32))
    np.testing.assert_array_equal(np.stack(deep), np.stack([bright, dark]))


@pytest.mark.parametrize("kind", KINDS)
def test_what_good_parts_showed_is_allowed_there_and_with_that_sign_only(kind: str):
    reference = picture(kind)
    excess = np.zeros((2, *reference.shape), np.uint8)
    excess[BRIGHT, 20:32, 40:52] = 30
    wider = band(reference, excess)
    bright, dark, elsewhere = reference.copy(), reference.copy(), reference.copy()
    bright[20:32, 40:52], dark[20:32, 40:52], elsewhere[40:52, 10:22] = 130, 70, 130
    assert not evidence(wider, bright, CELL).any()
    assert evidence(wider, dark, CELL).max() == pytest.approx(30, abs=0.01)
    assert evidence(wider, elsewhere, CELL).max() == pytest.approx(30, abs=0.01)


def test_contrast_is_nothing_on_flat_ground_and_most_of_the_step_beside_an_edge():
    reference = picture(level=60)
    reference[:, 40:] = 200
    contrast = band(reference).contrast
    assert contrast[7, 10] > 70
    assert contrast[:, :6].max() == contrast[:, 14:].max() == 0


POSES = st.tuples(st.floats(-60, 60), st.floats(-60, 60), st.floats(-0.06, 0.06)).map(np.array)


@given(pose=POSES, width=st.integers(40, 170), height=st.integers(40, 130), cell=st.sampled_from((4, 8)))
@MANY
def test_a_cell_is_shown_only_where_all_of_it_lies_in_the_frame(pose: np.ndarray, width: int, height: int, cell: int):
    hidden = outside(pose, (width, height), cell)
    y, x = np.mgrid[:height, :width]
    u, v = np.einsum("ij,jhw->ihw", affine(pose, (width, height)), np.stack([x, y, np.ones_like(x)]))
    inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    # well inside of both: by a rim, a cell, and what the rotation sweeps over
    rim = 12 + cell + abs(pose[2]) * max(width, height)
    well = np.minimum.reduce([u, v, x, y, width - 1 - u, height - 1 - v, width - 1 - x, height - 1 - y]) >= rim
    for row, col in np.ndindex(*hidden.shape):
        part = np.s_[row * cell : (row + 1) * cell, col * cell : (col + 1) * cell]
        whole = part[0].stop <= height and part[1].stop <= width
        assert hidden[row, col] or inside[part].all()
        assert not (hidden[row, col] and whole and well[part].all())


@given(
    dx=st.floats(-2, 2),
    turn=st.floats(-0.01, 0.01),
    gain=st.floats(0.8, 1.2),
    offset=st.floats(-8, 8),
    shade=st.floats(-0.1, 0.1),
    colour=st.booleans(),
    deep=st.booleans(),
)
@FEW
def test_laid_and_lit_like_its_reference_a_frame_equals_it(
    *, dx: float, turn: float, gain: float, offset: float, shade: float, colour: bool, deep: bool
):
    here = 208.0
    kind = {"colour": colour, "deep": deep, "noise": 0.0}
    if colour:
        offset = 0.0
    view = View(dx=dx, turn=turn, gain=gain, offset=offset, shade=shade, **kind)
    reference, seen = (levels(shot(surface(), here, v)) for v in (View(**kind), view))
    if colour:
        # the third channel is the negative of the part: another light than the others'
        reference, seen = reference[:, :, :2].mean(axis=2), seen[:, :, :2].mean(axis=2)
    laid = aligned(seen, pose_of(view, here), np.array([gain, offset, shade, 0.0]))
    middle = np.s_[8:-8, 8:-8]
    assert np.abs(laid[middle].astype(float) - reference[middle]).mean() < 1.5


def test_cells_are_some_eighty_by_sixty_of_a_small_picture():
    assert (160 // cell_size((160, 120)), 320 // cell_size((320, 240))) == (40, 80)
    assert cell_size((1280, 960)) > cell_size((320, 240))
