"""The optics of the simulated camera against closed forms: parallax, projection, shapes."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.cameras.simulated.canvas import Canvas, Place
from inspector.cameras.simulated.render import DISTANCE, Pose, Renderer, project
from inspector.cameras.simulated.shapes import Box, Disc, Hexagon, Ring, Shape
from inspector.cameras.simulated.surface import Surface

SIZE = (320, 240)
COORDINATE = st.floats(-40, 40)


def centre_seen(height: float, pose: Pose) -> np.ndarray:
    """Where a white dot at (480, 260), on a plateau of a height, is seen."""
    canvas = Canvas.blank(1.0, (0.05, 0.05, 0.05))
    if height:
        canvas.lift(Place(480, 260), Disc(36), height)
    canvas.paint(Place(480, 260), Disc(7), (0.9, 0.9, 0.9), 0.0)
    image = Renderer(Surface.of(canvas, colour=False), SIZE, pose.angle).picture(pose)
    weight = np.where(image > 90, image, 0)
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


@pytest.mark.parametrize("height", [-12.0, 0.0, 10.0, 25.0])
def test_a_raised_dot_moves_faster_than_the_ground_as_its_height_asks(height: float) -> None:
    left, right = (centre_seen(height, Pose(480 + dx, 260)) for dx in (-90.0, 90.0))
    np.testing.assert_allclose(left - right, [180 * DISTANCE / (DISTANCE - height), 0], atol=0.15)


@pytest.mark.parametrize("height", [0.0, 20.0])
@pytest.mark.parametrize("pose", [Pose(480, 260), Pose(400, 200), Pose(530, 300, radians(8))])
def test_what_is_projected_is_where_it_is_seen(height: float, pose: Pose) -> None:
    expected = project(pose, 1.0, SIZE, np.array([[480.0, 260.0, height]]))[0]
    np.testing.assert_allclose(centre_seen(height, pose), expected, atol=0.2)


def test_the_lamp_travels_with_the_camera_so_a_wall_changes_its_brightness() -> None:
    canvas = Canvas.blank(1.0, (0.4, 0.4, 0.4))
    canvas.lift(Place(480, 260), Box(60, 60), 12)
    surface = Surface.of(canvas, colour=False)
    walls = []
    for x in (420.0, 540.0):
        image = Renderer(surface, SIZE).picture(Pose(x, 260))
        column, row = np.rint(project(Pose(x, 260), 1.0, SIZE, np.array([[453.0, 260.0, 5.4]]))[0]).astype(int)
        walls.append(float(image[row, column]))
    assert abs(walls[0] - walls[1]) > 5


def test_a_wall_facing_the_lamp_is_brighter_than_one_facing_away() -> None:
    canvas = Canvas.blank(1.0, (0.4, 0.4, 0.4))
    canvas.lift(Place(480, 260), Box(60, 60), 12)
    image = Renderer(Surface.of(canvas, colour=False), SIZE).picture(Pose(480, 260))
    points = np.array([[480.0, 233.0, 5.4], [480.0, 287.0, 5.4]])
    (x0, y0), (x1, y1) = np.rint(project(Pose(480, 260), 1.0, SIZE, points)).astype(int)
    assert image[y0, x0] > 1.5 * image[y1, x1]


def test_the_lens_darkens_the_corners_of_an_even_ground() -> None:
    canvas = Canvas.blank(1.0, (0.4, 0.4, 0.4))
    image = Renderer(Surface.of(canvas, colour=False), SIZE).picture(Pose(480, 260))
    corners = image[[0, 0, -1, -1], [0, -1, 0, -1]]
    assert corners.mean() < 0.93 * image[120, 160]


@pytest.mark.parametrize(
    ("shape", "point", "distance"),
    [
        (Disc(5), (3.0, 4.0), 0.0),
        (Disc(5), (0.0, 9.0), 4.0),
        (Box(10, 4), (8.0, 6.0), 5.0),
        (Box(10, 4), (0.0, 0.0), -2.0),
        (Box(10, 4, 2), (5.0, 2.0), 2 * 2**0.5 - 2),
        (Hexagon(6), (7.0, 0.0), 1.0),
        (Hexagon(6), (0.0, 0.0), -6.0),
        (Ring(3, 7), (5.0, 0.0), -2.0),
        (Ring(3, 7), (0.0, 1.0), 2.0),
    ],
)
def test_shapes_know_how_far_their_outline_is(shape: Shape, point: tuple[float, float], distance: float) -> None:
    found = shape.distance(np.float32([point[0]]), np.float32([point[1]]))
    np.testing.assert_allclose(found, [distance], atol=1e-5)


@given(COORDINATE, COORDINATE, COORDINATE, COORDINATE)
def test_no_wall_is_steeper_than_its_slope(x0: float, y0: float, x1: float, y1: float) -> None:
    """Distances change no faster than one per unit; the renderer's fixed point stands on that."""
    x, y = np.float32([x0, x1]), np.float32([y0, y1])
    for shape in (Disc(9), Box(20, 8, 3), Hexagon(10), Ring(4, 12)):
        a, b = shape.distance(x, y)
        assert abs(a - b) <= np.hypot(x[1] - x[0], y[1] - y[0]) + 1e-4


@given(st.floats(-180, 180), st.floats(-20, 20), st.floats(-20, 20))
def test_a_place_within_a_turned_place_keeps_its_distance(angle: float, dx: float, dy: float) -> None:
    place = Place(100, 50, angle).at(dx, dy)
    assert np.hypot(place.x - 100, place.y - 50) == pytest.approx(np.hypot(dx, dy), abs=1e-9)
