"""Excess: what was added and what is missing is found, however thin; what only strayed is nothing, or forgiven."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.excess import BRIGHT, DARK, Excess, band, strongest
from models.patches import Patches
from models.tolerance import levels
from tests.models.parts import FEW, MANY

KINDS = ("grey", "colour", "deep")
GROUND = 100


def flat(kind: str = "grey", level: int = GROUND, size: tuple[int, int] = (90, 90)) -> np.ndarray:
    """One grey, in the levels that comparison works on."""
    full, of = (257, np.uint16) if kind == "deep" else (1, np.uint8)
    pixels = np.full((size[1], size[0]), level * full, of)
    return levels(pixels if kind != "colour" else np.stack([pixels, pixels, pixels], axis=2))


def blobs(seed: int, count: int = 6) -> np.ndarray:
    """One grey with rectangles of other greys on it."""
    rng, drawn = np.random.default_rng(seed), flat()
    for x, y, width, height, level in rng.integers((0, 0, 2, 2, 0), (85, 85, 30, 30, 256), (count, 5)):
        drawn[y : y + height, x : x + width] = level
    return drawn


def asked(reference: np.ndarray, seen: np.ndarray) -> Excess:
    return Excess.of(reference, band(reference), seen)


def whole(reference: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Bright and dark, nothing forgiven."""
    return np.stack([asked(reference, seen).whole(polarity) for polarity in (BRIGHT, DARK)])


