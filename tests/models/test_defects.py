"""Synthetic defects: of the size and the contrast that they say, where they say, as a lens shows them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.defects import Defect, Kind, draw, sharpness
from tests.models.parts import MANY, surface

BLUR = 1.0


def flat(level: float = 100.0, dtype: type = np.uint16) -> np.ndarray:
    """Sixteen bits, so that rounding is nothing."""
    return np.full((80, 96), level * (257 if dtype is np.uint16 else 1), dtype)


@MANY
@given(x=st.floats(30, 60), y=st.floats(30, 50), size=st.floats(2, 20), bright=st.booleans())
def test_a_spot_has_its_area_its_contrast_and_its_place(x: float, y: float, size: float, bright: bool) -> None:
    picture = flat()
    draw(picture, x, y, Defect(Kind.SPOT, size, 60, bright), BLUR)
    change = picture / 257 - 100
    assert change.sum() == pytest.approx((60 if bright else -60) * np.pi * size**2 / 4, rel=0.06)
    rows, cols = np.mgrid[:80, :96]
    assert (change * cols).sum() / change.sum() == pytest.approx(x, abs=0.15)
    assert (change * rows).sum() / change.sum() == pytest.approx(y, abs=0.15)


def test_the_lens_takes_contrast_from_what_is_small_and_nothing_from_what_is_large() -> None:
    peaks: list[float] = []
    for size in (1, 2, 4, 8, 16):
        picture = flat()
        draw(picture, 48, 40, Defect(Kind.SPOT, size, 60, True), BLUR)
        peaks.append(float(picture.max() / 257 - 100))
    assert peaks == sorted(peaks)
    # a disc seen through a Gaussian lens, in its middle
    assert peaks[:2] == pytest.approx([60 * (1 - np.exp(-(size**2) / 8)) for size in (1, 2)], abs=2)
    assert peaks[-1] == pytest.approx(60, abs=0.1)


def test_a_line_is_a_tenth_of_the_width_long() -> None:
    picture = flat()
    draw(picture, 48, 40, Defect(Kind.LINE, 2, 60, False), BLUR)
    assert (100 - picture / 257).sum() == pytest.approx(60 * (2 * 9.6 + np.pi), rel=0.06)


@pytest.mark.parametrize("kind", [Kind.ADDED, Kind.MISSING])
def test_material_beside_an_edge_goes_no_further_than_its_neighbour(kind: Kind) -> None:
    picture = flat(60, np.uint8)
    picture[:, 48:] = 150
    before = picture.copy()
    x = 44 if kind is Kind.ADDED else 51
    draw(picture, x, 40, Defect(kind, 12, 200, kind is Kind.ADDED), BLUR)
    assert (picture.min(), picture.max()) == (60, 150)
    changed = np.flatnonzero((picture != before).any(axis=0))
    assert changed.max() < 48 if kind is Kind.ADDED else changed.min() >= 48
    assert picture[40, x] == (150 if kind is Kind.ADDED else 60)


def test_saturated_pixels_stay() -> None:
    picture = flat(255, np.uint8)
    draw(picture, 48, 40, Defect(Kind.SPOT, 12, 120, False), BLUR)
    assert (picture == 255).all()


def test_colour_and_depth_change_nothing() -> None:
    grey = surface()[:80, :96].astype(np.uint8)
    colour, deep = cv2.merge([grey, grey, grey]), grey.astype(np.uint16) * 257
    for kind in Kind:
        defect, seen = Defect(kind, 6, 50, kind is Kind.ADDED), [each.copy() for each in (grey, colour, deep)]
        for each in seen:
            draw(each, 40.3, 41.8, defect, BLUR)
        assert (seen[0] != grey).any()
        assert np.abs(seen[1].astype(int) - seen[0][:, :, None]).max() <= 1
        assert np.abs(seen[2] / 257 - seen[0]).max() <= 1


@given(x=st.floats(-40, 140), y=st.floats(-40, 120), kind=st.sampled_from(Kind))
@MANY
def test_what_reaches_over_the_rim_is_cut(x: float, y: float, kind: Kind) -> None:
    picture = surface()[:80, :96].astype(np.uint8)
    before = picture.copy()
    draw(picture, x, y, Defect(kind, 10, 60, True), BLUR)
    rows, cols = np.nonzero(picture != before)
    assert np.hypot(rows - y, cols - x).max(initial=0) <= 16


@pytest.mark.parametrize("sigma", [0.8, 1.2, 2.0])
def test_the_blur_of_a_lens_is_measured_by_the_sharpest_edges(sigma: float) -> None:
    picture = np.full((120, 160), 60, np.float32)
    picture[40:80, 30:110] = 180
    assert sharpness(cv2.GaussianBlur(picture, (0, 0), sigma)) == pytest.approx(sigma, rel=0.15)
    assert sharpness(np.full((120, 160), 60, np.float32)) is None
