"""What every camera promises, and what can go wrong with one.

inspector.errors.CameraError
├── UnknownCamera        a url whose scheme no camera has
├── UnknownOption        an option that this camera does not have
├── OptionRefused        an option whose value is not allowed
├── CameraNotOpened      a source that is not there, or that delivers nothing
└── CameraStopped        a source that failed after it was opened
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self
from urllib.parse import parse_qsl

from inspector.errors import CameraError
from models.frame import Frame


class UnknownCamera(CameraError):
    """A url whose scheme no camera has."""

    def __init__(self, url: str, known: tuple[str, ...]) -> None:
        super().__init__(f"camera {hide_password(url)!r}: no such kind of camera; known are {', '.join(known)}")


class UnknownOption(CameraError):
    """An option that this camera does not have."""

    def __init__(self, camera: str, name: str, known: tuple[str, ...]) -> None:
        super().__init__(f"camera {camera}: unknown option {name!r}; known are {', '.join(known)}")


class OptionRefused(CameraError):
    """An option whose value is not allowed."""

    def __init__(self, camera: str, name: str, value: str, allowed: str) -> None:
        super().__init__(f"camera {camera}: option {name}={value!r} is not allowed; allowed is {allowed}")


class CameraNotOpened(CameraError):
    """A source that is not there, or that delivers nothing."""

    def __init__(self, source: str, why: str) -> None:
        super().__init__(f"camera {hide_password(source)}: {why}")


class CameraStopped(CameraError):
    """A source that failed after it was opened; what it delivered before is whole."""

    def __init__(self, source: str, frames: int, why: str) -> None:
        super().__init__(f"camera {hide_password(source)}: stopped after {frames} frames: {why}")


@dataclass(frozen=True)
class Clock:
    """The time and the wait that a camera uses; tests hand in their own."""

    now_ns: Callable[[], int] = time.time_ns
    """Nanoseconds since the epoch."""
    sleep: Callable[[float], None] = time.sleep
    """Waits so many seconds."""

    def wait_until(self, t_ns: int) -> None:
        """Return at that time, or at once where it has passed."""
        if (left := t_ns - self.now_ns()) > 0:
            self.sleep(left / 1e9)


class AbstractCamera(ABC):
    """A source of frames. A context manager: leaving it closes it."""

    @classmethod
    @abstractmethod
    def open(cls, place: str, query: dict[str, str], clock: Clock) -> Self:
        """The camera at `place` (what stands between scheme and `?`), with the options of `query`."""

    @abstractmethod
    def frames(self) -> Iterator[Frame]:
        """The frames in order of exposure. `sequence` counts from 0 and skips what was lost; ends after `close`."""

    @abstractmethod
    def describe(self) -> dict[str, str]:
        """Facts that belong into a recording's metadata; never a password."""

    @abstractmethod
    def close(self) -> None:
        """Let the source go; a second call does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def split_url(url: str) -> tuple[str, str, dict[str, str]]:
    """Scheme, place and options of a camera's url.

    The last `?` begins the options, so that an address may have a query of its own, closed by one more `?`.

    >>> split_url("opencv:rtsp://host/stream?channel=2?grey=1")
    ('opencv', 'rtsp://host/stream?channel=2', {'grey': '1'})
    """
    scheme, _, rest = url.partition(":")
    place, mark, query = rest.rpartition("?")
    if not mark:
        place, query = rest, ""
    return scheme, place, dict(parse_qsl(query, keep_blank_values=True))


def waits(camera: str) -> bool:
    """Whether this source can wait for the disk: pictures, video files and unpaced simulations; a live camera cannot.

    >>> waits("folder:shots"), waits("simulated:?realtime=1"), waits("opencv:0")
    (True, False, False)
    """
    scheme, place, query = split_url(camera)
    if scheme == "simulated":
        return query.get("realtime", "0").lower() in ("0", "false", "no")
    return scheme == "folder" or (scheme == "opencv" and Path(place).is_file())


def hide_password(url: str) -> str:
    """The url without the name and password in it, for messages and metadata.

    >>> hide_password("rtsp://admin:secret@10.0.0.7/stream")
    'rtsp://***@10.0.0.7/stream'
    """
    head, mark, rest = url.partition("//")
    authority, slash, path = rest.partition("/")
    user, at, host = authority.rpartition("@")
    return f"{head}{mark}***@{host}{slash}{path}" if mark and at and user else url
