"""Tables of a batch: a row for each recording, as CSV; or as Parquet, with another of all frames.

inspector.errors.WorldError
└── TableMissing             a kind of table whose library is not installed
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, Literal

from inspector.batch.tasks import COLUMNS, Row
from inspector.errors import WorldError
from inspector.files import arriving, write_new

TableKind = Literal["csv", "parquet"]
TABLES = ("results.csv", "results.parquet", "frames.parquet")
_TOGETHER = 64
"""Recordings whose frames are held at once; a row group of the file."""
_FRAME = {
    "index": "int32",
    "t_ns": "int64",
    "state": "string",
    "s": "float64",
    "score": "float64",
    "raw_score": "float64",
}
_RESIDUALS = ("appearance", "position", "timing")
_REGION = {"x": "int32", "y": "int32", "width": "int32", "height": "int32", "score": "float64", "polarity": "string"}


class TableMissing(WorldError):
    """A kind of table whose library is not installed."""

    def __init__(self, kind: str, why: str) -> None:
        super().__init__(f"tables as {kind} cannot be written here ({why}): pip install 'sweep-inspector[{kind}]'")


def refuse_missing(kind: TableKind) -> None:
    """Raise before long work what would be raised after it: TableMissing."""
    if kind == "parquet":
        _arrow()


def write_tables(folder: Path, kind: TableKind, rows: Sequence[Row], result: Callable[[str], bytes]) -> None:
    """`results.csv`; or `results.parquet`, and `frames.parquet` of the results that are done, by the recording's name.

    What is there is replaced. Raises TableMissing, NotWritten, OSError.
    """
    if kind == "csv":
        _replace(folder / "results.csv", _csv(rows))
    else:
        _write_parquet(folder, rows, result)


def _csv(rows: Sequence[Row]) -> bytes:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _replace(path: Path, data: bytes) -> None:
    path.unlink(missing_ok=True)
    write_new(path, data)


def _write_parquet(folder: Path, rows: Sequence[Row], result: Callable[[str], bytes]) -> None:
    arrow, parquet = _arrow()
    kinds = {str: arrow.string(), int: arrow.int64(), float: arrow.float64()}
    recordings = arrow.schema([(name, kinds[kind]) for name, kind in COLUMNS.items()])
    _parquet(folder / "results.parquet", parquet, recordings, [arrow.Table.from_pylist(list(rows), recordings)])
    frames = _frame_schema(arrow)
    done = iter([row["recording"] for row in rows if row["state"] == "done"])
    groups = iter(lambda: [frame for name in islice(done, _TOGETHER) for frame in _frames(name, result(name))], [])
    _parquet(folder / "frames.parquet", parquet, frames, (arrow.Table.from_pylist(each, frames) for each in groups))


def _frame_schema(arrow: Any) -> Any:
    region = arrow.struct([(name, getattr(arrow, kind)()) for name, kind in _REGION.items()])
    return arrow.schema(
        [
            ("recording", arrow.string()),
            *((name, getattr(arrow, kind)()) for name, kind in _FRAME.items()),
            *((name, arrow.float64()) for name in _RESIDUALS),
            ("regions", arrow.list_(region)),
        ]
    )


def _frames(name: str, result: bytes) -> Iterator[Row]:
    for frame in json.loads(result)["frames"]:
        told = {column: frame[column] for column in (*_FRAME, "regions")}
        yield {"recording": name, **told, **frame["residuals"]}


def _parquet(path: Path, parquet: Any, schema: Any, tables: Iterable[Any]) -> None:
    path.unlink(missing_ok=True)
    with arriving(path) as draft, parquet.ParquetWriter(str(draft), schema, compression="zstd") as writer:
        for table in tables:
            writer.write_table(table)


def _arrow() -> tuple[Any, Any]:
    """Imported when it is asked for: most batches write CSV."""
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError as error:
        raise TableMissing("parquet", str(error)) from error
