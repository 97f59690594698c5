"""Preparation: pictures become vectors as the docstring promises."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.errors import AppearanceError, PictureError
from models.preparation import Preparation, Window

RNG = np.random.default_rng(3)
GREY = RNG.integers(1, 256, (24, 32), dtype=np.uint8)
COLOUR = RNG.integers(1, 256, (24, 32, 3), dtype=np.uint8)
CONTENTS = ("raw", "smooth", "gradient", "derivatives", "power", "log_power")
MASK = RNG.random((6, 9)) < 0.5


def test_the_whole_picture_is_read_in_raster_order():
    x = Preparation(unit_energy=False).prepare(GREY)
    assert x.dtype == np.float32
    np.testing.assert_allclose(x * 255, GREY.reshape(-1), rtol=1e-6)


def test_sixteen_bits_are_shares_of_their_own_full_scale():
    deep = GREY.astype(np.uint16) * 257
    plain = Preparation(unit_energy=False)
    np.testing.assert_allclose(plain.prepare(deep), plain.prepare(GREY), rtol=1e-6)
    smooth = Preparation(unit_energy=False, content="smooth")
    np.testing.assert_allclose(smooth.prepare(deep), smooth.prepare(GREY), rtol=1e-5)


def test_windows_are_slices_one_after_the_other():
    x = Preparation(windows=(Window(3, 2, 7, 5), Window(20, 10, 4, 6)), unit_energy=False).prepare(GREY)
    expected = np.concatenate([GREY[2:7, 3:10].reshape(-1), GREY[10:16, 20:24].reshape(-1)])
    np.testing.assert_allclose(x * 255, expected, rtol=1e-6)


def test_a_window_of_any_shape_is_a_boolean_index():
    x = Preparation(windows=(Window(3, 2, 9, 6, MASK),), unit_energy=False).prepare(GREY)
    np.testing.assert_allclose(x * 255, GREY[2:8, 3:12][MASK], rtol=1e-6)


def test_windows_of_colour_keep_channels_together():
    x = Preparation(windows=(Window(3, 2, 9, 6, MASK),), unit_energy=False, colour=True).prepare(COLOUR)
    np.testing.assert_allclose(x * 255, COLOUR[2:8, 3:12][MASK].reshape(-1), rtol=1e-6)


def test_a_grey_picture_is_repeated_and_a_colour_one_made_grey():
    coloured = Preparation(unit_energy=False, colour=True).prepare(GREY).reshape(24, 32, 3)
    np.testing.assert_allclose(coloured * 255, np.repeat(GREY[..., None], 3, axis=2), rtol=1e-6)
    greyed = Preparation(unit_energy=False).prepare(COLOUR).reshape(24, 32)
    np.testing.assert_allclose(greyed * 255, COLOUR @ [0.114, 0.587, 0.299], atol=1)


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_scaling_averages_areas(factor: int):
    size = (32 // factor, 24 // factor)
    x = Preparation(size=size, unit_energy=False).prepare(GREY).reshape(size[::-1])
    means = GREY.reshape(size[1], factor, size[0], factor).mean(axis=(1, 3))
    # Each halving rounds to whole grey levels, ties upwards.
    np.testing.assert_allclose(x * 255, means, atol=0.5 * np.log2(factor) + 1e-3)


def test_windows_are_scaled_by_the_factor_of_the_whole_picture():
    window = Window(8, 4, 16, 8)
    x = Preparation(size=(8, 6), windows=(window,), unit_energy=False).prepare(GREY)
    whole = Preparation(size=(8, 6), unit_energy=False).prepare(GREY).reshape(6, 8)
    np.testing.assert_allclose(x, whole[1:3, 2:6].reshape(-1), atol=1e-6)


@given(gain=st.floats(0.2, 5), content=st.sampled_from(CONTENTS))
@settings(max_examples=40, deadline=None)
def test_with_unit_energy_gain_changes_nothing(gain: float, content: str):
    bright = np.rint(GREY.astype(np.float64) * 40)
    pictures = [np.rint(bright * share).astype(np.uint16) for share in (1.0, gain)]
    x, amplified = (Preparation(content=content, size=(16, 12)).prepare(picture) for picture in pictures)
    assert np.linalg.norm(x) == pytest.approx(1, abs=1e-5)
    np.testing.assert_allclose(amplified, x, atol=2e-3)


@pytest.mark.parametrize("content", CONTENTS)
def test_a_black_picture_is_the_zero_vector(content: str):
    preparation = Preparation(content=content)
    x = preparation.prepare(np.zeros((24, 32), np.uint8))
    assert not x.any()
    assert x.shape == (preparation.length((32, 24)),)


@given(dx=st.integers(0, 31), dy=st.integers(0, 23), content=st.sampled_from(("power", "log_power")))
@settings(max_examples=25, deadline=None)
def test_the_power_spectrum_ignores_circular_shifts(dx: int, dy: int, content: str):
    preparation = Preparation(content=content, taper=False)
    shifted = np.roll(GREY, (dy, dx), axis=(0, 1))
    np.testing.assert_allclose(preparation.prepare(shifted), preparation.prepare(GREY), atol=1e-5)


def test_the_power_spectrum_of_a_wave_is_one_line():
    wave = 128 + 100 * np.cos(2 * np.pi * 5 * np.arange(32) / 32)
    picture = np.broadcast_to(np.rint(wave).astype(np.uint8), (24, 32))
    power = Preparation(content="power", taper=False, unit_energy=False).prepare(picture).reshape(24, 17)
    power[0, 0] = 0
    assert np.unravel_index(power.argmax(), power.shape) == (0, 5)
    # |F|^2 / n of a wave of amplitude a is n a^2 / 4.
    assert power[0, 5] == pytest.approx(24 * 32 * (100 / 255) ** 2 / 4, rel=1e-2)


def test_smoothing_is_the_gaussian_of_opencv():
    x = Preparation(content="smooth", sigma=1.5, unit_energy=False).prepare(GREY).reshape(24, 32)
    np.testing.assert_allclose(x, cv2.GaussianBlur(GREY.astype(np.float32) / 255, (11, 11), 1.5), atol=1e-6)


def test_derivatives_of_a_ramp_are_its_slope():
    ramp = (100 + 3 * np.arange(32) + 2 * np.arange(24)[:, None]).astype(np.uint8)
    pair = Preparation(content="derivatives", unit_energy=False).prepare(ramp).reshape(24, 32, 2) * 255
    np.testing.assert_allclose(pair[5:-5, 5:-5], np.broadcast_to([3, 2], (14, 22, 2)), atol=1e-3)
    steepness = Preparation(content="gradient", unit_energy=False, sigma=0).prepare(ramp).reshape(24, 32) * 255
    np.testing.assert_allclose(steepness[5:-5, 5:-5], 13**0.5, atol=1e-3)


@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("size", [None, (16, 12), (13, 10)])
def test_what_lies_under_a_mask_changes_nothing(content: str, size: tuple[int, int] | None):
    ignore = np.zeros((24, 32), np.bool_)
    ignore[5:9, 6:15] = True
    preparation = Preparation(content=content, size=size, ignore=ignore, sigma=0.3)
    other = np.where(ignore, 255 - GREY, GREY)
    x = preparation.prepare(GREY)
    assert x.shape == (preparation.length((32, 24)),)
    if content in ("power", "log_power") and size is not None:
        # Cells that the mask touches are taken as black, so scaling leaves nothing of what is under it.
        assert x.any()
    np.testing.assert_array_equal(preparation.prepare(other), x)


@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("colour", [False, True])
def test_length_is_the_length_of_x(content: str, colour: bool):
    windows = (Window(3, 2, 9, 6, MASK), Window(10, 10, 15, 12))
    preparation = Preparation(windows=windows, content=content, colour=colour, sigma=0.3, size=(31, 23))
    assert preparation.prepare(COLOUR).shape == (preparation.length((32, 24)),)
    assert preparation.bind((32, 24)).length() == preparation.length((32, 24))


def test_a_picture_of_another_size_is_refused_with_both_sizes():
    with pytest.raises(PictureError, match="64x48, learnt were pictures of 32x24"):
        Preparation().bind((32, 24)).prepare(np.zeros((48, 64), np.uint8))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: Preparation(windows=(Window(30, 0, 4, 4),)).bind((32, 24)), r"4x4 at \(30, 0\) does not fit .* 32x24"),
        (lambda: Preparation(ignore=np.ones((4, 4), np.bool_)).bind((32, 24)), "don't-care mask is 4x4"),
        (lambda: Preparation(ignore=np.ones((24, 32), np.bool_)).bind((32, 24)), "leave nothing"),
        (lambda: Preparation(content="edges"), "'edges', allowed are raw"),
        (lambda: Preparation(sigma=-1), "sigma is -1"),
        (lambda: Preparation(size=(0, 4)), "0x4"),
        (lambda: Preparation().length(), "none was given"),
        (lambda: Preparation().prepare(np.zeros((4, 4), np.float32)), "float32, allowed are uint8 and uint16"),
        (lambda: Window(0, 0, 0, 4), "0x4"),
        (lambda: Window(0, 0, 4, 4, np.ones((3, 4), np.bool_)), "its mask has shape"),
        (lambda: Window(0, 0, 4, 4, np.ones((4, 4))), "mask is float64"),
    ],
)
def test_what_cannot_be_prepared_is_refused_with_a_sentence(wrong, said: str):
    with pytest.raises(PictureError, match=said):
        wrong()


@pytest.mark.parametrize("picture", [None, (32, 24)])
def test_what_was_saved_prepares_the_same(picture: tuple[int, int] | None):
    ignore = np.zeros((24, 32), np.bool_)
    ignore[:2] = True
    windows = (Window(3, 0, 9, 6, MASK), Window(10, 10, 15, 12))
    made = Preparation((16, 12), windows, ignore, True, "smooth", 0.5, False, False, picture)
    read = Preparation.from_parts(json.loads(json.dumps(made.to_header())), made.arrays())
    np.testing.assert_array_equal(read.prepare(COLOUR), made.prepare(COLOUR))
    assert read.to_header() == made.to_header()
    assert read.arrays().keys() == made.arrays().keys() == {"ignore", "window0"}


@pytest.mark.parametrize(
    "harm", [{"windows": [[1, 2]]}, {"content": "edges"}, {"sigma": "x"}, {"size": 3}, {"windows": [[0, 0, 99, 99]]}]
)
def test_a_damaged_header_is_refused(harm: dict[str, object]):
    header = Preparation(picture=(32, 24)).to_header() | harm
    with pytest.raises(AppearanceError, match="preparation in the file"):
        Preparation.from_parts(header, {})


def test_masks_cannot_be_written_to_from_outside():
    ignore = np.zeros((24, 32), np.bool_)
    preparation = Preparation(ignore=ignore)
    ignore[:] = True
    assert preparation.ignore is not None
    assert not preparation.ignore.any()
    assert not preparation.ignore.flags.writeable
