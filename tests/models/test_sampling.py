"""Sampling: how many frames show a spot, in closed form, and advice where it is due and nowhere else."""

import numpy as np
import pytest

from models.sampling import sampled, sampling
from tests.models.parts import SIZE, STEP, golden


def line(pixels: list[float], steps: list[float] | None = None, down: float = 0.0):
    motion = np.array([[each, down] for each in pixels], float)
    return sampled(np.linspace(0, 1, len(pixels) + 1), motion, np.array(steps or [1.0] * len(pixels)), (300, 200))


def test_an_even_sweep_is_told_as_it_is_and_needs_no_advice():
    found = sampling(golden())
    assert found.pixels == pytest.approx(STEP, rel=0.1)
    assert found.shown == pytest.approx(SIZE[0] / STEP, rel=0.1)
    assert len(found.s) == len(found.curve) == golden().places
    assert np.median(found.curve) == pytest.approx(1, abs=0.01)
    assert found.advice == ()


@pytest.mark.parametrize(
    ("across", "down", "frames"), [(10, 0, 30), (0, 10, 20), (-10, 10, 20), (30, 10, 10), (0, 0, np.inf)]
)
def test_a_spot_is_seen_until_it_leaves_the_picture_on_the_nearer_side(across: float, down: float, frames: float):
    assert line([across] * 4, down=down).shown == pytest.approx(frames)


def test_where_too_few_frames_show_a_spot_the_stretch_and_the_remedy_are_told():
    found = line([10] * 4 + [60, 10, 50] + [10] * 13)
    (only,) = found.advice
    assert (only.s_start, only.s_end) == pytest.approx((4 / 20, 7 / 20))
    assert (
        only.said == "the picture moves by up to 60 pixels per frame: a spot is seen in 5 frames; go 2.0 times slower"
    )


def test_stretches_that_lie_apart_are_told_apart_and_in_order():
    found = line([60] + [10] * 8 + [60])
    assert [(each.s_start, each.s_end) for each in found.advice] == [(0, 0.1), (0.9, pytest.approx(1.0))]


def test_where_nothing_moves_the_curve_tells():
    found = line([0] * 10, [1] * 6 + [4, 3] + [1] * 2)
    (only,) = found.advice
    assert (only.s_start, only.s_end) == pytest.approx((0.6, 0.8))
    assert "4.0 times as fast per frame as usual" in only.said
    assert line([10] * 10, [1] * 6 + [4, 3] + [1] * 2).advice == ()


def test_a_curve_that_stands_still_is_even():
    assert line([0] * 3, [0, 0, 0]).curve.tolist() == [1, 1, 1, 1]
