"""`inspector workspace learn`: labelled pictures into a workspace."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Annotated

import typer

from inspector.cli.terminal import progress

workspace = typer.Typer(no_args_is_help=True, help="Where things are: learn it from pictures of known places.")


@workspace.command()
def learn(
    labels: Annotated[
        Path, typer.Argument(metavar="LABELS.csv", help="Columns file, object, and one per parameter; or a recording.")
    ],
    *,
    out: Annotated[Path, typer.Option(metavar="OBJECTS.workspace", help="New file for what is learnt.")],
    periodic: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=PERIOD", help="A parameter that turns, and after how much; may be repeated."),
    ] = None,
) -> None:
    """Learn how objects look from where. The places of each object's pictures make a grid.

    Example: inspector workspace learn labels.csv --out objects.workspace --periodic angle_deg=360
    """
    from inspector.labels import read_labels
    from inspector.workspaces import learn_labels

    listed = read_labels(labels, dict(_period(each) for each in periodic or ()))
    with progress("learning") as share:
        learnt = learn_labels(listed, out, share)
    names = ", ".join(parameter.name for parameter in learnt.parameters)
    objects = "one object" if len(learnt.objects) == 1 else f"{len(learnt.objects)} objects"
    print(f"{out}: {objects} over {names}, from {learnt.facts['pictures']} pictures")
    print(learnt.id)


def _period(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        period = float(value)
    except ValueError:
        period = inf
    if not name or not 0 < period < inf:
        raise typer.BadParameter(f"--periodic {text!r} is not allowed; allowed is NAME=PERIOD, as in angle_deg=360")
    return name, period
