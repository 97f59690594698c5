"""Tolerance: nothing inside the band, closed forms beyond it, and cells that the frame does not show."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.registration import affine
from models.tolerance import (
    BRIGHT,
    DARK,
    Band,
    Coarse,
    aligned,
    cell_size,
    cells_shown,
    coarse_evidence,
    evidence,
    levels,
)
from tests.models.parts import FEW, MANY, View, pose_of, shot, surface

CELL = 4
UNLIT = np.array([1.0, 0.0, 0.0, 0.0])
KINDS = ("grey", "colour", "deep")


def picture(kind: str = "grey", level: int = 100, size: tuple[int, int] = (80, 60)) -> np.ndarray:
    """One grey, in the levels that comparison works on."""
    full, of = (257, np.uint16) if kind == "deep" else (1, np.uint8)
    pixels = np.full((size[1], size[0]), level * full, of)
    return levels(pixels if kind != "colour" else np.stack([pixels, pixels, pixels], axis=2))


def band(reference: np.ndarray) -> Band:
    return Band.of(reference, CELL)


def compared(made: Band, seen: np.ndarray, threshold: float = 0.0) -> np.ndarray:
    """The evidence; where every cell comes near the threshold, edges that stray are forgiven everywhere."""
    return evidence(made, seen, CELL, np.full_like(made.contrast, threshold))


@given(seed=st.integers(0, 99), width=st.integers(16, 70), height=st.integers(16, 60), colour=st.booleans())
@FEW
def test_the_band_holds_its_reference_and_its_cells_cover_it(seed: int, width: int, height: int, colour: bool):
    shape = (height, width, 3) if colour else (height, width)
    reference = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    made = band(reference)
    assert np.all(made.low <= reference)
    assert np.all(reference <= made.high)
    assert made.contrast.shape == (-(-height // CELL), -(-width // CELL))
    found = compared(made, reference)
    assert found.shape == (*made.contrast.shape, 2)
    assert not found.any()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("polarity", "by"), [(BRIGHT, 30), (DARK, -30)])
def test_a_planted_square_gives_its_own_excess_in_its_own_place(kind: str, polarity: int, by: int):
    seen = picture(kind)
    seen[20:32, 40:52] = 100 + by
    found = compared(band(picture(kind)), seen)
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
    assert compared(band(picture()), seen).max() == pytest.approx(by * side**2 / 36, rel=1e-5)


def test_one_channel_is_enough_in_colour():
    seen = picture("colour")
    seen[20:32, 40:52, 0] += 25
    assert compared(band(picture("colour")), seen)[6, 11, BRIGHT] == pytest.approx(25)


def test_sixteen_bits_say_the_same_as_eight():
    rng = np.random.default_rng(1)
    reference, seen = (rng.integers(60, 120, (60, 80), dtype=np.uint8) for _ in range(2))
    deep = [levels(p.astype(np.uint16) * 257) for p in (reference, seen)]
    eight, sixteen = compared(band(reference), seen), compared(band(deep[0]), deep[1])
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
    assert compared(band(reference), moved).max() <= 1


def test_an_edge_that_moved_further_is_found():
    reference = picture(level=60)
    reference[:, 40:] = 200
    moved = np.roll(reference, 6, axis=1)
    moved[:, :6] = 60
    found = compared(band(reference), moved)
    assert found[:, 10:12, DARK].max() > 40
    assert not found[:, :8].any()


def strayed() -> tuple[Band, np.ndarray]:
    """A long edge that strayed by four pixels, two of which the band allows."""
    reference = picture(level=60)
    reference[:, 40:] = 200
    seen = reference.copy()
    seen[:, 36:40] = 200
    return band(reference), seen


def test_edges_that_stray_are_forgiven_only_where_they_reach_half_the_threshold():
    unforgiven = compared(*strayed(), 900)
    strength = float(unforgiven.max())
    # two pixels of six were added, and two are missing, which weigh less
    assert 140 / 3 < strength < 2 * 140 / 3
    np.testing.assert_array_equal(compared(*strayed(), 2.05 * strength), unforgiven)
    assert compared(*strayed(), 1.95 * strength).max() <= 1


def test_where_one_cell_comes_near_its_threshold_edges_are_forgiven_about_it_and_not_far_from_it():
    made, seen = strayed()
    threshold = np.full_like(made.contrast, 900.0)
    threshold[1, 9] = 50.0
    found = evidence(made, seen, CELL, threshold)[:, :, BRIGHT]
    assert found[:4, 8:11].max() <= 1
    assert found[10:, 8:11].max() > 140 / 3


@pytest.mark.parametrize("kind", KINDS)
def test_a_line_of_three_pixels_is_evidence_whether_it_was_added_or_is_missing(kind: str):
    plain, line = picture(kind), picture(kind)
    line[:, 40:43] += 60
    added, missing = compared(band(plain), line), compared(band(line), plain)
    # three pixels of a box of six, all across the picture
    assert added[:, :, BRIGHT].max() == pytest.approx(30, abs=0.5)
    assert 15 < missing[:, :, DARK].max() < 30
    assert not added[:, :, DARK].any()
    assert not missing[:, :, BRIGHT].any()


WIDE = (320, 240)


def wide(made: np.ndarray, seen: np.ndarray, first: int = 0) -> np.ndarray:
    """The evidence at the coarse scale; all of the picture is seen from the first column of cells on."""
    rows, cols = -(-seen.shape[0] // CELL), -(-seen.shape[1] // CELL)
    return coarse_evidence(Coarse.of(made), seen, CELL, (slice(0, rows), slice(first, cols)))


@given(seed=st.integers(0, 99), width=st.integers(24, 330), height=st.integers(18, 250), colour=st.booleans())
@FEW
def test_the_coarse_band_holds_its_reference(seed: int, width: int, height: int, colour: bool):
    shape = (height, width, 3) if colour else (height, width)
    reference = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    found = wide(reference, reference)
    assert found.shape == (-(-height // CELL), -(-width // CELL), 2)
    assert not found.any()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("polarity", "by"), [(BRIGHT, 30), (DARK, -30)])
def test_what_fills_the_wide_box_gives_all_of_its_excess_and_with_its_sign(kind: str, polarity: int, by: int):
    seen = picture(kind, size=WIDE)
    seen[80:160, 120:200] = 100 + by
    found = wide(picture(kind, size=WIDE), seen)
    assert found[30, 40, polarity] == pytest.approx(30, abs=0.01)
    assert not found[:, :, 1 - polarity].any()


@given(side=st.integers(2, 11).map(lambda n: 2 * n), by=st.integers(10, 100))
@FEW
def test_what_is_smaller_than_the_wide_box_is_diluted_by_its_area(side: int, by: int):
    seen = picture(size=WIDE)
    seen[120 : 120 + side, 160 : 160 + side] += by
    # 13 pixels at half the size
    assert wide(picture(size=WIDE), seen).max() == pytest.approx(by * side**2 / 26**2, rel=1e-5)


def test_an_edge_that_strayed_by_six_pixels_is_nothing_at_the_coarse_scale():
    reference = picture(level=60, size=WIDE)
    reference[:, 160:] = 200
    assert not wide(reference, np.roll(reference, 6, axis=1)).any(where=np.arange(80)[None, :, None] > 6)


def test_at_the_coarse_scale_sixteen_bits_say_the_same_as_eight():
    rng = np.random.default_rng(1)
    pair = [cv2.GaussianBlur(rng.uniform(0, 255, (240, 320)), (0, 0), 6) for _ in range(2)]
    reference, seen = (np.clip(128 + 8 * (p - 128), 0, 255).astype(np.uint8) for p in pair)
    deep = [levels(p.astype(np.uint16) * 257) for p in (reference, seen)]
    eight, sixteen = wide(reference, seen), wide(*deep)
    np.testing.assert_allclose(eight, sixteen, atol=0.6)
    assert eight.max() > 10


def test_nothing_is_said_at_the_coarse_scale_where_the_box_reaches_into_what_is_hidden():
    seen = picture(size=WIDE) + np.uint8(30)
    found = wide(picture(size=WIDE), seen, first=20)[:, :, BRIGHT]
    # six pixels at half the size are three cells
    assert not found[:, :23].any()
    assert not found[:, 77:].any()
    assert (found[3:57, 23:77] == 30).all()


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
    hidden = np.ones((-(-height // cell), -(-width // cell)), bool)
    hidden[cells_shown(pose, (width, height), cell)] = False
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
