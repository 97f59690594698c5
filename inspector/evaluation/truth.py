"""Truth files: JSON beside a recording that tells what each frame really shows, checked when read.

inspector.errors.WorldError
└── TruthRefused             a truth file that cannot be read, or that says what cannot be
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inspector.errors import WorldError
from inspector.locations import Location, RemoteFile, is_bucket
from models.labelled import DefectSeen, FrameTruth, Truth

_ENDING = ".truth.json"


class TruthRefused(WorldError):
    """A truth file that cannot be read, or that says what cannot be."""

    def __init__(self, path: Location, why: str) -> None:
        super().__init__(f"{path}: {why}")


Number = Annotated[float, Field(allow_inf_nan=False)]
Index = Annotated[int, Field(ge=0)]


class _Read(BaseModel):
    model_config = ConfigDict(strict=True, extra="ignore")


class DefectInFile(_Read):
    """A defect in one frame; `box` is x1, y1, x2, y2 in pixels of the frame."""

    id: int | str
    box: tuple[Number, Number, Number, Number]
    inside: bool


class FrameInFile(_Read):
    """One frame; `commanded` counts frames of the nominal sweep, `s` runs from 0 to 1, or a little beyond."""

    index: Index
    s: Number
    commanded: Number
    defects: list[DefectInFile]


class TruthFile(_Read):
    """What is read of a truth file; whatever else it says is left alone."""

    nominal_frames: Annotated[int, Field(ge=2)]
    frames: list[FrameInFile]


def truth_of(recording: Location) -> Location | None:
    """Where the truth of a recording would be: X.truth.json beside X.mcap.

    None beside an address of a web server that has a query: that may be a signature, which is good for one file.
    """
    if isinstance(recording, Path):
        return recording.with_suffix(_ENDING)
    path, mark, query = recording.url.partition("?")
    if mark and not is_bucket(recording):
        return None
    return RemoteFile(f"{path.removesuffix(recording.name)}{recording.stem}{_ENDING}{mark}{query}")


def read_truth(path: Location) -> Truth:
    """The truth in a file. Raises TruthRefused, with the first thing that is wrong, and where; ObjectError."""
    try:
        read = TruthFile.model_validate_json(path.read_bytes())
    except OSError as error:
        raise TruthRefused(path, error.strerror or str(error)) from error
    except ValidationError as error:
        raise TruthRefused(path, _sentence(error)) from error
    if len({frame.index for frame in read.frames}) < len(read.frames):
        raise TruthRefused(path, "two frames have the same index; allowed is each of the recording once")
    return Truth(read.nominal_frames, tuple(_frame(frame) for frame in read.frames))


def _frame(frame: FrameInFile) -> FrameTruth:
    defects = tuple(DefectSeen(each.id, each.box, each.inside) for each in frame.defects)
    return FrameTruth(frame.index, frame.s, frame.commanded, defects)


def _sentence(error: ValidationError) -> str:
    wrong = error.errors()[0]
    name = ".".join(str(part) for part in wrong["loc"])
    if wrong["type"] == "missing":
        return f"{name} is missing; a truth holds nominal_frames, and frames with index, s, commanded, defects"
    if not name:
        return f"no truth: {wrong['msg'][0].lower()}{wrong['msg'][1:]}; allowed is a JSON object"
    return f"{name} is {str(wrong['input'])[:40]}; {wrong['msg'].replace('Input should', 'it should')}"
