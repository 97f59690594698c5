"""Video files and streams through OpenCV; the stream is served by this machine to itself."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from itertools import count
from pathlib import Path
from threading import Thread

import cv2
import numpy as np
import pytest

from inspector.cameras import Clock, open_camera
from inspector.cameras.base import CameraNotOpened, CameraStopped, OptionRefused
from tests.contracts.cameras import ONE_SENTENCE, CameraContract

BRIGHTNESS = [10, 60, 110, 160, 210]


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """Five pictures of one brightness each, 25 a second."""
    writer = cv2.VideoWriter(str(tmp_path / "part.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48), True)
    for brightness in BRIGHTNESS:
        writer.write(np.full((48, 64, 3), brightness, np.uint8))
    writer.release()
    return tmp_path / "part.avi"


class QuietHandler(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


@pytest.fixture
def stream(video: Path) -> Iterator[str]:
    """The same video over the network, where nothing tells that it is a file."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(QuietHandler, directory=str(video.parent))) as server:
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield f"http://operator:secret@127.0.0.1:{server.server_port}/{video.name}"
        server.shutdown()
        thread.join()


class TestVideoFileContract(CameraContract):
    @pytest.fixture
    def url(self, video: Path) -> str:
        return f"opencv:{video}"


def test_a_video_file_gives_its_pictures_at_its_own_times(video: Path) -> None:
    with open_camera(f"opencv:{video}") as camera:
        frames = list(camera.frames())
    start = video.stat().st_mtime_ns
    assert [frame.t_ns - start for frame in frames] == [40_000_000 * k for k in range(5)]
    assert [frame.pixels.shape for frame in frames] == [(48, 64, 3)] * 5
    assert np.abs(np.array([frame.pixels.mean() for frame in frames]) - BRIGHTNESS).max() < 3


def test_grey_gives_one_channel(video: Path) -> None:
    with open_camera(f"opencv:{video}?grey=1") as camera:
        assert next(camera.frames()).pixels.shape == (48, 64)


@pytest.mark.parametrize("option", ["width=640", "height=480", "fps=30"])
def test_a_video_file_takes_no_wishes_for_a_live_camera(video: Path, option: str) -> None:
    with pytest.raises(OptionRefused, match="only a live camera; a video file has its own"):
        open_camera(f"opencv:{video}?{option}")


def test_a_stream_has_the_times_of_the_clock_and_says_when_it_stops(stream: str) -> None:
    ticks = count(1_000, 7)
    with open_camera(f"opencv:{stream}", Clock(lambda: next(ticks))) as camera:
        frames = camera.frames()
        assert [next(frames).t_ns for _ in BRIGHTNESS] == [1_000, 1_007, 1_014, 1_021, 1_028]
        with pytest.raises(CameraStopped, match="stopped after 5 frames: it delivers no picture") as stopped:
            next(frames)
        assert "secret" not in str(stopped.value) + str(camera.describe())


def test_times_increase_even_where_the_clock_stands(stream: str) -> None:
    with open_camera(f"opencv:{stream}", Clock(lambda: 500)) as camera:
        frames = camera.frames()
        assert [next(frames).t_ns for _ in range(3)] == [500, 501, 502]


def test_what_cannot_be_opened_is_said_in_one_sentence_and_nothing_else(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    junk = tmp_path / "junk.avi"
    junk.write_bytes(b"no video " * 99)
    for source, why in [
        (f"{tmp_path}/none.mp4", "there is no such device or video file"),
        (str(junk), "is not a video that can be read"),
        ("99", "cannot be opened; is it connected, and free?"),
        ("rtsp://operator:secret@127.0.0.1:9/stream", "cannot be opened; is it connected, and free?"),
    ]:
        with pytest.raises(CameraNotOpened) as refused:
            open_camera(f"opencv:{source}")
        assert str(refused.value).endswith(why)
        assert "secret" not in str(refused.value)
        assert ONE_SENTENCE.fullmatch(str(refused.value))
    assert capfd.readouterr() == ("", "")
