"""Which pictures show what from where: a CSV file beside them, or a topic of their recording.

inspector.errors.WorldError
└── LabelsRefused            a list of labelled pictures that cannot be used
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Protocol

import numpy as np

from inspector.errors import PictureUnreadable, WorldError
from inspector.pictures import MAX_PIXELS, decode
from inspector.recording import SweepReader, json_messages
from models.errors import PictureError
from models.frame import EncodedPicture
from models.workspace import LabelledPicture, Parameter

COLUMNS = ("file", "object")
"""What a list of labels begins with; every other column is a parameter."""
IN_FOLDER = "labels.csv"
"""Of a folder of pictures."""
TOPIC = "/workspace/q"
"""Of a recording."""
EXAMPLE = '{"object": "cup", "q": {"angle_deg": 10.0}}'


class LabelsRefused(WorldError):
    """A list of labelled pictures that cannot be used."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: {why}")


@dataclass(frozen=True)
class LabelledFiles:
    """A list of pictures, and what is known of each."""

    parameters: tuple[Parameter, ...]
    rows: tuple[tuple[Path, str, tuple[float, ...]], ...]
    """File, object, q."""

    def pictures(self, max_pixels: int = MAX_PIXELS) -> Iterator[LabelledPicture]:
        """Read one by one. Raises PictureError, which names the file."""
        for path, name, q in self.rows:
            yield LabelledPicture(name, q, read_picture(path, max_pixels))


@dataclass(frozen=True)
class LabelledRecording:
    """A recording whose pictures say what they show and from where, on the topic /workspace/q."""

    path: Path
    parameters: tuple[Parameter, ...]
    labels: Mapping[int, tuple[str, tuple[float, ...]]]
    """Object and q by the time of the picture."""

    def pictures(self, max_pixels: int = MAX_PIXELS) -> Iterator[LabelledPicture]:
        """Those that are labelled, in recorded order. Raises RecordingError, and LabelsRefused where there is none."""
        found = False
        for frame in SweepReader(self.path, max_pixels=max_pixels):
            if frame.t_ns in self.labels:
                found = True
                name, q = self.labels[frame.t_ns]
                yield LabelledPicture(name, q, frame.pixels)
        if not found:
            raise LabelsRefused(self.path, f"no picture has the time of a message on {TOPIC}; needed is one for each")


class Labels(Protocol):
    """Where pictures to learn from come from."""

    @property
    def parameters(self) -> tuple[Parameter, ...]: ...

    def pictures(self, max_pixels: int = MAX_PIXELS) -> Iterator[LabelledPicture]:
        """One by one."""
        ...


def read_labels(path: Path | str, periods: Mapping[str, float] | None = None) -> Labels:
    """A CSV file (`read_csv`), a folder with a labels.csv in it, or a recording (`read_recording`).

    `periods` names the parameters that turn, and after how much. Raises LabelsRefused, RecordingError.
    """
    path = Path(path)
    if path.is_dir() and (path / IN_FOLDER).exists():
        path /= IN_FOLDER
    return read_recording(path, periods) if path.suffix == ".mcap" or path.is_dir() else read_csv(path, periods)


def read_recording(path: Path | str, periods: Mapping[str, float] | None = None) -> LabelledRecording:
    """A recording with a JSON message on /workspace/q at the very time of each picture to learn from:

    {"object": "cup", "q": {"angle_deg": 10.0}}, all with the same parameters. Others of its pictures are left out.
    """
    path, periods = Path(path), periods or {}
    names, labels = list[str](), dict[int, tuple[str, tuple[float, ...]]]()
    for t_ns, said in json_messages(path, TOPIC):
        try:
            name, q = str(said["object"]), {str(each): float(value) for each, value in said["q"].items()}
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise LabelsRefused(path, f"{json.dumps(said)} on {TOPIC}; allowed is {EXAMPLE}") from error
        names = names or list(q)
        if sorted(q) != sorted(names) or not all(map(isfinite, q.values())):
            raise LabelsRefused(path, f"{json.dumps(said)} on {TOPIC}; allowed are numbers for {', '.join(names)}")
        labels[t_ns] = name, tuple(q[each] for each in names)
    if not labels or not names:
        raise LabelsRefused(path, f"nothing on {TOPIC}; needed is a message for each picture, as {EXAMPLE}")
    return LabelledRecording(path, _parameters(path, names, periods), labels)


def read_csv(path: Path | str, periods: Mapping[str, float] | None = None) -> LabelledFiles:
    """A CSV file with the columns file, object, and one per parameter, in any order; files are named from its folder.

    `periods` names the parameters that turn, and after how much. Raises LabelsRefused.
    """
    path, periods = Path(path), periods or {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise LabelsRefused(path, f"{why}; allowed is a CSV file with the columns file, object, parameters") from error
    head = [name.strip() for name in rows[0]] if rows else []
    names = [name for name in head if name not in COLUMNS]
    if any(head.count(name) != 1 for name in COLUMNS) or not names or len(set(head)) < len(head) or "" in head:
        found = ", ".join(head) or "none"
        raise LabelsRefused(path, f"its columns are {found}; needed are file, object, and one per parameter, each once")
    parameters = _parameters(path, names, periods)
    read = [_row(path, number, dict(zip(head, row, strict=False)), names) for number, row in _whole(path, rows)]
    if not read:
        raise LabelsRefused(path, "no row below its head; needed is one per picture")
    return LabelledFiles(parameters, tuple(read))


def _parameters(path: Path, names: Sequence[str], periods: Mapping[str, float]) -> tuple[Parameter, ...]:
    for name in periods:
        if name not in names:
            why = f"no parameter {name}, of which a period was given; parameters are {', '.join(names)}"
            raise LabelsRefused(path, why)
    return tuple(Parameter(name, periods.get(name)) for name in names)


def _whole(path: Path, rows: Sequence[Sequence[str]]) -> Iterator[tuple[int, Sequence[str]]]:
    for number, row in enumerate(rows[1:], start=2):
        if not any(row):
            continue
        if len(row) != len(rows[0]):
            raise LabelsRefused(path, f"row {number} has {len(row)} columns, its head has {len(rows[0])}")
        yield number, row


def _row(path: Path, number: int, row: Mapping[str, str], names: Sequence[str]) -> tuple[Path, str, tuple[float, ...]]:
    q: list[float] = []
    for name in names:
        try:
            q.append(float(row[name]))
        except ValueError as error:
            raise LabelsRefused(path, f"row {number}: {name} is {row[name]!r}; allowed is a number") from error
        if not isfinite(q[-1]):
            raise LabelsRefused(path, f"row {number}: {name} is {row[name]!r}; allowed is a number")
    for name in COLUMNS:
        if not row[name].strip():
            raise LabelsRefused(path, f"row {number}: no {name}")
    return path.parent / row["file"].strip(), row["object"].strip(), tuple(q)


def read_picture(path: Path | str, max_pixels: int = MAX_PIXELS) -> np.ndarray:
    """Its pixels, grey or colour. Raises PictureError, which names the file."""
    try:
        return decode(EncodedPicture("", Path(path).read_bytes()), max_pixels=max_pixels)
    except OSError as error:
        raise PictureError(f"{path}: {error.strerror or error}; allowed is a picture") from error
    except PictureUnreadable as error:
        raise PictureError(f"{path}: {error}") from error
