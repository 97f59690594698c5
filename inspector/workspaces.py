"""Labelled pictures -> a workspace on the disk, and pictures -> where they are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from inspector.files import refuse_taken, write_new
from inspector.labels import Labels, read_picture
from inspector.pictures import MAX_PIXELS
from models.errors import AppearanceError, PictureError
from models.workspace import Located, Workspace, learn_workspace


def learn_labels(
    labels: Labels,
    out: Path | str,
    progress: Callable[[float], None] | None = None,
    *,
    max_pixels: int = MAX_PIXELS,
) -> Workspace:
    """Learn from labelled pictures, and write the workspace to the new file `out`.

    Raises LabelsRefused, LearningError, PictureError, OutputExists, NotWritten.
    """
    out = Path(out)
    refuse_taken(out)
    workspace = learn_workspace(labels.pictures(max_pixels), labels.parameters, progress)
    write_new(out, workspace.to_bytes())
    return workspace


def load_workspace(path: Path | str) -> Workspace:
    """The workspace in a file. Raises AppearanceError, which names the file, whatever is wrong with it."""
    try:
        return Workspace.from_bytes(Path(path).read_bytes())
    except OSError as error:
        why = error.strerror or error
        raise AppearanceError(f"{path}: {why}; allowed is a file that `workspace learn` wrote") from error
    except AppearanceError as error:
        raise AppearanceError(f"{path}: {error}") from error


def locate_picture(path: Path | str, workspace: Workspace) -> Located:
    """Where the picture in a file is. Raises PictureError, which names the file."""
    pixels = read_picture(path)
    try:
        return workspace.locate(pixels)
    except PictureError as error:
        raise PictureError(f"{path}: {error}") from error


def located_record(located: Located, workspace: Workspace) -> dict[str, Any]:
    """As JSON holds it: `object`, `q` and `uncertainty` by parameter, `distance`, `state`, `others`."""
    others = [
        {"object": each.object, "q": named(each.q, workspace), "distance": each.distance} for each in located.others
    ]
    return {
        "object": located.object,
        "q": named(located.q, workspace),
        "uncertainty": named(located.uncertainty, workspace),
        "distance": located.distance,
        "state": located.state,
        "others": others,
    }


def named(values: tuple[float, ...] | None, workspace: Workspace) -> dict[str, float] | None:
    """One number per parameter, by its name."""
    names = [parameter.name for parameter in workspace.parameters]
    return None if values is None else dict(zip(names, values, strict=True))
