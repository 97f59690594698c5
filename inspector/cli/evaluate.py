"""`inspector evaluate`: a labelled set of recordings as a regression test."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inspector.cli.options import EXECUTORS, FalseRejectsOption, PolicyOption, TopicOption, elsewhere, judging
from inspector.cli.terminal import progress, warn

if TYPE_CHECKING:
    from inspector.evaluation.labelled_set import LabelledSet
    from inspector.evaluation.running import Run
    from inspector.executors import Executor
    from models.appearance import Appearance


def evaluate(
    places: Annotated[
        list[str],
        typer.Argument(
            metavar="FOLDER-OR-RECORDING-OR-URL...",
            help="With golden*.mcap, good*.mcap, bad*.mcap, and X.truth.json of any; s3:// too.",
        ),
    ],
    *,
    appearance: Annotated[
        str | None,
        typer.Option(metavar="PART.appearance", help="Take this one, or its URL; do not learn from golden*.mcap."),
    ] = None,
    policy: PolicyOption = None,
    false_rejects: FalseRejectsOption = None,
    baseline: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Compare with another appearance, another policy, or an earlier OUT.json."),
    ] = None,
    json: Annotated[Path | None, typer.Option(metavar="OUT.json", help="New file for every figure.")] = None,
    html: Annotated[Path | None, typer.Option(metavar="OUT.html", help="New file for one page with pictures.")] = None,
    topic: TopicOption = None,
    executor: Annotated[
        str, typer.Option(metavar="URL", help=f"Where it is learnt and inspected: {EXECUTORS}")
    ] = "serial",
) -> None:
    """Learn, inspect and count a labelled set: false rejects, escapes, what was found, the worst cases.

    Example: inspector evaluate parts --html parts.html --baseline released.appearance

    Example: inspector evaluate s3://archive/plates --appearance s3://archive/plate.appearance --executor processes
    """
    from datetime import UTC, datetime
    from json import dumps

    from inspector.evaluation.baseline import compared, read_baseline
    from inspector.evaluation.labelled_set import read_set
    from inspector.evaluation.page import page
    from inspector.evaluation.record import Evaluation, evaluation_record
    from inspector.evaluation.running import run
    from inspector.evaluation.summary import lines
    from inspector.files import refuse_taken, write_new
    from inspector.locations import to_location

    if json is not None and json == html:
        raise typer.BadParameter(f"--json and --html both name {json}; allowed are two files")
    for out in (json, html):
        if out is not None:
            refuse_taken(out)
    labelled = read_set(places, learns=appearance is None)
    thresholds = judging(policy, false_rejects)
    before = to_location(baseline) if baseline else None
    source = read_baseline(before) if before else None
    with elsewhere(executor) as workers:
        learnt = _appearance(labelled, appearance, topic, workers)
        with progress("inspecting") as share:
            now = run(labelled.parts, learnt, thresholds, share, topic=topic, executor=workers)
        beside = None
        if before is not None and source is not None:
            with progress("comparing") as share:
                beside = compared(before, source, now, labelled.parts, share, topic=topic, executor=workers)
    evaluation = Evaluation(labelled, now, appearance is None, datetime.now(UTC), beside)
    if json is not None:
        write_new(json, dumps(evaluation_record(evaluation), indent=1, allow_nan=False).encode() + b"\n")
    if html is not None:
        write_new(html, page(evaluation, topic=topic).encode())
    _warn(now)
    for line in lines(evaluation):
        print(line)
    if now.failed:
        raise typer.Exit(1)


def _appearance(labelled: LabelledSet, given: str | None, topic: str | None, executor: Executor | None) -> Appearance:
    """The one that was given, or what the golden sweeps teach."""
    from tempfile import TemporaryDirectory

    from inspector.learner import learn_recordings, load_appearance

    if given is not None:
        return load_appearance(given)
    with TemporaryDirectory() as folder, progress("learning") as share:
        return learn_recordings(
            labelled.golden, Path(folder) / "learnt", share, topic=topic, tell=warn, executor=executor
        )


def _warn(run: Run) -> None:
    for part in run.inspected:
        for loss in part.losses:
            warn(f"{part.outcome.name}: {loss}")
    for failed in run.failed:
        warn(f"{failed.name} was not inspected: {failed.why}")
