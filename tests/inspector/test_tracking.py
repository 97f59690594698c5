"""Frames tracked, counted, and told to scripts."""

from __future__ import annotations

import json

import numpy as np
import pytest

from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.cameras.simulated.canvas import HEIGHT, WIDTH
from inspector.cameras.simulated.render import Pose
from inspector.following import learn_displacements
from inspector.tracking import TrackingSummary, track, tracked_record
from models.errors import PictureError
from models.frame import Frame
from models.tracking import Tracked
from models.workspace import Located


@pytest.fixture(scope="module")
def camera() -> SimulatedCamera:
    camera = open_camera("simulated:?size=160x120")
    assert isinstance(camera, SimulatedCamera)
    return camera


def test_frames_are_tracked_one_by_one(camera: SimulatedCamera) -> None:
    frames = [camera.look(Pose(WIDTH / 2 - 2 * n, HEIGHT / 2 + n), n, covered=n == 5) for n in range(9)]
    told = list(track(frames, learn_displacements(camera)))
    assert [frame.sequence for frame, _ in told] == list(range(9))
    summary = TrackingSummary()
    for _, tracked in told:
        summary = summary.with_frame(tracked)
    assert summary == TrackingSummary(frames=9, seen=8, losses=1, longest=1)
    # 160 wide: half a pixel per unit
    assert told[-1][1].place == pytest.approx((8, -4), abs=0.3)


def test_a_frame_of_another_size_is_named(camera: SimulatedCamera) -> None:
    with pytest.raises(PictureError, match="frame 4: "):
        list(track([Frame(np.zeros((9, 9), np.uint8), 0, 4)], learn_displacements(camera, count=3)))


def test_scripts_get_the_names_of_locate_and_those_of_tracking(camera: SimulatedCamera) -> None:
    located = Located("part", (1.0, 2.0), (0.1, 0.2), 0.03, "known")
    tracked = Tracked(5, "recovered", located, "part", (1.1, 2.1), (3.0, 0.0), 0)
    record = tracked_record(7, tracked, learn_displacements(camera, count=3))
    assert json.loads(json.dumps(record)) == {
        "sequence": 7, "t_ns": 5, "object": "part", "q": {"x_px": 1.0, "y_px": 2.0},
        "uncertainty": {"x_px": 0.1, "y_px": 0.2}, "distance": 0.03, "state": "known", "others": [],
        "tracking": "recovered", "tracked": "part", "place": {"x_px": 1.1, "y_px": 2.1},
        "velocity": {"x_px": 3.0, "y_px": 0.0}, "unseen": 0,
    }  # fmt: skip


def test_what_is_not_known_is_null(camera: SimulatedCamera) -> None:
    tracked = Tracked(5, "searching", Located(None, None, None, 0.4, "unknown"), None, None, None, 0)
    record = tracked_record(7, tracked, learn_displacements(camera, count=3))
    assert [record[name] for name in ("object", "q", "uncertainty", "tracked", "place", "velocity")] == [None] * 6


def test_the_end_is_told_in_words() -> None:
    assert TrackingSummary(10, 10).sentence() == "found in 10 of 10 frames, never lost"
    assert TrackingSummary(10, 0).sentence() == "not found in any of 10 frames"
    assert "lost 3 times, for 4 frames at the longest" in TrackingSummary(90, 80, 3, 4).sentence()
