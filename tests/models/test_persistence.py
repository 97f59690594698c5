"""Persistence: what is fixed to the part stays, what is fixed to the camera or seen once goes."""

from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.persistence import PLACES, Cells, Sight, persist
from tests.models.parts import FEW

ROWS, COLS, CELL = 15, 20, 4
SHOWN = slice(0, ROWS), slice(0, COLS)
STEP = np.array([-3.0 * CELL, 0.0])
"""Three cells from place to place: further than a sighting is grown."""


def spot(row: int, col: int, score: float = 8.0) -> np.ndarray:
    found = np.zeros((ROWS, COLS, 2), np.float32)
    found[row, col, 0] = score
    return found


def over(scores: Iterable[np.ndarray], step: np.ndarray = STEP, shown: Cells = SHOWN) -> list[np.ndarray]:
    """What is agreed on after each place; the picture moves by `step` pixels from place to place."""
    sights: tuple[Sight, ...] = ()
    agreed = []
    for i, score in enumerate(scores):
        sights, found = persist(sights, score, shown, (float(i), i * step, i * step), CELL)
        agreed.append(found)
    return agreed


def test_what_is_fixed_to_the_part_reaches_its_whole_score():
    agreed = over(spot(7, 18 - 3 * i) for i in range(PLACES))
    peaks = [float(found.max()) for found in agreed]
    assert peaks[-1] == pytest.approx(8.0)
    assert np.unravel_index(agreed[-1].argmax(), agreed[-1].shape) == (7, 18 - 3 * (PLACES - 1), 0)


def test_few_places_demand_more():
    peaks = [float(found.max()) for found in over(spot(7, 18 - 3 * i) for i in range(PLACES))]
    assert np.all(np.diff(peaks) > 0)
    assert 0 < peaks[0] <= 8.0 / 2


def test_what_is_fixed_to_the_camera_vanishes_when_the_picture_moves():
    agreed = over(spot(7, 10) for _ in range(PLACES + 3))
    assert all(found.max() == 0 for found in agreed[1:])


def test_a_single_miss_is_enough_to_doubt_and_a_single_sight_is_not_enough_to_believe():
    seen = [spot(7, 19 - 3 * i, 8.0 if i != 3 else 0.0) for i in range(PLACES)]
    assert over(seen)[-1].max() == 0
    once = [spot(7, 10, 8.0 if i == 4 else 0.0) for i in range(8)]
    assert max(float(found.max()) for found in over(once)) == 0


def test_a_sight_that_strays_by_a_cell_still_agrees():
    agreed = over(spot(7 + i % 2, 18 - 3 * i + i % 2) for i in range(PLACES))
    assert agreed[-1].max() == pytest.approx(8.0)


@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (0, -1), (1, -1)])
def test_every_direction_of_travel_is_followed(direction: tuple[int, int]):
    across, down = direction
    seen = (spot(7 + 2 * down * (i - 2), 10 + 2 * across * (i - 2)) for i in range(PLACES))
    step = 2.0 * CELL * np.array(direction)
    assert over(seen, step)[-1].max() == pytest.approx(8.0)


def test_a_standstill_adds_no_place():
    sights: tuple[Sight, ...] = ()
    still = np.array([0.1, 0.0])
    for i in range(20):
        sights, agreed = persist(sights, spot(7, 10), SHOWN, (5.0 + 0.001 * i, i * still / 20, np.zeros(2)), CELL)
        assert len(sights) == 1
        assert agreed.max() == pytest.approx(over([spot(7, 10)])[0].max())


def test_no_more_places_are_kept_than_must_agree():
    sights: tuple[Sight, ...] = ()
    for i in range(30):
        sights, _ = persist(sights, spot(7, 10), SHOWN, (float(i), i * STEP, i * STEP), CELL)
        assert len(sights) == min(i + 1, PLACES)


def test_places_that_no_longer_overlap_say_nothing_of_each_other():
    far = np.array([-2.0 * COLS * CELL, 0.0])
    alone = over([spot(7, 10)])[0]
    for found in over([spot(7, 10)] * PLACES, far):
        np.testing.assert_array_equal(found, alone)


def test_hidden_cells_score_nothing_and_deny_nothing():
    shown = slice(0, ROWS), slice(6, COLS)
    assert over([spot(7, 3)], shown=shown)[0].max() == 0
    # the last place does not see the cell from which the spot came in
    entered = [np.zeros((ROWS, COLS, 2), np.float32)] + [spot(7, 3 + 3 * i) for i in range(1, 4)]
    agreed = over(entered, -STEP, shown)
    assert agreed[-1].max() == pytest.approx(agreed[-1][7, 12, 0]) != 0


def test_cells_unseen_among_those_shown_score_nothing_and_deny_nothing():
    unseen = np.zeros((ROWS, COLS), bool)
    unseen[:, 6:12] = True
    sights: tuple[Sight, ...] = ()
    agreed = np.zeros((ROWS, COLS, 2), np.float32)
    for i in range(PLACES):
        col = 18 - 3 * i
        seen = spot(7, col, 0.0 if unseen[7, col] else 8.0)
        sights, agreed = persist(sights, seen, SHOWN, (float(i), i * STEP, i * STEP), CELL, unseen=unseen)
        assert not agreed[unseen].any()
    # two places do not see it; where three agree, it must be stronger
    assert col == 6
    sights, agreed = persist(sights, spot(7, 3), SHOWN, (5.0, 5 * STEP, 5 * STEP), CELL, unseen=unseen)
    assert agreed.max() == pytest.approx(8.0 / 1.5)
    assert np.isfinite(agreed).all()


@given(seed=st.integers(0, 2**31), frames=st.integers(1, 8))
@FEW
def test_agreement_never_exceeds_the_score_and_changes_nothing_passed_in(seed: int, frames: int):
    rng = np.random.default_rng(seed)
    sights: tuple[Sight, ...] = ()
    grid = np.zeros(2)
    for i in range(frames):
        grid = grid + rng.uniform(-20, 20, 2)
        score = rng.gamma(1, 2, (ROWS, COLS, 2)).astype(np.float32)
        (top, bottom), (left, right) = (np.sort(rng.integers(0, size + 1, 2)).tolist() for size in (ROWS, COLS))
        shown = slice(top, bottom), slice(left, right)
        before, kept = score.copy(), [sight.score.copy() for sight in sights]
        now, agreed = persist(sights, score, shown, (float(i), grid, grid), CELL)
        np.testing.assert_array_equal(score, before)
        for sight, copy in zip(sights, kept, strict=True):
            np.testing.assert_array_equal(sight.score, copy)
        assert np.all(agreed <= score)
        assert np.all(agreed >= 0)
        inside = agreed[shown].copy()
        agreed[shown] = 0
        assert not agreed.any()
        agreed[shown] = inside
        sights = now
