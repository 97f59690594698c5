"""Rivals: what wrong places reach is high where they look alike, and tells individuals from strangers."""

import cv2
import numpy as np
import pytest

from models.learning import learn
from models.localise import asked
from models.verdict import FrameState, Judgement
from tests.models.parts import FRAMES, View, inspected, places, surface, swept

AGAIN = View(dx=0.6, dy=-1.0, gain=1.05, seed=7)


def individual(differs: float, seed: int = 90) -> np.ndarray:
    """A part of the same kind whose own look is so many times as strong as what it shares with the others."""
    own = np.random.default_rng(seed).standard_normal(surface().shape).astype(np.float32)
    own = cv2.GaussianBlur(own, (0, 0), 3)
    return np.clip(surface() + differs * float(surface().std()) * own / own.std(), 0, 255)


def striped() -> np.ndarray:
    """Surface 1 with stripes every six places but for its beginning."""
    part = surface().copy()
    x = np.arange(part.shape[1])
    part[:, 180:] = (120 + 60 * np.sign(np.sin(2 * np.pi * x / 24)))[None, 180:]
    return cv2.GaussianBlur(part, (0, 0), 1.0)


def test_rivals_agree_where_places_look_alike_and_not_where_they_do_not():
    rivals = learn([swept(striped())]).rivals
    assert rivals.shape == (FRAMES,)
    assert rivals[-10:].min() > 0.9
    assert learn([swept(surface())]).rivals.max() < 0.8


def test_too_few_places_teach_nothing_of_rivals():
    assert learn([swept(surface(), places(last=11))]).rivals.min() >= 0.8


@pytest.mark.parametrize("differs", [0.5, 0.8])
def test_a_part_that_differs_a_lot_is_placed_where_the_place_is_unmistakable(differs: float):
    _, frames = inspected(learn([swept(surface())]), swept(individual(differs), view=AGAIN))
    scored = [frame for frame in frames if frame.state is FrameState.SCORED]
    assert len(scored) >= 0.95 * FRAMES
    assert max(abs((frame.s or 0) * (FRAMES - 1) - frame.index) for frame in scored) < 1


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_a_stranger_is_not(seed: int):
    result, _ = inspected(learn([swept(surface())]), swept(surface(seed), view=AGAIN))
    assert result.verdict is Judgement.INVALID


def test_more_is_asked_where_rivals_agree_and_less_where_good_parts_reached_less():
    wrong, ones = np.array([0.5, 0.7, 0.9]), np.ones(3)
    alone = asked(wrong, ones)
    assert np.all(np.diff(alone) > 0)
    assert np.all((wrong < alone) & (alone < ones))
    reached = np.array([0.55, 0.72, 0.6])
    assert np.all((wrong <= asked(wrong, reached)) & (asked(wrong, reached) < alone))


@pytest.mark.parametrize("view", [AGAIN, View(dx=-3, dy=2, turn=0.006, seed=3)])
def test_a_sweep_begins_where_the_golden_one_did_though_it_looks_the_same_elsewhere(view: View):
    # the last thirty places show again what the first thirty do
    part = np.tile(surface()[:, :120], (1, 4))
    _, frames = inspected(learn([swept(part)]), swept(part, view=view))
    scored = [each for each in frames if each.s is not None]
    assert len(scored) >= 0.95 * FRAMES
    assert max(abs((each.s or 0) * (FRAMES - 1) - each.index) for each in scored) < 2
