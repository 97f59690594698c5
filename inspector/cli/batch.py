"""`inspector batch`: thousands of recordings, several at a time, wherever there are cores."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from inspector.cli.options import EXECUTORS, FalseRejectsOption, PolicyOption, TopicOption, judging
from inspector.cli.replay import NOT_OK
from inspector.cli.terminal import counting, warn

if TYPE_CHECKING:
    from inspector.batch import Batch


def batch(
    recordings: Annotated[
        list[str], typer.Argument(metavar="RECORDING-OR-FOLDER-OR-URL...", help="What to inspect; s3://, http:// too.")
    ],
    *,
    appearance: Annotated[str, typer.Option(metavar="PART.appearance", help="What `learn` wrote, or its URL.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for results; what is there is not done again.")],
    executor: Annotated[str, typer.Option(metavar="URL", help=f"Where it is done: {EXECUTORS}")] = "processes",
    table: Annotated[
        Literal["csv", "parquet"],
        typer.Option(help="results.csv; or results.parquet, and frames.parquet with a row for each frame."),
    ] = "csv",
    policy: PolicyOption = None,
    false_rejects: FalseRejectsOption = None,
    topic: TopicOption = None,
    fail_on_ng: Annotated[
        bool, typer.Option("--fail-on-ng", help="Exit 3 where all were inspected, and one is not OK.")
    ] = False,
) -> None:
    """Inspect many recordings. One that cannot be read is named, and the rest goes on; begun again, it goes on.

    Example: inspector batch archive --appearance board.appearance --out by-version-7 --executor processes

    Example: inspector batch s3://archive/2026 --appearance s3://archive/board.appearance --out by-version-7
    """
    from inspector.batch import By, Counted, find_recordings, refuse_missing, run_batch
    from inspector.executors import open_executor
    from inspector.learner import load_appearance
    from inspector.locations import to_location
    from models.verdict import Judgement

    refuse_missing(table)
    settings = judging(policy, false_rejects)
    tasks = find_recordings(recordings)
    learnt = to_location(appearance)
    by = By(learnt.absolute() if isinstance(learnt, Path) else learnt, load_appearance(learnt).id, settings, topic)
    kept = 0
    try:
        with open_executor(executor) as workers, counting("inspecting", len(tasks)) as tell:

            def told(counted: Counted) -> None:
                nonlocal kept
                kept = counted.skipped + counted.done
                tell(counted.recordings - counted.left, f"{counted.failed} failed" if counted.failed else "")

            done = run_batch(tasks, by, workers, out, tell=told, table=table)
    except KeyboardInterrupt:
        warn(f"interrupted: {kept} of {len(tasks)} recordings are inspected; the same command goes on with the rest")
        raise
    _print(done, out / f"results.{table}")
    if done.failed:
        raise typer.Exit(1)
    if fail_on_ng and done.verdicts.keys() - {Judgement.OK}:
        raise typer.Exit(NOT_OK)


def _print(batch: Batch, table: Path) -> None:
    counted = batch.counted
    for name, why in batch.failed:
        warn(f"{name}: {why}")
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in batch.verdicts.most_common())
    before = f", {counted.skipped} of them before" if counted.skipped else ""
    not_read = f"; {counted.failed} could not be" if counted.failed else ""
    count = counted.done + counted.skipped
    print(f"{count} recording{'' if count == 1 else 's'} inspected{before}: {verdicts or 'none'}{not_read}")
    if batch.damaged:
        print(f"  {batch.damaged} of them damaged: column `losses`")
    print(f"{table}")