def left(reference: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Bright and dark, edges that stray forgiven everywhere."""
    return np.stack([asked(reference, seen).forgiven(polarity) for polarity in (BRIGHT, DARK)])


@given(seed=st.integers(0, 999), dx=st.integers(-2, 2), dy=st.integers(-2, 2))
@MANY
def test_the_band_holds_the_picture_moved_by_up_to_two_pixels_and_nothing_that_is_not_there(
    seed: int, dx: int, dy: int
):
    picture = np.random.default_rng(seed).integers(0, 256, (30, 40), dtype=np.uint8)
    dark, bright = band(picture)
    moved, inner = np.roll(picture, (dy, dx), axis=(0, 1)), np.s_[2:-2, 2:-2]
    assert np.all(dark[inner] <= moved[inner])
    assert np.all(moved[inner] <= bright[inner])
    y, x = 10 + dy, 20 + dx
    about = picture[y - 2 : y + 3, x - 2 : x + 3]
    assert (dark[y, x], bright[y, x]) == (about.min(), about.max())


def test_the_strongest_channel_speaks_for_a_pixel_and_grey_for_itself():
    colour = np.random.default_rng(1).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    np.testing.assert_array_equal(strongest(colour), colour.max(axis=2))
    np.testing.assert_array_equal(strongest(colour[:, :, 1]), colour[:, :, 1])


@given(seed=st.integers(0, 999), dx=st.integers(-2, 2), dy=st.integers(-2, 2), deep=st.booleans())
@MANY
def test_what_strays_by_up_to_two_pixels_is_nothing(seed: int, dx: int, dy: int, deep: bool):
    reference = blobs(seed).astype(np.float32 if deep else np.uint8)
    moved = np.roll(reference, (dy, dx), axis=(0, 1))
    # what the roll brings in from the other side is new there
    inner = np.s_[:, 4:-4, 4:-4]
    assert not whole(reference, moved)[inner].any()


def lined(kind: str, width: int, by: int, across: bool) -> np.ndarray:
    """Ground with a line through all of it, that much brighter."""
    drawn = flat(kind)
    drawn[np.s_[40 : 40 + width] if across else np.s_[:, 40 : 40 + width]] = GROUND + by
    return drawn


def on_line(found: np.ndarray, width: int, across: bool) -> np.ndarray:
    return found[np.s_[40 : 40 + width] if across else np.s_[:, 40 : 40 + width]]


LINES = pytest.mark.parametrize(
    ("kind", "across", "width", "by"),
    [("grey", False, 3, 80), ("grey", True, 3, -80), ("colour", True, 3, 60), ("deep", False, 3, -60)]
    + [("grey", False, width, 80) for width in (1, 2, 4, 5, 8)],
)


@LINES
def test_a_thin_line_that_was_added_is_found_whole(kind: str, across: bool, width: int, by: int):
    bright, dark = left(flat(kind), lined(kind, width, by, across))
    found, other = (bright, dark) if by > 0 else (dark, bright)
    np.testing.assert_allclose(on_line(found, width, across), abs(by), atol=1e-3)
    assert np.count_nonzero(found) == on_line(found, width, across).size
    assert not other.any()


@LINES
def test_a_thin_line_that_is_missing_is_found_where_it_was(kind: str, across: bool, width: int, by: int):
    bright, dark = left(lined(kind, width, by, across), flat(kind))
    # a bright line that is gone leaves its place too dark
    found, other = (dark, bright) if by > 0 else (bright, dark)
    assert on_line(found, width, across).min() > abs(by) / 2
    assert np.count_nonzero(found) == on_line(found, width, across).size
    assert not other.any()


@given(one=st.integers(0, 999), other=st.integers(1000, 1999))
@MANY
def test_what_is_missing_is_what_the_pictures_swapped_would_add_and_weighs_less_by_the_same_share_everywhere(
    one: int, other: int
):
    reference, seen = (blobs(seed).astype(np.float32) for seed in (one, other))
    asked_so, swapped = asked(reference, seen), asked(seen, reference)
    missing, added = asked_so.planes[2:], swapped.planes[1::-1]
    share = missing.max() / added.max()
    assert 0.5 < share < 1
    np.testing.assert_allclose(missing, share * added, rtol=1e-5)


def test_a_line_that_was_added_weighs_more_than_one_that_is_missing():
    plain, line = flat(), lined("grey", 3, 80, False)
    assert whole(plain, line).max() > whole(line, plain).max() > whole(plain, line).max() / 2


def test_a_long_edge_that_strays_by_four_pixels_is_forgiven_and_a_notch_in_it_is_not():
    reference = flat(level=60)
    reference[:, 40:] = 200
    strayed, notched = reference.copy(), reference.copy()
    strayed[:, 36:40] = 200
    notched[28:34, 36:40] = 200
    assert whole(reference, strayed)[BRIGHT].max() == 140
    assert left(reference, strayed).max() <= 1
    assert left(reference, notched)[BRIGHT, 28:34, 36:38].min() == 140


def test_an_edge_that_strays_by_six_pixels_is_not_forgiven():
    reference = flat(level=60)
    reference[:, 40:] = 200
    moved = flat(level=60)
    moved[:, 46:] = 200
    # the band allows two of them; the rest is too thick for an edge that strays, and stays to its rims
    assert left(reference, moved)[DARK, :, 42:46].min() == 140


def grooved(kind: str, width: int, at: int = 40, level: int = 60, across: bool = False) -> np.ndarray:
    """A bright picture with a dark groove through all of it."""
    drawn = flat(kind, 200)
    drawn[np.s_[at : at + width] if across else np.s_[:, at : at + width]] = levels_of(kind, level)
    return drawn


def levels_of(kind: str, level: int) -> float:
    return float(flat(kind, level, (1, 1)).max())


GROOVES = pytest.mark.parametrize(
    ("kind", "across", "width"), [("grey", False, 5), ("grey", True, 6), ("colour", False, 7), ("deep", True, 7)]
)


@GROOVES
@pytest.mark.parametrize("by", [-4, -3, 3, 4])
def test_a_groove_that_strayed_is_forgiven(kind: str, across: bool, width: int, by: int):
    reference, strayed = (grooved(kind, width, at, across=across) for at in (40, 40 + by))
    assert whole(reference, strayed).max() > 70
    assert left(reference, strayed).max() <= 1


@GROOVES
@pytest.mark.parametrize("level", [200, 130])
def test_a_groove_that_is_gone_or_half_gone_is_not_forgiven(kind: str, across: bool, width: int, level: int):
    bright, dark = left(grooved(kind, width, across=across), grooved(kind, width, level=level, across=across))
    groove = bright if across else np.moveaxis(bright, 1, 0)
    # the band may reach two pixels over either edge
    np.testing.assert_allclose(groove[42 : 38 + width], level - 60, atol=1e-3)
    assert groove[40 : 40 + width].min() > 0
    assert not dark.any()


@given(seed=st.integers(0, 999))
@MANY
def test_what_is_forgiven_is_never_more_than_what_there_is(seed: int):
    reference, seen = blobs(seed), blobs(seed + 1000)
    (low, high), (dark, bright) = ([end.astype(int) for end in band(picture)] for picture in (reference, seen))
    there, kept = whole(reference, seen).astype(int), left(reference, seen).astype(int)
    assert np.all(kept <= there)
    assert np.all(there[BRIGHT] <= np.maximum(0, np.maximum(seen - high, dark - reference)))
    assert np.all(there[DARK] <= np.maximum(0, np.maximum(low - seen, reference - bright)))


@given(seed=st.integers(0, 999))
@FEW
def test_sixteen_bits_say_the_same_as_eight_within_rounding(seed: int):
    reference, seen = blobs(seed), blobs(seed + 1000)
    deep = left(reference.astype(np.float32), seen.astype(np.float32))
    np.testing.assert_allclose(left(reference, seen), deep, atol=1)


@given(seed=st.integers(0, 999), cells=st.integers(1, 2**31))
@MANY
def test_some_cells_are_forgiven_as_the_whole_picture_is(seed: int, cells: int):
    reference = np.hstack([np.vstack([blobs(seed), blobs(seed + 1)]), np.vstack([blobs(seed + 2), blobs(seed + 3)])])
    seen = cv2.dilate(np.roll(reference, 3, axis=1), np.ones((2, 2), np.uint8))
    seen[20:26, 50:58] = 255
    asked_so = asked(reference, seen)
    strong = np.zeros((45, 45), bool)
    strong.flat[np.random.default_rng(cells).integers(0, strong.size, 3)] = True
    patches = Patches.about(strong.view(np.uint8), 4, seen.shape)
    rim = np.zeros((45, 45), bool)
    rim[2:-2, 2:-2] = True
    for polarity in (BRIGHT, DARK):
        every, some = asked_so.forgiven(polarity), asked_so.forgiven(polarity, patches)
        cells = patches.put(some[::2, ::2].astype(np.float32), np.zeros((45, 45), np.float32), 4)
        np.testing.assert_array_equal(cells[strong & rim], every[::4, ::4][strong & rim])


@pytest.mark.parametrize("kind", KINDS)
def test_the_pictures_asked_about_are_not_changed(kind: str):
    reference, seen = grooved(kind, 5), grooved(kind, 5, 43)
    before = reference.copy(), seen.copy()
    left(reference, seen)
    np.testing.assert_array_equal(reference, before[0])
    np.testing.assert_array_equal(seen, before[1])


@pytest.mark.parametrize("shape", [(1200, 1000, 3), (1501, 1600)])
def test_a_large_picture_goes_strip_by_strip_and_no_strip_shows(
    shape: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
):
    rng = np.random.default_rng(3)
    reference, seen = rng.integers(0, 256, (2, *shape), dtype=np.uint8)
    stripped: np.ndarray = Excess.of(reference, band(reference), seen).planes
    monkeypatch.setattr("models.excess._CACHED", 1 << 40)
    whole: np.ndarray = Excess.of(reference, band(reference), seen).planes
    np.testing.assert_array_equal(stripped, whole)
