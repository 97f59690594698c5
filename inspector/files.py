"""Files appear whole or not at all, and never in place of another.

inspector.errors.WorldError
└── NotWritten               a file that cannot be written: no such folder, no right to, no room
"""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from inspector.errors import OutputExists, WorldError


class NotWritten(WorldError):
    """A file that cannot be written: no such folder, no right to, no room."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(
            f"{path} cannot be written: {why}; name a file in a folder that is there, writable and not full"
        )


def refuse_taken(path: Path) -> None:
    """Raise before long work what would be raised after it: the file exists, or its folder cannot be written to."""
    if path.exists() or path.is_symlink():
        raise OutputExists(path)
    if not path.parent.is_dir():
        raise NotWritten(path, f"there is no folder {path.parent}")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise NotWritten(path, f"no right to write in {path.parent}")


@contextmanager
def arriving(path: Path) -> Generator[Path]:
    """A path in the same folder to write to; what is there in the end becomes `path`, unless something was raised.

    Raises OutputExists, NotWritten.
    """
    refuse_taken(path)
    draft = path.with_name(f".{path.name}.{uuid4().hex[:8]}")
    try:
        yield draft
        with _blamed_on(path):
            _publish(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def write_new(path: Path, data: bytes) -> None:
    """The bytes as a new file. Raises OutputExists, NotWritten."""
    with arriving(path) as draft, _blamed_on(path):
        draft.write_bytes(data)


@contextmanager
def _blamed_on(path: Path) -> Generator[None]:
    try:
        yield
    except OSError as error:
        raise NotWritten(path, error.strerror or str(error)) from error


def _publish(draft: Path, path: Path) -> None:
    """A link fails where the name is taken, which a rename does not; but some file systems know no links."""
    sync(draft)
    try:
        os.link(draft, path)
    except FileExistsError as error:
        raise OutputExists(path) from error
    except OSError:
        refuse_taken(path)
        draft.rename(path)
    with suppress(OSError):
        # The name itself; not every file system can.
        sync(path.parent)


def sync(path: Path) -> None:
    """What was written is on the disk when this returns."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
