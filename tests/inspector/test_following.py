"""The loop closed on the simulated camera: a hand follows a part, with a frame of latency, thirty frames a second."""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np
import pytest

from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.following import BEND, COURSES, TOP_SPEED, Course, Followed, follow, learn_displacements
from inspector.following import path as wander
from models.workspace import Workspace


def opened(options: str = "") -> SimulatedCamera:
    camera = open_camera(f"simulated:?part=board2&size=160x120{options}")
    assert isinstance(camera, SimulatedCamera)
    return camera


@lru_cache
def learnt() -> Workspace:
    return learn_displacements(opened())


def followed(course: Course, frames: int, covered: range = range(0), latency: int = 1) -> list[Followed]:
    """Another unit, under another lamp, by another chance."""
    camera = opened("&unit=3&seed=7&gain=0.95&shade=0.05")
    return list(follow(camera, learnt(), course, frames, latency=latency, covered=covered))


@pytest.mark.parametrize("name", COURSES)
@pytest.mark.parametrize("speed", [0.05, 0.2, TOP_SPEED])
def test_a_part_up_to_the_top_speed_is_never_lost(name: str, speed: float) -> None:
    loop = followed(COURSES[name](speed), 180)
    assert {one.tracked.state for one in loop} == {"tracking"}
    assert max(one.error for one in loop) < 1
    assert np.mean([one.error for one in loop[10:]]) < 0.1


@pytest.mark.parametrize("course", [*(partial(wander, seed=seed) for seed in (2, 3, 4)), COURSES["circle"]])
def test_a_part_covered_for_ten_frames_is_said_to_be_lost_and_is_found_again(course: partial[Course]) -> None:
    loop = followed(course(TOP_SPEED), 110, covered=range(60, 70))
    states = [one.tracked.state for one in loop]
    assert states[:71] == ["tracking"] * 60 + ["lost"] * 10 + ["recovered"]
    assert states[-30:] == ["tracking"] * 30
    assert np.mean([one.error for one in loop[-30:]]) < 0.1


def test_what_is_said_of_the_part_is_where_it_is_and_how_fast_it_goes() -> None:
    loop = followed(COURSES["circle"](0.2), 60)
    truth = COURSES["circle"](0.2)(60) * 16
    places = np.array([one.tracked.place for one in loop])
    assert np.abs(places - truth)[5:].max() < 0.5
    speed = np.hypot(*np.array([one.tracked.velocity for one in loop[30:]]).T)
    assert speed == pytest.approx(0.2 * 16 * 30, rel=0.15)


def test_more_latency_costs_exactness() -> None:
    errors = [np.mean([one.error for one in followed(COURSES["circle"](0.2), 90, latency=n)[20:]]) for n in (0, 1, 3)]
    assert errors[0] < errors[1] < errors[2] < 0.2


@pytest.mark.parametrize("name", COURSES)
def test_a_course_has_its_speed_and_bends_no_tighter_than_asked(name: str) -> None:
    places = COURSES[name](0.3)(400)
    assert places[0].tolist() == [0, 0]
    steps = np.diff(places, axis=0)
    assert np.hypot(*steps.T) == pytest.approx(0.3, rel=0.01)
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    assert np.abs(turns).max() <= 0.3 / BEND * 1.02
