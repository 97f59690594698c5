"""Labelled pictures -> a workspace on the disk, and pictures -> where they are.

inspector.errors.WorldError
└── LabelsRefused            a list of labelled pictures that cannot be used
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inspector.errors import PictureUnreadable, WorldError
from inspector.files import refuse_taken, write_new
from inspector.pictures import decode
from models.errors import AppearanceError, PictureError
from models.frame import EncodedPicture
from models.workspace import LabelledPicture, Located, Parameter, Workspace, learn_workspace

COLUMNS = ("file", "object")
"""What a list of labels begins with; every other column is a parameter."""


class LabelsRefused(WorldError):
    """A list of labelled pictures that cannot be used."""

    def __init__(self, path: Path, why: str) -> None:
        super().__init__(f"{path}: {why}")


@dataclass(frozen=True)
class Labels:
    """A list of pictures, and what is known of each."""

    parameters: tuple[Parameter, ...]
    rows: tuple[tuple[Path, str, tuple[float, ...]], ...]
    """File, object, q."""

    def pictures(self) -> Iterator[LabelledPicture]:
        """Read one by one. Raises PictureError, which names the file."""
        for path, name, q in self.rows:
            yield LabelledPicture(name, q, read_picture(path))


def read_labels(path: Path | str, periods: Mapping[str, float] | None = None) -> Labels:
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
    for name in periods:
        if name not in names:
            raise LabelsRefused(
                path, f"no column {name}, of which a period was given; parameters are {', '.join(names)}"
            )
    read = [_row(path, number, dict(zip(head, row, strict=False)), names) for number, row in _whole(path, rows)]
    if not read:
        raise LabelsRefused(path, "no row below its head; needed is one per picture")
    return Labels(tuple(Parameter(name, periods.get(name)) for name in names), tuple(read))


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
        if not np.isfinite(q[-1]):
            raise LabelsRefused(path, f"row {number}: {name} is {row[name]!r}; allowed is a number")
    for name in COLUMNS:
        if not row[name].strip():
            raise LabelsRefused(path, f"row {number}: no {name}")
    return path.parent / row["file"].strip(), row["object"].strip(), tuple(q)


def read_picture(path: Path | str) -> np.ndarray:
    """Its pixels, grey or colour. Raises PictureError, which names the file."""
    try:
        return decode(EncodedPicture("", Path(path).read_bytes()))
    except OSError as error:
        raise PictureError(f"{path}: {error.strerror or error}; allowed is a picture") from error
    except PictureUnreadable as error:
        raise PictureError(f"{path}: {error}") from error


def learn_labels(labels: Labels, out: Path | str, progress: Callable[[float], None] | None = None) -> Workspace:
    """Learn from labelled pictures, and write the workspace to the new file `out`.

    Raises LabelsRefused, LearningError, PictureError, OutputExists, NotWritten.
    """
    out = Path(out)
    refuse_taken(out)
    workspace = learn_workspace(labels.pictures(), labels.parameters, progress)
    write_new(out, workspace.to_bytes())
    return workspace


def load_workspace(path: Path | str) -> Workspace:
    """The workspace in a file. Raises AppearanceError, which names the file, whatever is wrong with it."""
    try:
        return Workspace.from_bytes(Path(path).read_bytes())
    except OSError as error:
        why = error.strerror or error
        raise AppearanceError(f"{path}: {why}; allowed is a file that `workspace learn` wrote") from error
    except AppearanceError as error:
        raise AppearanceError(f"{path}: {error}") from error


def locate_picture(path: Path | str, workspace: Workspace) -> Located:
    """Where the picture in a file is. Raises PictureError, which names the file."""
    pixels = read_picture(path)
    try:
        return workspace.locate(pixels)
    except PictureError as error:
        raise PictureError(f"{path}: {error}") from error


def located_record(located: Located, workspace: Workspace) -> dict[str, Any]:
    """As JSON holds it: `object`, `q` and `uncertainty` by parameter, `distance`, `state`, `others`."""
    others = [
        {"object": each.object, "q": named(each.q, workspace), "distance": each.distance} for each in located.others
    ]
    return {
        "object": located.object,
        "q": named(located.q, workspace),
        "uncertainty": named(located.uncertainty, workspace),
        "distance": located.distance,
        "state": located.state,
        "others": others,
    }


def named(values: tuple[float, ...] | None, workspace: Workspace) -> dict[str, float] | None:
    """One number per parameter, by its name."""
    names = [parameter.name for parameter in workspace.parameters]
    return None if values is None else dict(zip(names, values, strict=True))
