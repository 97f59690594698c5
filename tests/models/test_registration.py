"""Registration: poses and light that were put in come out, and nothing else moves them."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.registration import (
    NO_LIGHT,
    STEPS_FAR,
    Grid,
    Prior,
    Registered,
    Template,
    affine,
    choose_points,
    compose,
    full_pose,
    register,
    scan,
    smooth,
)
from tests.models.parts import FEW, MANY, View, pose_of, shot, surface

HERE = 200.0
LOOSE = Prior(np.zeros(3), np.diag([1 / 9, 1 / 9, 1 / 0.02**2]), NO_LIGHT, np.diag([16, 1 / 900, 50, 50]))
"""Three pixels, a degree, a quarter of the lamp."""


def template_of(picture: np.ndarray) -> Template:
    smoothed = smooth(picture)
    return Template.of(smoothed, choose_points(smoothed))


def registered(view: View, prior: Prior = LOOSE, spoilt: tuple[slice, slice] | None = None) -> Registered:
    """A view of surface 1, laid on the picture that a straight part gives; `spoilt` is painted white."""
    seen = shot(surface(), HERE, view)
    if spoilt is not None:
        seen[spoilt] = 255
    return register(template_of(shot(surface(), HERE)), smooth(seen), prior, STEPS_FAR)


def homogeneous(pose: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    return np.vstack([affine(pose, size), [0, 0, 1]])


POSES = st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-0.5, 0.5)).map(np.array)


@given(a=POSES, b=POSES, width=st.integers(1, 900), height=st.integers(1, 700))
@MANY
def test_a_composed_pose_is_the_composition_of_the_maps(a: np.ndarray, b: np.ndarray, width: int, height: int):
    size = (width, height)
    wanted = homogeneous(a, size) @ homogeneous(b, size)
    np.testing.assert_allclose(homogeneous(compose(a, b), size), wanted, atol=1e-9)


@given(pose=POSES)
@MANY
def test_the_pose_turns_about_the_middle_of_the_picture(pose: np.ndarray):
    middle = np.array([79.5, 59.5, 1.0])
    np.testing.assert_allclose(affine(pose, (160, 120)) @ middle, middle[:2] + pose[:2], atol=1e-9)


@given(
    dx=st.floats(-2.5, 2.5),
    dy=st.floats(-2.5, 2.5),
    turn=st.floats(-0.012, 0.012),
    gain=st.floats(0.8, 1.2),
    offset=st.floats(-10, 10),
    shade=st.floats(-0.08, 0.08),
)
@FEW
def test_shift_rotation_and_light_are_found_to_a_sixth_of_a_pixel_in_the_middle(
    *, dx: float, dy: float, turn: float, gain: float, offset: float, shade: float
):
    view = View(dx=dx, dy=dy, turn=turn, gain=gain, offset=offset, shade=shade, seed=1)
    found = registered(view)
    wanted = pose_of(view, HERE)
    assert np.abs(found.pose[:2] - wanted[:2]).max() < 0.16
    # half a pixel in the corners
    assert 100 * abs(found.pose[2] - turn) < 0.5
    # gain and offset are told apart by contrast only; together they give the grey level of the picture
    assert abs(found.light[0] - gain) < 0.06
    assert abs(found.light[0] * 110 + found.light[1] - gain * 110 - offset) < 2
    assert abs(found.light[2] - shade) < 0.02
    assert found.correlation > 0.95


def test_a_rotation_under_another_lamp_is_found_to_a_quarter_of_a_pixel_in_the_corners():
    found = registered(View(turn=-0.0109, gain=0.875, seed=1))
    assert 100 * abs(found.pose[2] + 0.0109) < 0.25


@pytest.mark.parametrize("where", [(20, 20), (60, 45), (110, 80)])
@pytest.mark.parametrize("side", [12, 32])
def test_a_bright_blob_does_not_move_it(where: tuple[int, int], side: int):
    view = View(dx=1.3, dy=-0.8, turn=0.004)
    blob = slice(where[1], where[1] + side), slice(where[0], where[0] + side)
    clean, spoilt = registered(view), registered(view, spoilt=blob)
    assert np.abs(spoilt.pose[:2] - clean.pose[:2]).max() < 0.1
    assert spoilt.light[0] == pytest.approx(clean.light[0], abs=0.03)


def test_without_texture_it_falls_back_on_the_prior():
    flat = np.full((120, 160), 90, np.uint8)
    prior = Prior(np.array([1.5, -2.0, 0.01]), LOOSE.pose_precision, NO_LIGHT, LOOSE.light_precision)
    found = register(template_of(flat), smooth(flat), prior)
    np.testing.assert_allclose(found.pose, prior.pose, atol=1e-6)
    np.testing.assert_allclose(np.linalg.inv(found.covariance), LOOSE.pose_precision, rtol=0.01, atol=1e-6)


def test_along_stripes_it_falls_back_on_the_prior_and_across_it_measures():
    across = np.arange(160, dtype=np.float32)
    stripes, moved = (np.tile(120 + 40 * np.sin((across - shift) / 5), (120, 1)).astype(np.uint8) for shift in (0, 1.2))
    prior = Prior(np.array([0.0, 2.0, 0.0]), np.diag([0.1, 0.1, 1e6]), NO_LIGHT, LOOSE.light_precision)
    found = register(template_of(stripes), smooth(moved), prior, STEPS_FAR)
    assert found.pose[0] == pytest.approx(1.2, abs=0.1)
    assert found.pose[1] == pytest.approx(2.0, abs=0.01)
    assert found.covariance[1, 1] > 100 * found.covariance[0, 0]


def test_a_prior_that_is_certain_is_kept():
    certain = Prior(np.array([0.5, 0.5, 0.0]), np.diag([1e9, 1e9, 1e12]), NO_LIGHT, LOOSE.light_precision)
    found = registered(View(dx=2, dy=1), certain)
    np.testing.assert_allclose(found.pose, certain.pose, atol=1e-3)


def test_pictures_four_times_as_large_are_laid_to_the_same_fraction():
    view, wide = View(dx=1.6, dy=-1.1, turn=0.003, size=(320, 240)), (1280, 960)
    part = surface(3, 440, 400)
    pictures = [shot(part, HERE, v) for v in (View(size=(320, 240)), view)]
    reference, seen = (cv2.resize(p, wide, interpolation=cv2.INTER_CUBIC) for p in pictures)
    found = register(template_of(reference), smooth(seen), LOOSE, STEPS_FAR)
    wanted = pose_of(view, HERE)
    assert np.abs(full_pose(found.pose, wide)[:2] - 4 * wanted[:2]).max() < 0.4
    assert abs(found.pose[2] - wanted[2]) < 0.001


def test_a_picture_that_lies_beside_the_reference_agrees_with_nothing():
    template = template_of(shot(surface(), HERE))
    beside = Prior(np.array([400.0, 0.0, 0.0]), np.diag([1e6] * 3), NO_LIGHT, LOOSE.light_precision)
    found = register(template, smooth(shot(surface(), HERE)), beside)
    assert found.correlation < 0
    assert found.residual == np.inf


def test_another_part_agrees_less_than_the_same_one():
    template = template_of(shot(surface(), HERE))
    same, other = (register(template, smooth(shot(surface(i), HERE, View(seed=2))), LOOSE) for i in (1, 2))
    assert same.correlation > 0.95
    assert other.correlation < 0.6


def test_the_picture_looked_at_is_not_changed():
    seen = smooth(shot(surface(), HERE, View(dx=1)))
    before = seen.copy()
    register(template_of(shot(surface(), HERE)), seen, LOOSE)
    np.testing.assert_array_equal(seen, before)


@given(dx=st.floats(-4, 4), spoilt=st.booleans())
@FEW
def test_a_scan_agrees_best_at_the_pose_close_to_the_true_one(dx: float, spoilt: bool):
    seen = shot(surface(), HERE, View(dx=dx))
    if spoilt:
        seen[40:64, 60:84] = 255
    poses = np.zeros((17, 3))
    poses[:, 0] = np.linspace(-4, 4, 17)
    agreement = scan(template_of(shot(surface(), HERE)), smooth(seen), poses, NO_LIGHT)
    assert abs(poses[int(agreement.argmax()), 0] - dx) < 0.75
    assert agreement.max() > 0.8


def test_a_scan_beside_the_picture_agrees_with_nothing():
    poses = np.array([[0.0, 0.0, 0.0], [500.0, 0.0, 0.0]])
    here, beside = scan(template_of(shot(surface(), HERE)), smooth(shot(surface(), HERE)), poses, NO_LIGHT)
    assert here > 0.95
    assert beside < 0


@given(width=st.integers(16, 400), height=st.integers(16, 300), seed=st.integers(0, 99))
@FEW
def test_the_points_differ_and_have_neighbours_on_every_side(width: int, height: int, seed: int):
    picture = np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)
    points = Grid.over((width, height)).points(choose_points(picture))
    row, col = np.divmod(points, width)
    assert len(set(points.tolist())) == len(points) > 0
    assert row.min() >= 1
    assert row.max() < height - 1
    assert col.min() >= 1
    assert col.max() < width - 1
