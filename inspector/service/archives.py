"""Archives of labelled pictures that strangers send: unpacked within limits, and nothing but what is in them is read.

inspector.errors.WorldError
└── ArchiveRefused           an archive that cannot be unpacked, or holds what it must not
"""

from __future__ import annotations

import lzma
import shutil
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from inspector.errors import WorldError
from inspector.labels import LabelledFiles, read_csv

BEGINS = b"PK\x03\x04"
"""A ZIP archive does."""


_DAMAGED = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError, ValueError)
"""What unpacking raises; the last ones of what is encrypted, or packed as nobody does."""


class ArchiveRefused(WorldError):
    """An archive that cannot be unpacked, or holds what it must not."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: {why}; allowed is a ZIP archive of pictures with one CSV file of their labels")


def read_archive(
    path: Path, folder: Path, periods: Mapping[str, float], *, max_bytes: int, max_files: int
) -> LabelledFiles:
    """The labels in an archive, unpacked into the new folder, with no picture from outside of it.

    `max_bytes` is allowed once it is unpacked. Raises ArchiveRefused, LabelsRefused.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            files = _wanted(path, archive, max_bytes, max_files)
            for name, info in files.items():
                target = folder / name
                target.parent.mkdir(parents=True, exist_ok=True)
                # no more comes out of it than it announces
                with archive.open(info) as source, target.open("xb") as sink:
                    shutil.copyfileobj(source, sink)
    except _DAMAGED as error:
        raise ArchiveRefused(path, str(error)) from error
    except OSError as error:
        raise ArchiveRefused(path, error.strerror or str(error)) from error
    lists = [name for name in files if name.suffix.lower() == ".csv"]
    if len(lists) != 1:
        raise ArchiveRefused(path, f"{len(lists)} CSV files in it")
    labels = read_csv(folder / lists[0], periods)
    inside = {(folder / name).resolve() for name in files}
    for picture, _, _ in labels.rows:
        if picture.resolve() not in inside:
            raise ArchiveRefused(path, f"{lists[0]} names {picture.name!r}, which is not in the archive")
    return labels


def _wanted(
    path: Path, archive: zipfile.ZipFile, max_bytes: int, max_files: int
) -> dict[PurePosixPath, zipfile.ZipInfo]:
    """What is to be unpacked: not what systems put beside the files of people."""
    files = {PurePosixPath(info.filename): info for info in archive.infolist() if not info.is_dir()}
    files = {name: info for name, info in files.items() if name.parts[0] != "__MACOSX" and name.name[0] != "."}
    for name in files:
        if name.is_absolute() or ".." in name.parts or any("\\" in part or ":" in part for part in name.parts):
            raise ArchiveRefused(path, f"a file in it is called {str(name)[:80]!r}")
    total = sum(info.file_size for info in files.values())
    if len(files) > max_files or total > max_bytes:
        raise ArchiveRefused(
            path, f"{len(files)} files of {total} bytes unpacked; allowed are {max_files} of {max_bytes}"
        )
    return files
