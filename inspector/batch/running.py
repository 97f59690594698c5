"""A batch as a whole: what is to be done, by whom, and what is done already."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from inspector.batch.folder import BatchFolder
from inspector.batch.tables import TableKind
from inspector.batch.tasks import By, Outcome, Task, failed, inspected
from inspector.executors import Executor


@dataclass(frozen=True)
class Counted:
    """How far a batch is."""

    recordings: int
    skipped: int
    """Done before."""
    done: int
    """Now."""
    failed: int

    @property
    def left(self) -> int:
        return self.recordings - self.skipped - self.done - self.failed


@dataclass(frozen=True)
class Batch:
    """What became of it."""

    counted: Counted
    verdicts: Counter[str]
    """Of all recordings that are done, whenever that was."""
    failed: tuple[tuple[str, str], ...]
    """Name and reason of those that no result could be made of."""
    damaged: int
    """How many that are done have lost something: the column `losses` says what."""


def run_batch(
    tasks: Sequence[Task],
    by: By,
    executor: Executor,
    out: Path,
    *,
    tell: Callable[[Counted], object] = lambda counted: None,
    table: TableKind = "csv",
) -> Batch:
    """Inspect every recording and keep its result in the folder `out`; `tell` is called after each.

    What is there from before, of the same recording, appearance and policy, is not done again. Raises WorkersLost,
    NotWritten; what is done by then is kept.
    """
    with BatchFolder(out, by.key) as folder:
        todo = [task for task in tasks if not folder.has(task)]
        counted = Counted(len(tasks), len(tasks) - len(todo), 0, 0)
        wrong: dict[str, str] = {}
        tell(counted)
        folder.begin()
        for outcome in executor.each(inspected, todo, by, lost=failed):
            folder.keep(outcome)
            counted = _more(counted, outcome)
            tell(counted)
            if outcome.record is None:
                wrong[outcome.name] = str(outcome.row["error"])
        rows = folder.table([task.name for task in tasks], table)
        verdicts = Counter(row["verdict"] for row in rows if row["verdict"])
        return Batch(counted, verdicts, tuple(sorted(wrong.items())), sum(bool(row["losses"]) for row in rows))


def _more(counted: Counted, outcome: Outcome) -> Counted:
    done = outcome.record is not None
    return Counted(counted.recordings, counted.skipped, counted.done + done, counted.failed + (not done))
