"""What can go wrong in the world; every class writes its own sentence.

models.errors.InspectionError
└── WorldError
    ├── CameraError          a camera that cannot be opened, or that stopped
    ├── RecordingError       a recording that cannot be read or written
    │   └── RecordingLoss    part of a recording is lost (a warning in a value, raised only on demand)
    └── OutputExists         a file that would be overwritten
"""

from __future__ import annotations

from pathlib import Path

from models.errors import InspectionError


class WorldError(InspectionError):
    """Raised by `inspector`: a file, a camera or a disk did not do what was asked."""


class CameraError(WorldError):
    """A camera that cannot be opened, or that stopped delivering."""


class RecordingError(WorldError):
    """A recording that cannot be read or written."""


class OutputExists(WorldError):
    """A file that would be overwritten."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path} exists already; name another file, or remove it first")
