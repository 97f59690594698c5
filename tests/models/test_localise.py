"""Localise: a tiny sweep under every pace and placement is followed to a frame, and found again after strangers."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from models.frame import Frame
from models.localise import Located
from models.registration import full_pose
from models.scoring import look, remember
from tests.models.parts import (
    FIRST,
    FRAMES,
    INTERVAL_NS,
    STEP,
    View,
    golden,
    places,
    pose_of,
    shot,
    surface,
    swept,
    with_spot,
)

SEEN = View(seed=11)


def followed(frames: Sequence[Frame]) -> list[Located]:
    """Where each frame is said to be."""
    appearance, found = golden(), list[Located]()
    memory = remember(appearance)
    for each in frames:
        memory, shown_ = look(appearance, 1.0, memory, each)
        assert shown_ is not None
        found.append(shown_.located)
    return found


def shown(ats: np.ndarray, view: View = SEEN) -> np.ndarray:
    """The places that the pictures show: an offset along the path looks like travel."""
    return np.array([at - pose_of(view, FIRST + STEP * at)[0] / STEP for at in ats])


def share_within(found: Sequence[Located], truth: np.ndarray, frames: float = 1.0) -> float:
    off = np.abs([each.at for each in found] - np.clip(truth, 0, FRAMES - 1))
    return float(np.mean(off < frames))


PACES = {
    **{f"pace {pace:g}": places(pace) for pace in (0.6, 0.8, 1.0, 1.25, 1.5)},
    "slower and slower": np.cumsum(np.linspace(1.4, 0.3, 68)),
    "a standstill": np.concatenate([places(last=25), np.full(40, 25.0), places(first=26)]),
    "late by five": places(first=5),
    "late by twenty": places(first=20),
    "back for ten": np.concatenate([places(last=30), places(first=20, last=29)[::-1], places(first=21)]),
}


@pytest.mark.parametrize("name", PACES)
def test_at_any_pace_it_is_within_a_frame(name: str):
    ats = PACES[name]
    found = followed(swept(surface(), ats, SEEN))
    # a very late start takes some frames to be believed
    settled = slice(10 if name == "late by twenty" else 0, None)
    assert share_within(found[settled], shown(ats)[settled]) >= 0.99
    assert np.mean([each.verified for each in found[settled]]) > 0.95


@pytest.mark.parametrize("seed", [1, 2])
def test_frames_may_be_lost(seed: int):
    kept = np.random.default_rng(seed).random(FRAMES) > 0.35
    ats = places()[kept]
    frames = [
        replace(each, t_ns=int(at * INTERVAL_NS)) for each, at in zip(swept(surface(), ats, SEEN), ats, strict=True)
    ]
    found = followed(frames)
    assert share_within(found, shown(ats)) >= 0.99


@pytest.mark.parametrize(
    "view",
    [
        View(dx=3, dy=2, seed=3),
        View(dx=-2, dy=-4, turn=0.012, seed=4),
        View(dy=3, turn=-0.012, gain=0.85, shade=0.06, seed=5),
        View(gain=1.15, offset=-10, noise=3, seed=6),
    ],
    ids=["shifted", "turned", "turned and shaded", "another lamp"],
)
def test_a_part_that_lies_off_is_followed_and_laid_on_its_reference(view: View):
    found = followed(swept(surface(), view=view))
    assert share_within(found, shown(places(), view)) >= 0.99
    motion = golden().path
    for at, located in list(zip(places(), found, strict=True))[5:]:
        pose = pose_of(view, FIRST + STEP * at)
        pose[:2] += motion.between(located.reference, at)
        apart = full_pose(located.registered.pose, (160, 120)) - pose
        assert np.abs(apart[:2]).max() < 0.3
        assert abs(apart[2]) < 0.003


def strangers(kind: str) -> list[np.ndarray]:
    """Ten pictures that are not of this part."""
    if kind == "another part":
        return [shot(surface(2), FIRST + STEP * at, SEEN, at) for at in range(25, 35)]
    if kind == "upside down":
        return [shot(surface(), FIRST + STEP * at, SEEN, at)[::-1, ::-1] for at in range(25, 35)]
    rng = np.random.default_rng(1)
    return [rng.integers(0, 256, (120, 160), dtype=np.uint8) for _ in range(10)]


@pytest.mark.parametrize("kind", ["another part", "upside down", "noise"])
def test_strangers_are_not_taken_for_the_part_and_it_is_found_again_after_them(kind: str):
    frames = swept(surface(), view=SEEN)
    for i, pixels in enumerate(strangers(kind), start=25):
        frames[i] = Frame(pixels, frames[i].t_ns, i)
    found = followed(frames)
    assert not any(each.verified for each in found[25:35])
    assert share_within(found[:25], shown(places())[:25]) >= 0.99
    assert share_within(found[40:], shown(places())[40:]) == 1
    assert all(each.verified for each in found[40:])


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_a_whole_sweep_of_another_part_is_not_taken_for_this_one(seed: int):
    found = followed(swept(surface(seed), view=SEEN))
    assert np.mean([each.verified for each in found]) < 0.1


def test_the_robot_may_leap_ahead():
    ats = np.concatenate([places(last=20), places(first=38)])
    found = followed(swept(surface(), ats, SEEN))
    assert share_within(found[33:], shown(ats)[33:]) == 1


def test_a_place_that_is_verified_is_right_and_says_so_by_its_uncertainty():
    ats = PACES["back for ten"]
    for at, located in zip(shown(ats), followed(swept(surface(), ats, SEEN)), strict=True):
        if located.verified:
            assert abs(located.at - at) < 1
            assert located.uncertainty < 1


@pytest.mark.parametrize(("side", "verified"), [(10, 1), (25, 1), (45, 0.8)])
def test_a_defect_of_up_to_a_tenth_of_the_picture_does_not_move_it(side: int, verified: float):
    found = followed(swept(with_spot(surface(), 230, 110, side, 120), view=SEEN))
    assert share_within(found, shown(places())) == 1
    assert np.mean([each.verified for each in found]) >= verified


def test_following_changes_nothing_that_was_learnt():
    before = golden().to_bytes()
    followed(swept(surface(), places(last=8), SEEN))
    assert golden().to_bytes() == before
