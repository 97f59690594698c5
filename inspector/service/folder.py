"""The data folder: one service at a time, and paths only from ids that the server made.

    service.sqlite    service.lock    incoming/
    sweeps/ID.mcap    appearances/HASH.appearance    inspections/ID.mcap    workspaces/HASH.workspace

inspector.errors.WorldError
├── FolderInUse              a data folder that another service works on
├── FolderRefused            a data folder that cannot be made, or written to
└── NoFileId                 an id that this program does not make
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

from inspector.errors import WorldError

_ID = re.compile(r"[0-9a-f]{32}")
_HASH = re.compile(r"sha256:([0-9a-f]{64})")


class FolderInUse(WorldError):
    """A data folder that another service works on."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path}: another service works on this folder; stop it, or name another with --data")


class FolderRefused(WorldError):
    """A data folder that cannot be made, or written to."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: {why}; allowed is a folder that this program may write to")


class NoFileId(WorldError):
    """An id that this program does not make; no path is made from it."""

    def __init__(self, id: str) -> None:
        super().__init__(f"{id[:80]!r} is no id of a file; allowed are those that the service gives")


def new_id() -> str:
    """An id that nothing has."""
    return uuid4().hex


class DataFolder:
    """The folder, locked for as long as this is open. What is in `incoming` when it is opened is removed."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        try:
            for name in ("sweeps", "appearances", "inspections", "workspaces", "incoming"):
                (self.path / name).mkdir(parents=True, exist_ok=True)
            # Nobody but the owner may change or replace it, whatever the umask says.
            self._lock = os.open(self.path / "service.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise FolderRefused(path, error.strerror or str(error)) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._lock)
            raise FolderInUse(path) from error
        self._open = True
        for left in (self.path / "incoming").iterdir():
            shutil.rmtree(left) if left.is_dir() else left.unlink()

    def close(self) -> None:
        """Let another service have it. A second call does nothing."""
        if self._open:
            self._open = False
            os.close(self._lock)

    def incoming(self) -> Path:
        """A new name for what is being received, or made."""
        return self.path / "incoming" / new_id()

    def check_writable(self) -> None:
        """Raises FolderRefused where nothing can be written any more."""
        try:
            with tempfile.TemporaryFile(dir=self.path / "incoming") as file:
                file.write(b"ready?")
                file.flush()
        except OSError as error:
            raise FolderRefused(self.path, error.strerror or str(error)) from error

    def hidden(self, said: str) -> str:
        """A sentence without the place of the folder, for strangers."""
        return said.replace(f"{self.path}{os.sep}", "").replace(str(self.path), "the data folder")

    @staticmethod
    def checked(id: str) -> str:
        """An id that this program made. Raises NoFileId for any other."""
        if _ID.fullmatch(id) is None:
            raise NoFileId(id)
        return id

    @staticmethod
    def hash_of(id: str) -> str:
        """The hash in the id of what was learnt. Raises NoFileId."""
        found = _HASH.fullmatch(id)
        if found is None:
            raise NoFileId(id)
        return found[1]


def remove(path: Path) -> None:
    """Nothing is there afterwards; it does not matter whether something was."""
    with suppress(OSError):
        path.unlink(missing_ok=True)
