"""Options that several commands have, and what is made of them."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from inspector.executors import Executor
    from models.verdict import Policy


def _false_reject_target(text: str) -> float:
    """Reads an option: which share of the good parts may be refused."""
    from models.verdict import ALLOWED

    low, high = ALLOWED["false_rejects"]
    with suppress(ValueError):
        if low <= float(text) <= high:
            return float(text)
    raise typer.BadParameter(f"{text!r} is not allowed; allowed is a share of the good parts from {low} to {high}")


PolicyOption = Annotated[
    Path | None,
    typer.Option("--policy", metavar="POLICY.json", help='Thresholds other than usual: {"sensitivity": 1.2}'),
]
FalseRejectsOption = Annotated[
    float | None,
    typer.Option(
        "--false-rejects",
        parser=_false_reject_target,
        metavar="SHARE",
        help="Share of good parts that may be NG; usually 0.02.",
    ),
]
TopicOption = Annotated[
    str | None, typer.Option("--topic", help="The topic of the pictures, where a recording has several.")
]
EXECUTORS = "serial, processes, processes:4, dask://host:8786, ray://auto"


def judging(policy: Path | None, false_rejects: float | None) -> Policy:
    """What the two options say together. Raises PolicyRefused."""
    from inspector.policies import read_policy
    from models.verdict import Policy

    settings = read_policy(policy) if policy else Policy()
    return settings if false_rejects is None else replace(settings, false_rejects=false_rejects)


@contextmanager
def elsewhere(executor: str) -> Generator[Executor | None]:
    """The executor of that url; None where all is done here, one after the other. Raises as `open_executor` does."""
    from inspector.executors import open_executor

    with open_executor(executor) as workers:
        yield None if executor == "serial" else workers
