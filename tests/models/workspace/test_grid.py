"""Grid: pictures in any order are found again, and what makes no grid is refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.errors import LearningError
from models.workspace.grid import Grid, Parameter, check_parameters
from tests.models.parts import MANY

XY = (Parameter("x"), Parameter("y"))


@given(counts=st.lists(st.integers(2, 5), min_size=1, max_size=4), seed=st.integers(0, 2**31))
@MANY
def test_every_place_of_a_grid_has_its_picture(counts: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    axes = [np.cumsum(rng.uniform(0.1, 1, count)) for count in counts]
    q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    mixed = rng.permutation(len(q))
    grid = Grid.of("part", q[mixed], [Parameter(f"q{i}") for i in range(len(axes))])
    for axis, found in zip(axes, grid.axes, strict=True):
        np.testing.assert_array_equal(axis, found)
    np.testing.assert_array_equal(q[mixed][grid.order.reshape(-1)], q)


def test_what_is_nearly_the_same_value_is_one() -> None:
    x = np.array([0.1 + 0.2, 0.3, 1.0, 1.0])
    grid = Grid.of("part", np.stack([x, [0, 1, 0, 1]], axis=1), XY)
    assert [axis.size for axis in grid.axes] == [2, 2]


@pytest.mark.parametrize(
    ("q", "said"),
    [
        (
            [[0, 0], [0, 1], [1, 0]],
            "object part: no picture at x 1, y 1; a grid of 2 x 2 needs all of its 4, there are 3",
        ),
        ([[0, 0], [0, 1], [1, 0], [1, 1], [1, 0]], "object part: two pictures at x 1, y 0; allowed is one"),
        ([[0, 0], [0, 1]], "object part: x is 0 everywhere; needed are two values or more"),
        ([[0, 0], [1, np.nan]], "object part: y is nan; allowed is a number"),
    ],
)
def test_what_makes_no_grid_is_refused_by_name(q: list[list[float]], said: str) -> None:
    with pytest.raises(LearningError) as error:
        Grid.of("part", np.array(q, np.float64), XY)
    assert str(error.value) == said


def test_a_full_turn_is_the_same_place_as_none() -> None:
    turn = [Parameter("angle_deg", 360)]
    with pytest.raises(LearningError, match="two pictures at angle_deg 0"):
        Grid.of("cup", np.array([[0.0], [90], [180], [270], [360]]), turn)
    grid = Grid.of("cup", np.array([[-90.0], [90], [180], [-1e-9]]), turn)
    np.testing.assert_allclose(grid.axes[0], [0, 90, 180, 270], atol=1e-6)


@pytest.mark.parametrize(
    "parameters", [[], [Parameter("x")] * 2, [Parameter(str(i)) for i in range(5)], [Parameter("x", 0.0)]]
)
def test_parameters_that_cannot_be_are_refused(parameters: list[Parameter]) -> None:
    with pytest.raises(LearningError, match="allowed"):
        check_parameters(parameters)
