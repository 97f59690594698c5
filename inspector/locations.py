"""Where a file is: a path of this computer, or a URL. Both are read the same way.

Path("a.mcap"), "a.mcap", "file:///data/a.mcap"
"https://host/a.mcap", "s3://bucket/line/a.mcap?endpoint=http://host:9000"
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO, Literal, TypeAlias
from urllib.parse import unquote, urlsplit

from inspector.objects import LocationRefused, Objects, beneath, shown

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")


@dataclass(frozen=True)
class RemoteFile:
    """A file by its URL, with what a Path has that readers ask for. Its text is the URL without secrets."""

    url: str

    def __str__(self) -> str:
        return shown(self.url)

    def __repr__(self) -> str:
        return f"RemoteFile({shown(self.url)!r})"

    @property
    def name(self) -> str:
        """The last part of its path."""
        return PurePosixPath(unquote(urlsplit(shown(self.url)).path)).name

    @property
    def stem(self) -> str:
        """The same without its ending."""
        return PurePosixPath(self.name).stem

    def open(self, mode: Literal["rb"] = "rb") -> BinaryIO:
        """To read and to seek in; fetched as it is read. Raises ObjectError."""
        return Objects(self.url).open()

    def read_bytes(self) -> bytes:
        """All of it. Raises ObjectError."""
        with self.open() as file:
            return file.read()

    def stream(self, start: int = 0, end: int | None = None) -> tuple[int, Iterator[bytes]]:
        """Its size, and what is in it from `start` to `end`, without that, in pieces. Raises ObjectError."""
        return Objects(self.url).stream("", start, end)

    def size(self) -> int | None:
        """Bytes; None where there is nothing by that name. Raises ObjectError."""
        return Objects(self.url).size()

    def is_dir(self) -> bool:
        """False: a URL names a file."""
        return False


Location: TypeAlias = Path | RemoteFile


def is_url(place: Path | RemoteFile | str) -> bool:
    """Whether this is read over a network, or is a `file://`.

    >>> is_url("s3://bucket/a.mcap"), is_url("a.mcap"), is_url("C:/a.mcap")
    (True, False, False)
    """
    return isinstance(place, RemoteFile) or (isinstance(place, str) and _URL.match(place) is not None)


def is_bucket(place: RemoteFile) -> bool:
    """Whether its host tells what it has, as web servers do not."""
    return place.url.lower().startswith("s3:")


def to_location(place: Path | RemoteFile | str) -> Location:
    """What is meant. Raises LocationRefused for a URL that names no file of this computer.

    >>> to_location("file:///data/a%20b.mcap")
    PosixPath('/data/a b.mcap')
    """
    if isinstance(place, RemoteFile):
        return place
    if isinstance(place, Path) or not is_url(place):
        return Path(place)
    if not place.lower().startswith("file:"):
        return RemoteFile(place)
    split = urlsplit(place)
    if split.netloc not in ("", "localhost") or not split.path:
        raise LocationRefused(place, "it names no file of this computer")
    return Path(unquote(split.path))


def shown_place(place: Path | RemoteFile | str) -> str:
    """The same as errors tell it: a path, or a URL without secrets.

    >>> shown_place("s3://bucket/a.mcap?endpoint=http://localhost:9000")
    's3://bucket/a.mcap'
    """
    return str(to_location(place))


def open_location(place: Path | RemoteFile | str) -> BinaryIO:
    """The file, to read and to seek in. Raises OSError for a path, ObjectError for a URL."""
    return to_location(place).open("rb")


def list_locations(place: Path | RemoteFile | str, ending: str) -> tuple[Location, ...]:
    """All files in a folder, or beneath a URL of a bucket, however deep, whose names end so; in order of names.

    A link that leads nowhere is one of them, a folder that is a link is not looked into. Raises OSError, also where
    a folder within cannot be read, and ObjectError.
    """
    found = to_location(place)
    if isinstance(found, Path):
        walked = os.walk(found, onerror=_raised)
        paths = [Path(folder, name) for folder, _, names in walked for name in names if name.endswith(ending)]
        return tuple(sorted(path for path in paths if path.is_file() or not path.exists()))
    return tuple(RemoteFile(beneath(found.url, name)) for name, _ in Objects(found.url).names(ending))


def _raised(error: OSError) -> None:
    raise error
