"""The folder that a batch leaves: a result for each recording, a table of all, and a journal to go on by.

inspector.errors.WorldError
└── BatchInUse               a folder that another batch is writing to
"""

from __future__ import annotations

import fcntl
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from inspector.batch.tables import TableKind, write_tables
from inspector.batch.tasks import Outcome, Task, stamp
from inspector.errors import WorldError
from inspector.files import NotWritten, write_new
from inspector.objects import ObjectError


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
            self._journal = (self._path / "journal.jsonl").open("a+")
        except OSError as error:
            raise NotWritten(self._path, error.strerror or str(error)) from error
        try:
            fcntl.flock(self._journal, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._journal.close()
            raise BatchInUse(self._path) from error
        self._journal.seek(0)
        lines = self._journal.read().split("\n")
        for line in lines[:-1]:
            entry = json.loads(line)
            self._rows[entry["row"]["recording"]] = entry
        if lines[-1]:
            # Cut off in the middle of a line.
            self._journal.truncate(sum(len(line.encode()) + 1 for line in lines[:-1]))
        return self

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
                and self._result(task.name).is_file()
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
        line = json.dumps({"key": self._key, "stamp": outcome.stamp, "row": outcome.row})
        self._rows[outcome.name] = json.loads(line)
        try:
            self._journal.write(line + "\n")
            self._journal.flush()
        except OSError as error:
            raise NotWritten(self._path / "journal.jsonl", error.strerror or str(error)) from error

    def table(self, names: Sequence[str], kind: TableKind = "csv") -> Counter[str]:
        """Write the tables of these recordings, and count their verdicts. Raises TableMissing, NotWritten."""
        rows = [self._rows[name]["row"] for name in sorted(names) if name in self._rows]
        write_tables(self._path, kind, rows, lambda name: self._result(name).read_bytes())
        return Counter(row["verdict"] for row in rows if row["verdict"])

    def _result(self, name: str) -> Path:
        return self._path / "results" / f"{name}.json"
