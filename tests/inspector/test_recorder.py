"""The recorder keeps what comes, counts what it cannot keep, and leaves a readable file however it ends."""

import resource
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from inspector.errors import CameraError, NothingRecorded, OutputExists, RecordingStopped
from inspector.recorder import RecordingSummary, record
from inspector.recording import SweepReader
from models.frame import Frame
from tests.inspector.recordings import encoded_frame, frame, pixels, same


class Source:
    """A camera of known frames; a step of `steps` is called before the frame of its number."""

    def __init__(self, frames: Iterator[Frame], steps: dict | None = None) -> None:
        self._frames, self._steps = frames, steps or {}

    def frames(self) -> Iterator[Frame]:
        for one in self._frames:
            self._steps.get(one.sequence, lambda: None)()
            yield one

    def describe(self) -> dict[str, str]:
        return {"camera": "test"}


def numbered(count: int) -> Iterator[Frame]:
    return (encoded_frame(n) for n in range(count))


def test_every_frame_is_recorded_with_its_facts(tmp_path):
    seen: list[RecordingSummary] = []
    summary = record(
        Source(numbered(9)),
        tmp_path / "a.mcap",
        product_id="valve",
        part_id="7",
        lossless=True,
        on_progress=seen.append,
    )
    reader = SweepReader(tmp_path / "a.mcap")
    assert [same(f, n) for n, f in enumerate(reader)] == [True] * 9
    assert (reader.losses, reader.drops) == ((), ())
    assert reader.facts == {"camera": "test", "product_id": "valve", "part_id": "7"}
    assert (summary.frames, summary.drops, summary.seconds) == (9, 0, 0.32)
    assert summary.bytes == (tmp_path / "a.mcap").stat().st_size
    assert [s.frames for s in seen] == list(range(1, 10))


@pytest.mark.parametrize(("limit", "expected"), [({"frames": 4}, 4), ({"seconds": 0.2}, 6), ({}, 20)])
def test_it_stops_where_asked(tmp_path, limit, expected):
    summary = record(Source(numbered(20)), tmp_path / "a.mcap", lossless=True, **limit)
    assert summary.frames == len(list(SweepReader(tmp_path / "a.mcap"))) == expected


def test_stop_closes_the_file_properly(tmp_path):
    stop = threading.Event()
    record(Source(numbered(20), {5: stop.set}), tmp_path / "a.mcap", stop=stop, lossless=True)
    reader = SweepReader(tmp_path / "a.mcap")
    assert [f.sequence for f in reader] == [0, 1, 2, 3, 4]
    assert reader.losses == ()


@pytest.mark.parametrize("goes_on", [True, False])
def test_frames_for_which_there_is_no_room_are_counted_and_recorded_as_drops(tmp_path, goes_on):
    held, go, drained = threading.Event(), threading.Event(), threading.Event()
    calls = iter(range(1, 100))

    def clock() -> float:
        # Asked once at the beginning and then once for each frame: the first is held up, as by a slow disk.
        call = next(calls)
        if call == 2:
            held.set()
            assert go.wait(30)
        if call == 5:
            drained.set()
        return 0.0

    def frames() -> Iterator[Frame]:
        yield encoded_frame(0)
        assert held.wait(30)
        yield from (encoded_frame(n) for n in range(1, 10))
        go.set()
        if goes_on:
            assert drained.wait(30)
            yield encoded_frame(10)

    summary = record(Source(frames()), tmp_path / "a.mcap", queue_size=3, clock=clock)
    reader = SweepReader(tmp_path / "a.mcap")
    kept = [0, 1, 2, 3, 10] if goes_on else [0, 1, 2, 3]
    assert [f.sequence for f in reader] == kept
    assert (summary.frames, summary.drops) == (len(kept), 6)
    assert [(drop.count, drop.t_ns) for drop in reader.drops] == [(6, encoded_frame(10 if goes_on else 9).t_ns)]
    assert reader.losses == ()


def test_a_camera_that_fails_leaves_what_it_gave(tmp_path):
    def fail() -> None:
        raise CameraError("camera test: cable out")

    with pytest.raises(CameraError, match="cable out"):
        record(Source(numbered(9), {6: fail}), tmp_path / "a.mcap", lossless=True)
    reader = SweepReader(tmp_path / "a.mcap")
    assert len(list(reader)) == 6
    assert reader.losses == ()


def test_a_camera_that_gives_nothing_leaves_no_file(tmp_path):
    with pytest.raises(NothingRecorded, match="delivered no picture"):
        record(Source(iter(())), tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_refused_before_the_camera_is_asked(tmp_path):
    (tmp_path / "a.mcap").touch()
    with pytest.raises(OutputExists):
        record(Source(numbered(1), {0: pytest.fail}), tmp_path / "a.mcap")


def test_a_full_disk_ends_it_and_tells_how_many_frames_are_saved(tmp_path):
    big = (frame(n, pixels=pixels(n, (60, 80))) for n in range(10_000))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, hard))
    try:
        with pytest.raises(RecordingStopped, match=r"a\.mcap: recording stopped: File too large") as caught:
            record(Source(big), tmp_path / "a.mcap", flush_seconds=0.0, lossless=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    frames = list(SweepReader(tmp_path / "a.mcap"))
    assert len(frames) == caught.value.saved > 10
    assert all(np.array_equal(f.pixels, pixels(n, (60, 80))) for n, f in enumerate(frames))


ENDLESS = """
import itertools, sys
from inspector.recorder import record
from tests.inspector.recordings import encoded_frame
from tests.inspector.test_recorder import Source

def tell(summary):
    print(summary.frames, summary.bytes, flush=True)

record(Source(encoded_frame(n) for n in itertools.count()), sys.argv[1], flush_seconds=0.0, lossless=True,
       queue_size=4, on_progress=tell)
"""


def test_after_a_kill_everything_that_was_flushed_is_readable(tmp_path):
    path = tmp_path / "a.mcap"
    root = Path(__file__).parents[2]
    with subprocess.Popen(
        [sys.executable, "-c", ENDLESS, str(path)], stdout=subprocess.PIPE, text=True, cwd=root
    ) as process:
        assert process.stdout is not None
        kept = next(kept for kept, _ in (map(int, line.split()) for line in process.stdout) if kept >= 40)
        process.send_signal(signal.SIGKILL)
    reader = SweepReader(path)
    frames = list(reader)
    # Offered, less what the queue and the writer's hands can hold: each written frame was flushed at once.
    assert len(frames) >= kept - 4 - 1
    assert all(same(f, n) for n, f in enumerate(frames))
    assert len(reader.losses) == 1
