"""A batch as a whole: what is to be done, by whom, and what is done already."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from inspector.batch.folder import BatchFolder
from inspector.batch.tasks import By, Outcome, Task, inspected
from inspector.executors import Executor, WorkersLost

TRIES = 3
"""How often workers may be lost without anything done meanwhile."""


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


def run_batch(
    tasks: Sequence[Task],
    by: By,
    executor: Executor,
    out: Path,
    tell: Callable[[Counted], object] = lambda counted: None,
) -> Batch:
    """Inspect every recording and keep its result in the folder `out`; `tell` is called after each.

    What is there from before, of the same recording, appearance and policy, is not done again. Raises WorkersLost,
    NotWritten; what is done by then is kept.
    """
    with BatchFolder(out, by.key) as folder:
        todo = {task.name: task for task in tasks if not folder.has(task)}
        counted = Counted(len(tasks), len(tasks) - len(todo), 0, 0)
        failed: dict[str, str] = {}
        tell(counted)
        tries = 0
        while todo:
            before = len(todo)
            try:
                for outcome in executor.each(partial(inspected, by=by), list(todo.values())):
                    folder.keep(outcome)
                    del todo[outcome.name]
                    counted = _more(counted, outcome)
                    tell(counted)
                    if outcome.error is not None:
                        failed[outcome.name] = outcome.error
            except WorkersLost:
                # What a worker had in work when it died is done by another.
                tries = tries + 1 if len(todo) == before else 0
                if tries == TRIES:
                    raise
        names = [task.name for task in tasks]
        return Batch(counted, folder.table(names), tuple(sorted(failed.items())))


def _more(counted: Counted, outcome: Outcome) -> Counted:
    done = outcome.error is None
    return Counted(counted.recordings, counted.skipped, counted.done + done, counted.failed + (not done))
