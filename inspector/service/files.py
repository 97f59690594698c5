"""Finished files of a service: in its data folder, in a folder of several services, or in a bucket.

    sweeps/ID.mcap    appearances/HASH.appearance    inspections/ID.mcap    workspaces/HASH.workspace
    parts/ID.TAKE.mcap       what one service recorded of an inspection that went on at another one

What is being written is always in the data folder, and on its disk before it is published.

inspector.objects.ObjectError
└── FileDamaged              a learnt file that is not what its name says
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import threading
from abc import ABC, abstractmethod
from contextlib import suppress
from pathlib import Path
from typing import Literal, TypeAlias

from inspector.errors import OutputExists
from inspector.files import NotWritten, arriving, sync
from inspector.locations import Location, RemoteFile, to_location
from inspector.objects import ObjectError, Objects, ObjectTaken, beneath
from inspector.service.folder import DataFolder, FolderRefused, NoFileId, remove

Learnt: TypeAlias = Literal["appearance", "workspace"]
Kind: TypeAlias = Literal["sweep", "inspection", "part", "appearance", "workspace"]
_PART = re.compile(r"[0-9a-f]{32}\.\d{1,9}")
_TAPE = re.compile(r"([0-9a-f]{32})(?:\.(\d+))?\.mcap")
_UNUSED_NS = 7 * 86_400_000_000_000
"""A copy that nobody asked for in so long is fetched again by who asks."""


class FileDamaged(ObjectError):
    """A learnt file that is not what its name says."""

    def __init__(self, place: str) -> None:
        super().__init__(f"{place}: what is in it is not what its name says; learn it again, or bring a copy")


class Files:
    """Where files are, for readers in any process. Ids are checked: raises NoFileId. Everything here may block.

    `url` is `file:///FOLDER` or `s3://BUCKET/PREFIX?endpoint=...`; None is the data folder itself.
    """

    def __init__(self, folder: DataFolder, url: str | None = None) -> None:
        self._folder = folder
        self._kept: _Kept = _Own(folder.path) if url is None else _apart(url)
        self.common = url is not None
        """Whether other services have these files, too."""
        self._tapes = folder.path / "tapes"
        self._tapes.mkdir(exist_ok=True)
        self._copies = threading.Lock()

    def place(self, kind: Kind, id: str) -> str:
        """Where it is or will be: a path or a URL, which readers in any process understand."""
        found = self.location(kind, id)
        return str(found) if isinstance(found, Path) else found.url

    def location(self, kind: Kind, id: str) -> Location:
        """The same, to read from: a file of this computer, or one in a bucket."""
        return self._kept.location(self._name(kind, id))

    def local(self, kind: Learnt, id: str) -> Path:
        """A learnt file, on this computer: fetched from a bucket once, and checked by its name, which is its hash.

        Such a copy stays for a week from now. Raises ObjectError.
        """
        found = self.location(kind, id)
        if isinstance(found, Path):
            return found
        copy = self._folder.path / self._name(kind, id)
        with self._copies:
            _use(copy)
            if copy.exists():
                return copy
        self._fetch(found, copy)
        return copy

    def drop_copies(self, now_ns: int) -> None:
        """Copies of learnt files that nobody asked for in a week go, where they are still in the bucket.

        Raises ObjectError.
        """
        if not isinstance(self._kept, _InBucket):
            return
        for kind in ("appearance", "workspace"):
            for copy in (self._folder.path / f"{kind}s").glob(f"*.{kind}"):
                facts = copy.stat()
                if now_ns - facts.st_mtime_ns < _UNUSED_NS:
                    continue
                there = self._kept.size(f"{kind}s/{copy.name}") == facts.st_size
                with self._copies:
                    if not there:
                        # Of a time without this bucket, and the only one: looked at again in a week.
                        _use(copy)
                    elif copy.stat().st_mtime_ns == facts.st_mtime_ns:
                        remove(copy)

    def local_appearance(self, appearance_id: str) -> Path:
        """What was learnt, on this computer. Raises ObjectError."""
        return self.local("appearance", appearance_id)

    def publish(self, draft: Path, kind: Kind, id: str) -> None:
        """What was received, made or recorded becomes a file that stays, whole; the draft is gone then.

        What is there already, by the same name and of the same size, is the same. Raises NotWritten, ObjectError,
        and then the draft is still there.
        """
        name, place = self._name(kind, id), self.location(kind, id)
        if draft == place:
            return
        try:
            sync(draft)
            self._kept.add(draft, name)
            if isinstance(place, RemoteFile) and kind in ("appearance", "workspace"):
                # The copy that this service would fetch.
                draft.rename(self._folder.path / name)
            else:
                draft.unlink(missing_ok=True)
        except OSError as error:
            raise NotWritten(Path(str(place)), error.strerror or str(error)) from error

    def size(self, kind: Kind, id: str) -> int | None:
        """Bytes; None where there is no such file. Raises ObjectError."""
        return self._kept.size(self._name(kind, id))

    def remove(self, kind: Kind, id: str) -> None:
        """Nothing is there afterwards; it does not matter whether something was. Raises OSError, ObjectError."""
        self._kept.remove(self._name(kind, id))

    def tape(self, inspection_id: str, take: int = 0) -> Path:
        """Where a running inspection is recorded here: by the so-manieth service that has it."""
        if take == 0 and (path := self._own("inspection", inspection_id)) is not None:
            return path
        return self._tapes / f"{DataFolder.checked(inspection_id)}.{take}.mcap"

    def whole(self, inspection_id: str) -> Path:
        """Where its recording waits to be published, when it is closed and whole."""
        return self._own("inspection", inspection_id) or self._tapes / f"{DataFolder.checked(inspection_id)}.mcap"

    def waiting(self, inspection_id: str) -> Path | None:
        """A whole recording that waits here to be published; it may be gone, to where it is kept, at any time."""
        path = self.whole(inspection_id)
        return path if self.common and path.exists() else None

    def left(self) -> tuple[tuple[str, int | None, Path], ...]:
        """What waits here to be published: inspection, take (None: the whole recording), and the file."""
        found = [(_TAPE.fullmatch(path.name), path) for path in sorted(self._tapes.iterdir())]
        return tuple((match[1], None if match[2] is None else int(match[2]), path) for match, path in found if match)

    def incoming(self) -> Path:
        """A new name for what is being received, or made, in the data folder."""
        return self._folder.incoming()

    def free(self) -> int | None:
        """Bytes that may still be written where files are; None in a bucket, which knows no end."""
        return self._kept.free()

    def check(self) -> None:
        """Raises FolderRefused, ObjectError where nothing can be kept."""
        self._folder.check_writable()
        self._kept.check()

    def hidden(self, said: str) -> str:
        """A sentence without the places of folders, for strangers."""
        return self._folder.hidden(self._kept.hidden(said))

    def _own(self, kind: Kind, id: str) -> Path | None:
        return None if self.common else self._folder.path / self._name(kind, id)

    def _fetch(self, place: RemoteFile, path: Path) -> None:
        draft, sha256 = self._folder.incoming(), hashlib.sha256()
        try:
            with draft.open("xb") as file:
                for piece in place.stream()[1]:
                    sha256.update(piece)
                    file.write(piece)
            if sha256.hexdigest() != path.stem:
                raise FileDamaged(str(place))
            sync(draft)
            draft.rename(path)
        except OSError as error:
            raise NotWritten(path, error.strerror or str(error)) from error
        finally:
            remove(draft)

    @staticmethod
    def _name(kind: Kind, id: str) -> str:
        match kind:
            case "sweep" | "inspection":
                return f"{kind}s/{DataFolder.checked(id)}.mcap"
            case "part":
                if _PART.fullmatch(id) is None:
                    raise NoFileId(id)
                return f"parts/{id}.mcap"
            case _:
                return f"{kind}s/{DataFolder.hash_of(id)}.{kind}"


class _Kept(ABC):
    """Files by names, kept."""

    @abstractmethod
    def location(self, name: str) -> Location: ...

    @abstractmethod
    def add(self, draft: Path, name: str) -> None:
        """Raises OSError, NotWritten, ObjectError."""

    @abstractmethod
    def size(self, name: str) -> int | None: ...

    @abstractmethod
    def remove(self, name: str) -> None: ...

    @abstractmethod
    def free(self) -> int | None: ...

    @abstractmethod
    def check(self) -> None: ...

    @abstractmethod
    def hidden(self, said: str) -> str: ...


class _OnDisk(_Kept):
    """In a folder."""

    def __init__(self, root: Path) -> None:
        self._root = root
        try:
            for name in ("sweeps", "appearances", "inspections", "workspaces", "parts"):
                (root / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FolderRefused(root, error.strerror or str(error)) from error

    def location(self, name: str) -> Path:
        return self._root / name

    def size(self, name: str) -> int | None:
        path = self._root / name
        return path.stat().st_size if path.is_file() else None

    def remove(self, name: str) -> None:
        (self._root / name).unlink(missing_ok=True)

    def free(self) -> int:
        return shutil.disk_usage(self._root).free

    def check(self) -> None:
        if not os.access(self._root, os.W_OK | os.X_OK):
            raise FolderRefused(self._root, "it is gone, or cannot be written to")

    def hidden(self, said: str) -> str:
        return said.replace(f"{self._root}{os.sep}", "").replace(str(self._root), "the folder of files")


class _Own(_OnDisk):
    """In the data folder itself: a draft is on the same disk, and is given its name."""

    def add(self, draft: Path, name: str) -> None:
        path = self._root / name
        draft.rename(path)
        sync(path.parent)

    def hidden(self, said: str) -> str:
        return said


class _Apart(_OnDisk):
    """In a folder of several services, perhaps on another disk: copied, and then given a name that nothing has."""

    def add(self, draft: Path, name: str) -> None:
        path = self._root / name
        try:
            with arriving(path) as copy:
                shutil.copyfile(draft, copy)
        except OutputExists:
            if not _same(draft, self.size(name)):
                raise


class _InBucket(_Kept):
    """In a bucket."""

    def __init__(self, objects: Objects) -> None:
        self._objects = objects

    def location(self, name: str) -> RemoteFile:
        return RemoteFile(beneath(self._objects.url, name))

    def add(self, draft: Path, name: str) -> None:
        try:
            self._objects.put_new(name, draft)
        except ObjectTaken:
            if not _same(draft, self.size(name)):
                raise

    def size(self, name: str) -> int | None:
        return self._objects.size(name)

    def remove(self, name: str) -> None:
        self._objects.remove(name)

    def free(self) -> None:
        return None

    def check(self) -> None:
        self._objects.check()

    def hidden(self, said: str) -> str:
        return said


def _apart(url: str) -> _Kept:
    place = to_location(url)
    return _Apart(place.absolute()) if isinstance(place, Path) else _InBucket(Objects(place.url))


def _same(draft: Path, size: int | None) -> bool:
    """It was brought before, and the answer was lost; or learnt before, to the same bytes."""
    return draft.stat().st_size == size


def _use(copy: Path) -> None:
    """It is of use now, if it is there."""
    with suppress(OSError):
        os.utime(copy)
