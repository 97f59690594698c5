"""A small simulated line for the tests: short sweeps of few pixels, recorded as the command line records them."""

from __future__ import annotations

from pathlib import Path

from inspector.cameras import open_camera
from inspector.recorder import record

SMALL = "simulated:?size=160x120&path=line&frames=60"
SPOT = "unit=4&seed=14&defect=spot&at=0.5"


def url(options: str) -> str:
    """A small sweep over the plate."""
    return f"{SMALL}&{options}"


def recorded(path: Path, options: str, **facts: str) -> Path:
    """The sweep as a recording."""
    with open_camera(url(options)) as camera:
        record(camera, path, lossless=True, **facts)
    return path


def cut(path: Path, out: Path, share: float) -> Path:
    """The first part of a recording, as a power cut leaves it."""
    data = path.read_bytes()
    out.write_bytes(data[: int(share * len(data))])
    return out
