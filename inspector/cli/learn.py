"""`inspector learn`: golden recordings into an appearance."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from inspector.cli.options import EXECUTORS, TopicOption, elsewhere
from inspector.cli.terminal import progress, warn


def learn(
    golden: Annotated[
        list[str], typer.Argument(metavar="GOLDEN.mcap...", help="Good sweeps, or their URLs; the first is the map.")
    ],
    *,
    out: Annotated[Path, typer.Option(metavar="PART.appearance", help="New file for what is learnt.")],
    add: Annotated[
        bool, typer.Option("--add", help="Add the sweeps to what was learnt before (--to), which stays as it is.")
    ] = False,
    to: Annotated[
        str | None, typer.Option(metavar="OLD.appearance", help="With --add: what they are added to, or its URL.")
    ] = None,
    ignore: Annotated[
        Path | None, typer.Option(metavar="MASK.png", help="A picture of that size, white where not to look.")
    ] = None,
    topic: TopicOption = None,
    executor: Annotated[
        str, typer.Option(metavar="URL", help=f"Where all sweeps but the first are read: {EXECUTORS}")
    ] = "serial",
) -> None:
    """Learn how a good part looks, from one golden sweep or several, or add confirmed-good ones to what was learnt.

    Example: inspector learn golden-1.mcap golden-2.mcap --out board.appearance

    Example: inspector learn --add part-0007.mcap --to board.appearance --out board-2.appearance
    """
    from inspector.learner import add_recordings, learn_recordings
    from models.limits import promise
    from models.verdict import Policy

    if add != (to is not None):
        raise typer.BadParameter("--add and --to belong together; allowed is both or neither")
    if add and ignore is not None:
        raise typer.BadParameter("--ignore goes not with --add; the mask of the old appearance is kept")
    if add and executor != "serial":
        raise typer.BadParameter(f"--executor {executor} goes not with --add; sweeps are added one after the other")
    with elsewhere(executor) as workers, progress("learning") as share:
        if to is not None:
            appearance = add_recordings(golden, to, out, share, topic=topic, tell=warn)
        else:
            appearance = learn_recordings(golden, out, share, topic=topic, ignore=ignore, tell=warn, executor=workers)
    width, height = appearance.size
    sweeps = "one golden sweep" if appearance.facts["sweeps"] == "1" else f"{appearance.facts['sweeps']} golden sweeps"
    print(f"{out}: {appearance.places} places of {width}x{height} pixels, from {sweeps}")
    print(f"  {promise(appearance.peaks, Policy.false_rejects).sentence()}")
    print(appearance.id)
