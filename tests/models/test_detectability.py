"""The map: what it says of a place, along the sweep, over the picture; closed forms on a map made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from models.defects import Kind
from models.detectability import Detectability, expected_caught, expected_size
from models.sites import Site

PLACES, STEP, SIZE = 101, 10.0, (100, 80)
BLIND = slice(31, 37)
"""Columns of sites where nothing is caught; `POOR` ones need 9 px, all others 3; at the rim always none."""
POOR = slice(60, 66)


def made() -> Detectability:
    """The picture moves 10 pixels a place; a column of four sites a place, the outermost at the rim."""
    way = np.column_stack([-STEP * np.arange(PLACES), np.zeros(PLACES)])
    ys = (2.0, 26.0, 52.0, 78.0)
    sites = tuple(
        Site(i, 50.0, y, max(0, i - 5), min(PLACES, i + 5), min(y, 80 - y)) for i in range(PLACES) for y in ys
    )
    sizes = np.full((PLACES, len(ys)), 3.0)
    sizes[POOR], sizes[BLIND] = 9.0, np.inf
    sizes[:, [0, 3]] = np.inf
    smallest = np.stack([[sizes.ravel() * 2, sizes.ravel()], np.full((2, len(sites)), np.nan)])
    return Detectability(
        sites,
        np.linspace(0, 1, PLACES),
        way,
        SIZE,
        (Kind.SPOT, Kind.ADDED),
        (30.0, 60.0),
        (3.0, 6.0, 9.0, 18.0),
        smallest,
        np.zeros(len(sites)),
        15.0,
        1.0,
        0,
        0.0,
    )


@pytest.mark.parametrize(
    ("s", "y", "size", "contrast", "caught"),
    [
        (0.1, 30, 3.0, 60, True),
        (0.1, 30, 2.9, 60, False),
        (0.1, 30, 3.0, 59, False),
        (0.1, 30, 6.0, 59, True),
        (0.1, 30, 99.0, 29, False),
        (0.1, 4, 99.0, 60, False),
        (0.33, 30, 99.0, 60, False),
        (0.63, 30, 8.9, 60, False),
        (0.63, 30, 9.0, 60, True),
    ],
)
def test_what_is_expected_at_a_place(s: float, y: float, size: float, contrast: float, caught: bool) -> None:
    assert expected_caught(made(), s, 50, y, size=size, contrast=contrast, kind=Kind.SPOT) is caught


def test_the_worst_site_about_decides_and_another_frame_sees_the_same_site() -> None:
    assert expected_size(made(), 0.58, 58, 30, contrast=60, kind=Kind.SPOT) == 9
    # ten pixels a place: what lies at x = 10 in the picture of s = 0.6 was in the middle four places before
    assert expected_size(made(), 0.64, 10, 30, contrast=60, kind=Kind.SPOT) == 9
    assert expected_size(made(), 0.64, 90, 30, contrast=60, kind=Kind.SPOT) == 3


def test_where_nothing_of_the_kind_could_be_tried_spots_answer() -> None:
    assert expected_size(made(), 0.1, 50, 30, contrast=60, kind=Kind.ADDED) == 3


def test_where_there_is_no_site_nothing_is_promised() -> None:
    assert expected_size(made(), 0.1, 50, 300, contrast=60, kind=Kind.SPOT) == np.inf


def test_weak_stretches_are_named() -> None:
    found = made()
    assert found.usual(Kind.SPOT, 60) == 3
    blind, poor = found.weak(Kind.SPOT, 60)
    assert (blind.size, poor.size) == (np.inf, 9)
    assert (blind.s_start, blind.s_end) == pytest.approx((0.31, 0.365), abs=0.011)
    assert (poor.s_start, poor.s_end) == pytest.approx((0.60, 0.655), abs=0.011)
    assert found.weak(Kind.ADDED, 60) == ()


def test_the_rim_is_told_over_the_picture_and_left_out_along_the_sweep() -> None:
    usual, worst = made().over_picture(Kind.SPOT, 60, cols=10)
    assert np.isinf(usual[[0, -1]]).all()
    assert (usual[3:5] == 3).all()
    assert np.isinf(worst).all()
    assert np.isfinite(made().along(Kind.SPOT, 60).worst[:25]).all()
    assert np.isnan(made().over_picture(Kind.ADDED, 60)).all()
