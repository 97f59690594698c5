"""`inspector learn`: golden recordings into an appearance."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from inspector.cli.terminal import progress, warn


def learn(
    golden: Annotated[list[Path], typer.Argument(metavar="GOLDEN.mcap...", help="Good sweeps; the first is the map.")],
    *,
    out: Annotated[Path, typer.Option(metavar="PART.appearance", help="New file for what is learnt.")],
    topic: Annotated[str | None, typer.Option(help="The topic of the pictures, where a recording has several.")] = None,
) -> None:
    """Learn how a good part looks, from one golden sweep or several.

    Example: inspector learn golden-1.mcap golden-2.mcap --out board.appearance
    """
    from inspector.learner import learn_recordings
    from models.limits import promise
    from models.verdict import Policy

    with progress("learning") as share:
        appearance = learn_recordings(golden, out, share, topic=topic, tell=warn)
    width, height = appearance.size
    sweeps = "one golden sweep" if len(golden) == 1 else f"{len(golden)} golden sweeps"
    print(f"{out}: {appearance.places} places of {width}x{height} pixels, from {sweeps}")
    print(f"  {promise(appearance.peaks, Policy.false_rejects).sentence()}")
    print(appearance.id)
