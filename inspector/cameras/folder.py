"""A folder of pictures as a camera, in the order that a person counts: `folder:/data/part7?fps=30&pattern=*.png`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Self

from inspector.cameras.base import AbstractCamera, CameraNotOpened, CameraStopped, Clock
from inspector.cameras.options import flag, number, read, words
from inspector.picture_headers import kind_of
from inspector.pictures import decode
from models.errors import InspectionError
from models.frame import EncodedPicture, Frame

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")


@dataclass(frozen=True)
class FolderOptions:
    """What can be asked of a folder."""

    fps: float = number(30.0, 0.001, 100_000)
    """Files have no time of exposure: the first picture's time of writing, and then so many a second."""
    pattern: str = words("*", str, "a pattern like *.png or cam1_*")
    """Of the pictures in the folder, those whose names match; what is no picture by its suffix is never taken."""
    realtime: bool = flag()
    """Deliver at `fps`, rather than as fast as possible."""


class FolderCamera(AbstractCamera):
    """Pictures by name, img2 before img10, with the bytes of their files. Every call of `frames` begins anew."""

    def __init__(self, folder: Path, options: FolderOptions, clock: Clock) -> None:
        self._folder, self._options, self._clock, self._closed = folder, options, clock, False
        self._files = _pictures(folder, options.pattern)
        self._start_ns = self._files[0].stat().st_mtime_ns

    @classmethod
    def open(cls, place: str, query: dict[str, str], clock: Clock) -> Self:
        """See AbstractCamera."""
        return cls(Path(place).expanduser(), read("folder", FolderOptions, query), clock)

    def describe(self) -> dict[str, str]:
        """See AbstractCamera."""
        return {"camera": "folder", "folder": self._folder.name, "pictures": str(len(self._files))} | {
            "pattern": self._options.pattern,
            "fps": f"{self._options.fps:g}",
        }

    def close(self) -> None:
        """See AbstractCamera."""
        self._closed = True

    def frames(self) -> Iterator[Frame]:
        """See AbstractCamera. A broken picture stops the sweep: it is not skipped without a word."""
        begun = self._clock.now_ns()
        for sequence, file in enumerate(self._files):
            if self._closed:
                return
            t = round(sequence * 1e9 / self._options.fps)
            if self._options.realtime:
                self._clock.wait_until(begun + t)
            yield self._frame(sequence, file, self._start_ns + t)

    def _frame(self, sequence: int, file: Path, t_ns: int) -> Frame:
        try:
            data = file.read_bytes()
            encoded = EncodedPicture(kind_of(data) or file.suffix[1:].lower(), data)
            return Frame(decode(encoded), t_ns, sequence, encoded=encoded)
        except OSError as error:
            raise CameraStopped(f"folder:{file}", sequence, error.strerror or "it cannot be read") from error
        except InspectionError as error:
            raise CameraStopped(f"folder:{file}", sequence, str(error)) from error


def _pictures(folder: Path, pattern: str) -> tuple[Path, ...]:
    try:
        files = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and fnmatch(p.name, pattern)]
    except OSError as error:
        raise CameraNotOpened(f"folder:{folder}", f"{error.strerror}; give a folder of pictures") from error
    if not files:
        kinds = ", ".join(s[1:] for s in SUFFIXES)
        raise CameraNotOpened(f"folder:{folder}", f"no picture matches {pattern!r}; read are {kinds}")
    return tuple(sorted(files, key=natural))


def natural(path: Path) -> tuple[tuple[tuple[int, int, str], ...], str]:
    """Sorts numbers in names as numbers.

    >>> [p.name for p in sorted([Path("img10.png"), Path("img2.png"), Path("Img1.png")], key=natural)]
    ['Img1.png', 'img2.png', 'img10.png']
    """
    pieces = re.findall(r"[0-9]+|[^0-9]+", path.name.lower())
    return tuple((0, int(p), "") if p[0] in "0123456789" else (1, 0, p) for p in pieces), path.name
