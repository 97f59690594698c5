"""Tracking a part by pictures of it: found, lost, found again; each picture here is a point of a learnt pattern."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import pytest

from models.errors import PictureError
from models.tracking import Tracked, Tracking, aim, begin, step
from models.workspace import LabelledPicture, Parameter, Workspace, learn_workspace

FRAME = 33_333_333
REACH = 10.0
SIZE = 48


@lru_cache
def ground(seed: int = 1) -> np.ndarray:
    rough = np.random.default_rng(seed).standard_normal((400, 400), np.float32)
    smooth: np.ndarray = cv2.GaussianBlur(rough, (0, 0), 5)
    return 128 + 45 * smooth / smooth.std()


def seen(x: float, y: float, seed: int = 1) -> np.ndarray:
    """The ground, shifted by x and y pixels."""
    shift = np.float32([[1, 0, x - 200 + SIZE / 2], [0, 1, y - 200 + SIZE / 2]])
    return cv2.warpAffine(ground(seed), shift, (SIZE, SIZE), flags=cv2.INTER_LINEAR).clip(0, 255).astype(np.uint8)


@lru_cache
def workspace() -> Workspace:
    axis = np.linspace(-REACH, REACH, 6)
    pictures = [LabelledPicture("part", (x, y), seen(x, y)) for x in axis.tolist() for y in axis.tolist()]
    return learn_workspace(pictures, (Parameter("x"), Parameter("y")))


def tracked(places: list[tuple[float, float] | None]) -> tuple[Tracking, list[Tracked]]:
    """A camera that stands still; where there is no place, it sees another ground."""
    tracking, told = begin(workspace()), list[Tracked]()
    for number, place in enumerate(places):
        picture = seen(0, 0, seed=2) if place is None else seen(*place)
        tracking, one = step(tracking, picture, number * FRAME)
        told.append(one)
    return tracking, told


def along(n: int, speed: float = 0.5) -> list[tuple[float, float] | None]:
    return [(-8 + speed * k, 4 - speed * k / 2) for k in range(n)]


def test_place_and_velocity_are_those_of_the_part() -> None:
    _, told = tracked(along(25))
    assert [one.state for one in told] == ["tracking"] * 25
    last = told[-1]
    assert last.object == "part"
    assert last.place == pytest.approx((-8 + 12, 4 - 6), abs=0.1)
    assert last.velocity == pytest.approx((15, -7.5), abs=1.5)


def test_nothing_is_said_before_it_was_seen() -> None:
    tracking, told = tracked([None, None])
    assert [(one.state, one.object, one.place, one.velocity) for one in told] == [("searching", None, None, None)] * 2
    assert aim(tracking, 0) is None


def test_a_part_that_is_covered_is_lost_expected_and_recovered() -> None:
    places = along(30)
    _, told = tracked(places[:12] + [None] * 6 + places[18:])
    assert [one.state for one in told] == ["tracking"] * 12 + ["lost"] * 6 + ["recovered"] + ["tracking"] * 11
    assert [one.unseen for one in told[11:19]] == [0, 1, 2, 3, 4, 5, 6, 0]
    expected = told[17]
    assert expected.located.q is None
    assert expected.place == pytest.approx(places[17], abs=0.8)
    assert told[18].velocity == pytest.approx((15, -7.5), abs=2)


def test_after_a_while_nothing_is_expected_any_more_and_it_is_found_anywhere() -> None:
    _, told = tracked([*along(12), *[None] * 20, (7.0, 7.0), (7.0, 7.0)])
    assert told[31].state == "lost"
    assert told[31].place is None
    assert told[31].object == "part"
    assert told[32].state == "recovered"
    assert told[32].place == pytest.approx((7, 7), abs=0.2)
    assert told[33].velocity == pytest.approx((0, 0), abs=6)


def test_a_part_that_is_somewhere_else_at_once_is_found_there() -> None:
    _, told = tracked([*along(12), (8.0, 8.0), (8.0, 8.0), (8.0, 8.0)])
    assert told[-1].place == pytest.approx((8, 8), abs=0.2)


def test_the_hand_is_aimed_at_where_the_part_will_be() -> None:
    tracking, told = tracked(along(20))
    at = aim(tracking, told[-1].t_ns + 2 * FRAME)
    assert at == pytest.approx((-8 + 0.5 * 21, 4 - 0.25 * 21), abs=0.15)


def test_a_hand_that_moves_with_the_part_sees_it_stand_and_still_knows_its_velocity() -> None:
    tracking = begin(workspace())
    for number in range(20):
        tracking, told = step(tracking, seen(1, -2), number * FRAME, (3.0 * number, 100 - 1.5 * number))
    assert told.located.q == pytest.approx((1, -2), abs=0.1)
    assert told.place == pytest.approx((1 + 57, -2 + 100 - 28.5), abs=0.2)
    assert told.velocity == pytest.approx((90, -45), abs=3)


def test_a_hand_that_lost_the_part_for_good_searches_round_about() -> None:
    tracking, told = tracked([*[(0.0, 0.0)] * 20, *[None] * 40])
    wheres = list[tuple[float, ...]]()
    for number in range(60, 85):
        tracking, told[0] = step(tracking, seen(0, 0, seed=2), number * FRAME)
        where = aim(tracking, number * FRAME)
        assert where is not None
        wheres.append(where)
    steps = np.abs(np.diff(np.array(wheres), axis=0)).max(axis=1)
    np.testing.assert_allclose(steps, REACH, rtol=1e-6)
    assert len({(round(x), round(y)) for x, y in wheres}) == len(wheres)


def test_a_turning_part_is_followed_through_its_period() -> None:
    def turned(degrees: float) -> np.ndarray:
        about = cv2.getRotationMatrix2D((200, 200), degrees, 1)
        return cv2.warpAffine(ground(), about, (400, 400))[176:224, 176:224].clip(0, 255).astype(np.uint8)

    pictures = [LabelledPicture("disc", (float(a),), turned(a)) for a in range(0, 360, 10)]
    turntable = learn_workspace(pictures, (Parameter("angle_deg", 360),))
    tracking, states = begin(turntable), list[str]()
    for number in range(40):
        angle = 300 + 3 * number
        tracking, told = step(tracking, turned(angle % 360), number * FRAME)
        states.append(told.state)
        assert told.place is not None
        assert (told.place[0] - angle + 180) % 360 - 180 == pytest.approx(0, abs=1)
    assert set(states) == {"tracking"}
    assert told.velocity == pytest.approx((90,), abs=5)


def test_a_picture_of_another_size_is_refused_and_changes_nothing() -> None:
    tracking, _ = tracked(along(5))
    with pytest.raises(PictureError, match="10x20"):
        step(tracking, np.zeros((20, 10), np.uint8), 5 * FRAME)
    _, told = step(tracking, seen(-5.5, 2.75), 5 * FRAME)
    assert told.state == "tracking"
