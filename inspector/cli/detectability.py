"""`inspector detectability`: what would be found on a part, and where not."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inspector.cli.options import TopicOption
from inspector.cli.terminal import progress, warn

if TYPE_CHECKING:
    from models.defects import Kind


def detectability(
    appearance: Annotated[Path, typer.Argument(metavar="PART.appearance", help="What `learn` wrote.")],
    *,
    png: Annotated[Path | None, typer.Option(metavar="MAP.png", help="New file for the map as a picture.")] = None,
    json: Annotated[Path | None, typer.Option(metavar="MAP.json", help="New file for the map as data.")] = None,
    golden: Annotated[
        list[Path] | None,
        typer.Option(metavar="GOLDEN.mcap", help="Put defects into this recording, noise and all; may be repeated."),
    ] = None,
    policy: Annotated[
        Path | None, typer.Option(metavar="POLICY.json", help="Thresholds other than usual, as for `replay`.")
    ] = None,
    kind: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND", help="spot, line, added or missing; may be repeated. All of them."),
    ] = None,
    contrast: Annotated[
        list[float] | None, typer.Option(metavar="LEVELS", help="Of 255 grey levels; may be repeated. 30, 60, 120.")
    ] = None,
    topic: TopicOption = None,
    fine: Annotated[bool, typer.Option("--fine", help="Twice as many places each way: four times as long.")] = False,
) -> None:
    """Put synthetic defects on a good part, inspect it, and tell the smallest ones that are caught, along s and over
    the picture. A minute or two for 400 frames of 320x240.

    Example: inspector detectability board.appearance --golden golden-2.mcap --png board.png
    """
    from inspector.detectability_chart import picture
    from inspector.detectability_report import detectability_record, sentences, source, write_detectability
    from inspector.files import refuse_taken, write_new
    from inspector.learner import load_appearance
    from inspector.pictures import encode_png
    from inspector.policies import read_policy
    from inspector.prober import probe_recordings
    from models.verdict import Policy

    for out in (png, json):
        if out is not None:
            refuse_taken(out)
    kinds, contrasts = _kinds(kind or []), _contrasts(contrast or [])
    learnt, thresholds = load_appearance(appearance), read_policy(policy) if policy else Policy()
    with progress("trying defects") as share:
        found = probe_recordings(
            learnt, golden or [], thresholds, share, kinds=kinds, contrasts=contrasts, fine=fine, topic=topic, tell=warn
        )
    if json is not None:
        write_detectability(json, detectability_record(found, learnt.id))
    if png is not None:
        write_new(png, encode_png(picture(found, learnt, appearance.name)).data)
    print(f"{appearance}: smallest defects that are caught, put into {source(found)}")
    for line in sentences(found):
        print(f"  {line}")


def _kinds(names: list[str]) -> tuple[Kind, ...]:
    """Reads an option: the kinds of that name, all of them where none is named."""
    from models.defects import Kind

    known = {kind.name.lower(): kind for kind in Kind}
    for name in names:
        if name not in known:
            raise typer.BadParameter(f"{name!r} is not allowed for '--kind'; known are {', '.join(known)}")
    return tuple(dict.fromkeys(known[name] for name in names)) or tuple(Kind)


def _contrasts(levels: list[float]) -> tuple[float, ...]:
    """Reads an option: grey levels, the usual ones where none are given."""
    from models.probe import CONTRASTS

    for level in levels:
        if not 1 <= level <= 255:
            raise typer.BadParameter(f"{level:g} is not allowed for '--contrast'; allowed are 1 to 255 grey levels")
    return tuple(dict.fromkeys(levels)) or CONTRASTS
