"""Turning: on a turntable nothing moves in the picture; the looks say where, and a stranger is one."""

from functools import lru_cache

import cv2
import numpy as np
import pytest

from models.appearance import Appearance
from models.learning import learn
from models.position import Places
from models.turning import Turn, follow
from models.verdict import FrameState, Judgement
from tests.models.parts import frame, golden, inspected, surface

VIEWS = 60
SIDE = 96


@lru_cache
def skin(seed: int) -> np.ndarray:
    """What covers a body all round, (SIDE, 6 SIDE), a little of it bright."""
    rng = np.random.default_rng(seed)
    grain = sum(
        strength * cv2.GaussianBlur(np.tile(rng.standard_normal((SIDE, 3 * SIDE)), (1, 3)), (0, 0), sigma) * sigma
        for sigma, strength in ((3, 1.0), (8, 2.0))
    )
    return np.clip(120 + 60 * grain / grain.std(), 5, 250).astype(np.float32)


def turned(angle: float, seed: int = 1, noise: float = 1.0, gain: float = 1.0, colour: bool = False) -> np.ndarray:
    """A body of uneven girth on black, turned by so many views."""
    theta = 2 * np.pi * angle / VIEWS
    y, x = np.mgrid[0:SIDE, 0:SIDE].astype(np.float32)
    girth = SIDE * (0.34 + 0.08 * np.sin(y / 14 + seed) + 0.05 * np.cos(2 * theta + y / 20))
    u = (x - SIDE / 2) / girth
    around = np.arcsin(np.clip(u, -1, 1)) + theta + np.pi
    seen = cv2.remap(skin(seed), ((around / (2 * np.pi)) % 1 * 3 * SIDE + SIDE).astype(np.float32), y, cv2.INTER_LINEAR)
    seen = np.where(np.abs(u) < 1, seen * np.sqrt(np.maximum(1 - 0.7 * u * u, 0)), 8) * gain
    seen = np.stack([seen, 0.8 * seen, 255 - seen], axis=2) if colour else seen
    seen = seen + noise * np.random.default_rng([seed, round(1000 * angle)]).standard_normal(seen.shape)
    return np.clip(seen + 0.5, 0, 255).astype(np.uint8)


@lru_cache
def table(colour: bool = False) -> Appearance:
    return learn([[frame(turned(i, colour=colour), i) for i in range(VIEWS)]])


PACES = {
    "as learnt": np.arange(VIEWS),
    "late by five": np.arange(5, VIEWS),
    "views left out": np.cumsum([0, 1, 2, 1, 3, 1, 2] * 5)[:35],
    "slow": np.arange(0, VIEWS - 1, 0.5),
    "a standstill": np.concatenate([np.arange(30), np.full(20, 30), np.arange(31, VIEWS)]),
}


def test_a_turntable_is_told_from_a_camera_that_moves():
    assert not table().shifts
    assert golden().shifts
    np.testing.assert_allclose(table().s, np.linspace(0, 1, VIEWS))


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("name", PACES)
def test_every_frame_of_a_turn_is_placed_within_a_view(name: str, colour: bool):
    ats = np.clip(PACES[name], 0, VIEWS - 1)
    _, frames = inspected(
        table(colour), [frame(turned(at, noise=3, gain=0.9, colour=colour), i) for i, at in enumerate(ats)]
    )
    assert {each.state for each in frames} == {FrameState.SCORED}
    assert max(abs((each.s or 0) * (VIEWS - 1) - at) for each, at in zip(frames, ats, strict=True)) <= 1


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_another_body_is_invalid(seed: int):
    result, _ = inspected(table(), [frame(turned(i, seed), i) for i in range(VIEWS)])
    assert result.verdict is Judgement.INVALID


def test_what_resembles_the_part_is_placed_and_not_scored():
    like = [np.clip(turned(i) * 0.35 + 0.65 * turned(i, 2), 0, 255).astype(np.uint8) for i in range(VIEWS)]
    result, frames = inspected(table(), [frame(picture, i) for i, picture in enumerate(like)])
    strange = [each for each in frames if each.state is FrameState.STRANGE]
    assert len(strange) > 0.8 * VIEWS
    assert np.mean([abs((each.s or 0) * (VIEWS - 1) - each.index) <= 3 for each in strange]) > 0.9
    assert result.verdict is Judgement.INVALID


def test_a_body_that_looks_alike_all_round_stands_still_nowhere():
    faint = [np.clip(0.7 * turned(0, noise=0) + 0.3 * turned(i, noise=0), 0, 255).astype(np.uint8) for i in range(40)]
    appearance = learn([[frame(picture, i) for i, picture in enumerate(faint)]])
    assert appearance.places == len(appearance.keys) == 40
    _, frames = inspected(appearance, [frame(picture, i) for i, picture in enumerate(faint)])
    assert max(abs((each.s or 0) * 39 - each.index) for each in frames) <= 1


def test_a_sweep_of_other_pictures_than_turns_stays_invalid():
    part = surface()[:SIDE]
    pictures = [np.ascontiguousarray(part[:, 4 * i : 4 * i + SIDE]).astype(np.uint8) for i in range(40)]
    result, _ = inspected(table(), [frame(picture, i) for i, picture in enumerate(pictures)])
    assert result.verdict is Judgement.INVALID


def test_looks_that_say_nothing_leave_the_pace_to_the_clock():
    places = Places(np.where(np.arange(20) == 3, 0.0, 10.0), np.arange(20.0), np.ones(20))
    for i in range(8):
        places = follow(places, np.ones(20), 1.0)
        assert int(places.cost.argmin()) == 4 + i


def test_distance_is_counted_in_steps_between_neighbours():
    turn = Turn(np.arange(10.0)[:, None] * np.array([[3.0, 4.0]]), 1.0)
    assert turn.step == pytest.approx(25.0)
    np.testing.assert_allclose(turn.away(np.array([6.0, 8.0]), 26.0)[[2, 3]], [1.0, 2.0])
