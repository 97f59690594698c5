"""What can go wrong in the world; every class writes its own sentence.

models.errors.InspectionError
└── WorldError
    ├── CameraError              a camera that cannot be opened, or that stopped
    ├── PictureUnreadable        bytes that are no whole picture
    │   └── PictureTooLarge      a picture with more pixels than allowed
    ├── RecordingError           a recording that cannot be read or written
    │   ├── NotARecording        a file that is missing, or is no MCAP
    │   ├── NoPictures           a recording that holds no readable picture
    │   ├── ManyCameras          several topics with pictures, and none chosen
    │   ├── NoSuchTopic          a chosen topic that has no pictures
    │   ├── NotRecorded          a recording that cannot be begun
    │   ├── NothingRecorded      a camera that delivered no picture to record
    │   └── RecordingStopped     a recording that could not be written on
    ├── StoreError               a database that does not do what was asked (inspector.stores.errors)
    └── OutputExists             a file that would be overwritten
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from models.errors import InspectionError


class WorldError(InspectionError):
    """Raised by `inspector`: a file, a camera or a disk did not do what was asked."""


class CameraError(WorldError):
    """A camera that cannot be opened, or that stopped delivering."""


class PictureUnreadable(WorldError):
    """Bytes that are no whole picture: cut, patched, or of a kind that is not read."""

    def __init__(self, kind: str, size: int, why: str) -> None:
        super().__init__(f"{kind} picture of {size} bytes: {why}")


class PictureTooLarge(PictureUnreadable):
    """A picture whose header announces more pixels than allowed."""

    def __init__(self, kind: str, size: int, width: int, height: int, max_pixels: int) -> None:
        super().__init__(kind, size, f"{width}x{height} pixels announced, allowed are {max_pixels} in all")


class RecordingError(WorldError):
    """A recording that cannot be read or written."""


class NotARecording(RecordingError):
    """A file that is missing, or that is no MCAP."""

    def __init__(self, path: object, why: str) -> None:
        super().__init__(f"{path}: {why}; allowed is an MCAP recording, or a folder that holds one")


class NoPictures(RecordingError):
    """A recording that holds no readable picture."""

    def __init__(self, path: object, why: str) -> None:
        super().__init__(
            f"{path}: no readable picture: {why}; read are CompressedImage and RawImage of foxglove"
            " (protobuf, JSON), CompressedImage and Image of sensor_msgs (ROS 1, ROS 2)"
        )


class ManyCameras(RecordingError):
    """Several topics with pictures, and none chosen."""

    def __init__(self, path: object, topics: Sequence[str]) -> None:
        super().__init__(f"{path}: pictures on {len(topics)} topics, choose one of {', '.join(topics)}")


class NoSuchTopic(RecordingError):
    """A chosen topic that has no pictures."""

    def __init__(self, path: object, topic: str, topics: Sequence[str]) -> None:
        super().__init__(f"{path}: no pictures on topic {topic}, allowed is {' or '.join(topics)}")


class NotRecorded(RecordingError):
    """A recording that cannot be begun."""

    def __init__(self, path: object, why: str) -> None:
        super().__init__(f"{path} cannot be written: {why}; name a file in a folder that is there and writable")


class NothingRecorded(RecordingError):
    """A camera that delivered no picture to record."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path} was not written: the camera delivered no picture")


class RecordingStopped(RecordingError):
    """A recording that could not be written on: a full disk, as a rule."""

    def __init__(self, path: Path, saved: int, why: str) -> None:
        self.saved = saved
        super().__init__(f"{path}: recording stopped: {why}; at least the first {saved} frames are saved and readable")


class StoreError(WorldError):
    """A database that cannot be opened, failed, or does not hold what was asked for."""


class OutputExists(WorldError):
    """A file that would be overwritten."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path} exists already; name another file, or remove it first")
