"""USB cameras, network streams and video files through OpenCV: `opencv:0`, `opencv:rtsp://host/stream`, `opencv:a.mp4`.

An address that has a query of its own closes it by one more `?`: `opencv:rtsp://host/stream?channel=1?grey=1`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Self

import cv2
import numpy as np

from inspector.cameras.base import (
    AbstractCamera,
    CameraNotOpened,
    CameraStopped,
    Clock,
    OptionRefused,
    hide_password,
)
from inspector.cameras.options import flag, number, read, whole
from models.frame import Frame

# FFmpeg prints addresses to stderr, passwords included; what went wrong is said by our own error. It reads this once.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
LOGGING: Any = getattr(cv2.utils, "logging", cv2)
"""OpenCV 5 moved the log level here; in 4 it is in `cv2` itself, under the same names."""


@dataclass(frozen=True)
class OpenCVOptions:
    """What can be asked; 0 leaves it to the camera."""

    width: int = whole(0, 0, 65_535)
    height: int = whole(0, 0, 65_535)
    fps: float = number(0.0, 0, 100_000)
    grey: bool = flag()
    """Make colour pictures grey."""
    timeout: float = number(5.0, 0.1, 3_600)
    """Seconds to wait for a network stream."""


class OpenCVCamera(AbstractCamera):
    """A video file has its own times and ends; a live camera has the clock's and ends when it is closed or stops."""

    def __init__(self, source: str, options: OpenCVOptions, clock: Clock) -> None:
        self._source, self._options, self._clock = source, options, clock
        self._file = Path(source).is_file()
        self._start_ns = Path(source).stat().st_mtime_ns if self._file else 0
        if self._file:
            _refuse_for_files(options)
        self._lock, self._closed = Lock(), False
        self._capture = _open(source, options, self._file)
        self._count = 0

    @classmethod
    def open(cls, place: str, query: dict[str, str], clock: Clock) -> Self:
        """See AbstractCamera."""
        return cls(place, read("opencv", OpenCVOptions, query), clock)

    def describe(self) -> dict[str, str]:
        """See AbstractCamera."""
        source = Path(self._source).name if self._file else hide_password(self._source)
        with self._lock:
            size = [str(int(self._capture.get(p))) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)]
            fps = self._capture.get(cv2.CAP_PROP_FPS)
        return {"camera": "opencv", "source": source, "width": size[0], "height": size[1], "fps": f"{fps:g}"}

    def close(self) -> None:
        """See AbstractCamera. Waits for the picture that is being read."""
        with self._lock:
            self._closed = True
            self._capture.release()

    def frames(self) -> Iterator[Frame]:
        """See AbstractCamera. A second call goes on where the first was left."""
        before = -1
        while (taken := self._take()) is not None:
            pixels, t_ns = taken
            t_ns = max(t_ns, before + 1)  # some containers repeat a time
            before, sequence, self._count = t_ns, self._count, self._count + 1
            yield Frame(pixels, t_ns, sequence)

    def _take(self) -> tuple[np.ndarray, int] | None:
        """The next picture and its time; None at the end of a file or when closed."""
        with self._lock:
            if self._closed:
                return None
            grabbed = self._capture.grab()
            t_ns = self._start_ns + round(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
            t_ns = t_ns if self._file else self._clock.now_ns()
            good, pixels = self._capture.retrieve() if grabbed else (False, None)
        if good and pixels is not None:
            if self._options.grey and pixels.ndim == 3:
                pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
            return pixels, t_ns
        if grabbed or not self._file or not self._count:
            raise CameraStopped(f"opencv:{self._source}", self._count, "it delivers no picture")
        return None


def _refuse_for_files(options: OpenCVOptions) -> None:
    for name in ("width", "height", "fps"):
        if value := getattr(options, name):
            raise OptionRefused("opencv", name, f"{value:g}", "only a live camera; a video file has its own")


def _open(source: str, options: OpenCVOptions, file: bool) -> cv2.VideoCapture:
    network = "://" in source
    if not (file or network or source.isdecimal() or Path(source).exists()):
        raise CameraNotOpened(f"opencv:{source}", "there is no such device or video file")
    level = LOGGING.getLogLevel()
    LOGGING.setLogLevel(0)  # silent: what goes wrong is said once, by us
    try:
        capture = _capture(source, options, network)
    finally:
        LOGGING.setLogLevel(level)
    if not capture.isOpened():
        why = "is not a video that can be read" if file else "cannot be opened; is it connected, and free?"
        raise CameraNotOpened(f"opencv:{source}", why)
    return capture


def _capture(source: str, options: OpenCVOptions, network: bool) -> cv2.VideoCapture:
    if network:
        wait = int(1000 * options.timeout)
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, wait, cv2.CAP_PROP_READ_TIMEOUT_MSEC, wait]
        return cv2.VideoCapture(source, cv2.CAP_FFMPEG, limits)
    capture = cv2.VideoCapture(int(source)) if source.isdecimal() else cv2.VideoCapture(source)
    wishes = {"width": cv2.CAP_PROP_FRAME_WIDTH, "height": cv2.CAP_PROP_FRAME_HEIGHT, "fps": cv2.CAP_PROP_FPS}
    for name, setting in wishes.items():
        if capture.isOpened() and (value := getattr(options, name)) and not capture.set(setting, value):
            capture.release()
            raise OptionRefused("opencv", name, f"{value:g}", "what the camera can do, and it refuses this")
    return capture
