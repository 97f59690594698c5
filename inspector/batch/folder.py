"""The folder that a batch leaves: a result for each recording, a table of all, and a journal to go on by.

inspector.errors.WorldError
└── BatchInUse               a folder that another batch is writing to
"""

from __future__ import annotations

import csv
import fcntl
import io
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from inspector.batch.tasks import Outcome, Task, stamp
from inspector.errors import WorldError
from inspector.files import NotWritten, write_new

COLUMNS = (
    "recording",
    "state",
    "verdict",
    "product_id",
    "part_id",
    "coverage",
    "frames_scored",
    "frames_dropped",
    "deviations",
    "peak_score",
    "peak_s",
    "digest",
    "error",
)


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
        except OSError:
            return False

    def keep(self, outcome: Outcome) -> None:
        """The result first, then the line that says that it is there. Raises NotWritten."""
        place = self._result(outcome.name)
        place.unlink(missing_ok=True)
        if outcome.record is not None:
            place.parent.mkdir(parents=True, exist_ok=True)
            write_new(place, json.dumps(outcome.record, indent=1, allow_nan=False).encode() + b"\n")
        entry = {"key": self._key, "stamp": outcome.stamp, "row": _row(outcome)}
        self._rows[outcome.name] = json.loads(json.dumps(entry))
        try:
            self._journal.write(json.dumps(entry) + "\n")
            self._journal.flush()
        except OSError as error:
            raise NotWritten(self._path / "journal.jsonl", error.strerror or str(error)) from error

    def table(self, names: Sequence[str]) -> Counter[str]:
        """Write the table of these recordings, and count their verdicts."""
        rows = [self._rows[name]["row"] for name in sorted(names) if name in self._rows]
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        place = self._path / "results.csv"
        place.unlink(missing_ok=True)
        write_new(place, text.getvalue().encode())
        return Counter(row["verdict"] for row in rows if row["verdict"])

    def _result(self, name: str) -> Path:
        return self._path / "results" / f"{name}.json"


def _row(outcome: Outcome) -> dict[str, Any]:
    record: Any = outcome.record or {}
    scored = [frame for frame in record.get("frames", ()) if frame["state"] == "scored"]
    peak = max(scored, key=lambda frame: frame["score"], default=None)
    return {name: record.get(name) for name in COLUMNS} | {
        "recording": outcome.name,
        "state": "failed" if outcome.error else "done",
        "deviations": len(record.get("deviations", ())),
        "peak_score": peak and peak["score"],
        "peak_s": peak and peak["s"],
        "error": outcome.error,
    }
