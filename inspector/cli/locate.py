"""`inspector locate`: which object pictures show, and where it is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from inspector.cli.terminal import progress

if TYPE_CHECKING:
    from models.workspace import Located, Parameter


def locate(
    pictures: Annotated[list[Path], typer.Argument(metavar="PICTURE...", help="Pictures, of the size learnt from.")],
    *,
    workspace: Annotated[Path, typer.Option(metavar="OBJECTS.workspace", help="What `workspace learn` wrote.")],
    json: Annotated[Path | None, typer.Option(metavar="OUT.json", help="New file for all that is said.")] = None,
) -> None:
    """Say which object each picture shows, and where it is, how sure that is, and what else it may be.

    Example: inspector locate seen-1.png seen-2.png --workspace objects.workspace --json located.json
    """
    from json import dumps

    from inspector.files import refuse_taken, write_new
    from inspector.workspaces import load_workspace, locate_picture, located_record

    if json is not None:
        refuse_taken(json)
    learnt = load_workspace(workspace)
    found: list[Located] = []
    with progress("locating") as share:
        for path in pictures:
            found.append(locate_picture(path, learnt))
            share(len(found) / len(pictures))
    if json is not None:
        records = [
            {"file": str(path)} | located_record(each, learnt) for path, each in zip(pictures, found, strict=True)
        ]
        write_new(json, (dumps(records, indent=1) + "\n").encode())
    for path, each in zip(pictures, found, strict=True):
        print(f"{path}: {_sentence(each, learnt.parameters)}")


def _sentence(located: Located, parameters: tuple[Parameter, ...]) -> str:
    """What is printed of one picture."""
    if located.object is None or located.q is None or located.uncertainty is None:
        nearest = f"; nearest is {located.others[0].object}" if located.others else ""
        return f"none of the objects, distance {located.distance:.3g}{nearest}"
    triples = zip(parameters, located.q, located.uncertainty, strict=True)
    places = ", ".join(f"{parameter.name} {q:.4g} ± {doubt:.2g}" for parameter, q, doubt in triples)
    said = f"{located.object}, {places}, distance {located.distance:.3g}"
    return said if located.state == "known" else f"{said}, {located.state}"
