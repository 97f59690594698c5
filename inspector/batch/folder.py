"""The folder that a batch leaves: a result for each recording, a table of all, and a journal to go on by.

inspector.errors.WorldError
└── BatchInUse               a folder that another batch is writing to
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from inspector.batch.tables import TABLES, TableKind, write_tables
from inspector.batch.tasks import Outcome, Row, Task, stamp
from inspector.errors import WorldError
from inspector.files import NotWritten, write_new
from inspector.objects import ObjectError

_DRAFT = re.compile(r"\..+\.(json|csv|parquet)\.[0-9a-f]{8}")
"""What `inspector.files` calls a file that is not whole yet."""


class BatchInUse(WorldError):
    """A folder that another batch is writing to."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"{path}: another batch is writing there; let it end, or name another folder with --out")


class BatchFolder:
    """`results/NAME.json`, `results.csv`, and `journal.jsonl`, a line for each recording that was done or failed."""

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._key = path, key
        self._rows: dict[str, dict[str, Any]] = {}

    def __enter__(self) -> Self:
        try:
            (self._path / "results").mkdir(parents=True, exist_ok=True)
            self._journal = (self._path / "journal.jsonl").open("a+b")
        except OSError as error:
            raise NotWritten(self._path, error.strerror or str(error)) from error
        try:
            fcntl.flock(self._journal, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._journal.close()
            raise BatchInUse(self._path) from error
        self._read()
        for draft in (*self._path.glob(".*"), *(self._path / "results").rglob(".*")):
            if _DRAFT.fullmatch(draft.name):
                # Of a batch that was killed.
                draft.unlink()
        return self

    def _read(self) -> None:
        """What it says; a line that is not whole, or is damaged, says nothing, and its recording is done once more."""
        self._journal.seek(0)
        whole = 0
        for line in self._journal:
            if not line.endswith(b"\n"):
                self._journal.truncate(whole)
                return
            whole += len(line)
            with suppress(ValueError, KeyError, TypeError):
                entry = json.loads(line)
                self._rows[entry["row"]["recording"]] = entry

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._journal.close()

    def has(self, task: Task) -> bool:
        """Whether its result is there already, of this recording as it is now, by the same appearance and policy."""
        entry = self._rows.get(task.name)
        try:
            return (
                entry is not None
                and entry["row"]["state"] == "done"
                and entry["key"] == self._key
                and entry["stamp"] == list(stamp(task.path))
                and entry.get("sha256") == _sha256(self._result(task.name).read_bytes())
            )
        except (OSError, ObjectError):
            return False

    def keep(self, outcome: Outcome) -> None:
        """The result first, then the line that says that it is there. Raises NotWritten."""
        place = self._result(outcome.name)
        place.unlink(missing_ok=True)
        if outcome.record is not None:
            place.parent.mkdir(parents=True, exist_ok=True)
            write_new(place, outcome.record)
        # With a hash: a kill between result and line must not leave a line that speaks of another result.
        sha256 = None if outcome.record is None else _sha256(outcome.record)
        line = json.dumps({"key": self._key, "stamp": outcome.stamp, "sha256": sha256, "row": outcome.row})
        self._rows[outcome.name] = json.loads(line)
        try:
            self._journal.write(line.encode() + b"\n")
            self._journal.flush()
        except OSError as error:
            raise NotWritten(self._path / "journal.jsonl", error.strerror or str(error)) from error

    def begin(self) -> None:
        """Results will change: tables of those before would tell another story. Raises OSError."""
        for name in TABLES:
            (self._path / name).unlink(missing_ok=True)

    def table(self, names: Sequence[str], kind: TableKind = "csv") -> list[Row]:
        """Write the tables of these recordings; their rows. Raises TableMissing, NotWritten."""
        rows = [self._rows[name]["row"] for name in sorted(names) if name in self._rows]
        write_tables(self._path, kind, rows, lambda name: self._result(name).read_bytes())
        return rows

    def _result(self, name: str) -> Path:
        return self._path / "results" / f"{name}.json"


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
