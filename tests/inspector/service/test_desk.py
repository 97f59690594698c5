"""The desk: real work in processes of its own; what fails, dies or is cut off says so in a sentence."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.scores_json import scores_from_bytes, scores_to_bytes
from inspector.service.desk import Desk, DeskClosed, WorkerDied, WorkFailed, naming
from inspector.service.tasks import rejudged
from models.verdict import Policy
from tests.inspector.conftest import Line
from tests.inspector.line import url
from tests.patience import SECONDS


@pytest.fixture(scope="module")
def desk() -> Iterator[Desk]:
    desk = Desk(1)
    yield desk
    desk.close()


def test_a_recording_is_surveyed(desk: Desk, line: Line) -> None:
    found = desk.do("survey", {"recording": str(line.good), "max_frames": 1000, "max_pixels": 10**8})
    assert found["frames"] == len(list(SweepReader(line.good)))
    assert (found["losses"], found["facts"]["part_id"]) == ([], "0003")


def test_what_cannot_be_done_is_told_with_names_for_paths(desk: Desk, tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"PNG" * 9)
    with (
        pytest.raises(WorkFailed, match=r"^the recording: no MCAP") as caught,
        naming({str(tmp_path / "a"): "the recording"}),
    ):
        desk.do("survey", {"recording": str(tmp_path / "a"), "max_frames": 9, "max_pixels": 10**8})
    assert caught.value.kind == "NotARecording"


def test_a_recording_may_not_be_too_long(desk: Desk, line: Line) -> None:
    with pytest.raises(WorkFailed, match="allowed are 9"):
        desk.do("survey", {"recording": str(line.good), "max_frames": 9, "max_pixels": 10**8})


def test_a_camera_is_recorded_and_progress_grows(desk: Desk, tmp_path: Path) -> None:
    told: list[float] = []
    asked = {"camera": url("unit=9&realtime=1&fps=40"), "recording": str(tmp_path / "a"), "seconds": None, "frames": 40}
    made = desk.do("record", {**asked, "product_id": "plate", "part_id": None}, told.append)
    assert (made["frames"], made["losses"]) == (40, [])
    assert told == sorted(told)
    assert told
    assert len(list(SweepReader(tmp_path / "a"))) == 40


def test_a_process_that_dies_says_so_and_the_next_takes_its_place(line: Line, tmp_path: Path) -> None:
    desk = Desk(1)
    (worker,) = desk._all
    endless = {"camera": url("realtime=1"), "recording": str(tmp_path / "a"), "seconds": 1e6, "frames": None}

    def kill(share: float) -> None:
        assert worker._process is not None
        os.kill(worker._process.pid, signal.SIGKILL)

    with pytest.raises(WorkerDied, match=r"the process that should record ended .*\(killed by signal 9\)"):
        desk.do("record", {**endless, "product_id": "p", "part_id": None}, kill)
    assert desk.do("survey", {"recording": str(line.good), "max_frames": 1000, "max_pixels": 10**8})["frames"] > 0
    desk.close()


def test_what_breaks_is_told_and_nothing_else_breaks_with_it(desk: Desk, line: Line) -> None:
    with pytest.raises(WorkerDied, match="TypeError"):
        desk.do("survey", {"nonsense": 1})
    assert desk.do("survey", {"recording": str(line.good), "max_frames": 1000, "max_pixels": 10**8})["frames"] > 0


def test_closing_cuts_off_what_is_done_and_refuses_more(tmp_path: Path) -> None:
    desk = Desk(1)
    begun, ended = threading.Event(), list[str]()
    endless = {"camera": url("realtime=1"), "recording": str(tmp_path / "a"), "seconds": 1e6, "frames": None}

    def work() -> None:
        try:
            desk.do("record", {**endless, "product_id": "p", "part_id": None}, lambda share: begun.set())
        except DeskClosed as error:
            ended.append(str(error))

    thread = threading.Thread(target=work)
    thread.start()
    assert begun.wait(SECONDS)
    desk.close()
    thread.join()
    assert ended == ["the service was stopped before this was done"]
    with pytest.raises(DeskClosed):
        desk.do("survey", {})


@pytest.mark.parametrize("now", [Policy(sensitivity=0.2), Policy(false_rejects=0.2), Policy(sensitivity=3.0)])
def test_scores_judged_again_give_the_verdict_that_a_replay_gives(line: Line, now: Policy) -> None:
    before = Policy()
    for path in (line.good, line.spot):
        result = replay(SweepReader(path), line.appearance, before).result
        frames = scores_from_bytes(scores_to_bytes(result.frames))
        again = rejudged(frames, line.appearance, before, now, dropped=result.frames_dropped, stopped=False)
        real = replay(SweepReader(path), line.appearance, now).result
        assert (again.verdict, again.coverage, again.frames_scored) == (real.verdict, real.coverage, real.frames_scored)
        peaks = [[d.peak_score for d in each.deviations if d.kind == "appearance"] for each in (again, real)]
        assert peaks[0] == pytest.approx(peaks[1])


def test_the_same_policy_gives_the_same_result(line: Line) -> None:
    result = replay(SweepReader(line.spot), line.appearance).result
    again = rejudged(result.frames, line.appearance, Policy(), Policy(), dropped=result.frames_dropped, stopped=False)
    assert (again.reasons, again.deviations, again.frames) == (result.reasons, result.deviations, result.frames)
