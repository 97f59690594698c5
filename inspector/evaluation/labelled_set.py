"""Recordings whose names tell what they are: golden, good, bad; with their truth where there is one.

inspector.errors.WorldError
└── SetRefused               a place with nothing to evaluate, or a recording whose name does not tell what it is
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path, PurePosixPath

from inspector.errors import WorldError
from inspector.evaluation.truth import read_truth, truth_of
from inspector.locations import Location, RemoteFile, is_bucket, to_location
from inspector.objects import Objects, beneath
from models.labelled import Label, Truth

ENDING = ".mcap"
_GOLDEN = "golden"
_LABELLED = re.compile(rf"({_GOLDEN}|{'|'.join(Label)}).*\{ENDING}", re.DOTALL)
_ALLOWED = "golden*.mcap, good*.mcap and bad*.mcap"


class SetRefused(WorldError):
    """A place with nothing to evaluate, or a recording whose name does not tell what it is."""

    def __init__(self, place: str, why: str) -> None:
        super().__init__(f"{place}: {why}")


@dataclass(frozen=True)
class Part:
    """A recording, and what is known of it beforehand."""

    name: str
    """Of the file, without its suffix; of several folders, after the folder's."""
    path: Location
    label: Label
    truth: Truth | None


@dataclass(frozen=True)
class LabelledSet:
    """What is in a folder, or in several places."""

    name: str
    golden: tuple[Location, ...]
    """To learn from: `golden.mcap` first, the others by name."""
    parts: tuple[Part, ...]
    """To inspect: the good ones, then the bad ones, each by name."""


@dataclass(frozen=True)
class _Found:
    name: str
    label: str
    path: Location
    truth: Location | None


def read_set(places: Sequence[Path | RemoteFile | str], *, learns: bool) -> LabelledSet:
    """What is in folders and right beneath URLs of buckets, not deeper, and recordings that are named.

    `learns` says that there must be golden sweeps. Every truth is read now. Raises SetRefused, TruthRefused,
    ObjectError.
    """
    named = [to_location(place) for place in places]
    found = [each for place in named for each in _found(place, f"{_name(place)}/" if len(named) > 1 else "")]
    where = ", ".join(map(str, named))
    golden = sorted((each for each in found if each.label == _GOLDEN), key=_golden_first)
    if learns and not golden:
        raise SetRefused(where, "no golden*.mcap to learn from; add one, or name what was learnt with --appearance")
    labelled = [each for label in Label for each in sorted(found, key=_by_name) if each.label == label]
    if not labelled:
        raise SetRefused(where, "neither good*.mcap nor bad*.mcap in it; there is nothing to evaluate")
    for one, other in pairwise(labelled):
        if one.name == other.name:
            raise SetRefused(f"{one.path}, {other.path}", f"two parts would be {one.name!r}; name each part once")
    parts = (Part(each.name, each.path, Label(each.label), each.truth and read_truth(each.truth)) for each in labelled)
    name = _name(named[0]) + (f" and {len(named) - 1} more" if len(named) > 1 else "")
    return LabelledSet(name, tuple(each.path for each in golden), tuple(parts))


def _found(place: Location, above: str) -> Iterator[_Found]:
    """The recordings of a folder, whose names begin with what is above them; or the one that is named."""
    beside = _beside(place)
    if beside is None:
        label = _LABELLED.fullmatch(place.name)
        if isinstance(place, Path) and not place.exists():
            raise SetRefused(str(place), f"no such folder or recording; allowed are folders with {_ALLOWED}, and those")
        if label is None:
            raise SetRefused(str(place), f"its name does not tell what it is; allowed are {_ALLOWED}")
        truth = truth_of(place)
        yield _Found(place.stem, label[1], place, truth if truth is not None and _is_there(truth) else None)
        return
    for name, path in beside.items():
        if (label := _LABELLED.fullmatch(name)) is not None:
            stem = name.removesuffix(ENDING)
            yield _Found(f"{above}{stem}", label[1], path, beside.get(f"{stem}.truth.json"))


def _beside(place: Location) -> dict[str, Location] | None:
    """What is in a folder, or right beneath a URL, by name; None for a file."""
    if isinstance(place, Path):
        return {path.name: path for path in place.iterdir()} if place.is_dir() else None
    if not is_bucket(place) or place.name.endswith(ENDING):
        return None
    names = (name for name, _ in Objects(place.url).names() if "/" not in name)
    return {name: RemoteFile(beneath(place.url, name)) for name in names}


def _is_there(place: Location) -> bool:
    return place.exists() if isinstance(place, Path) else place.size() is not None


def _name(place: Location) -> str:
    """Of a folder, a bucket or a file."""
    return place.resolve().name if isinstance(place, Path) else PurePosixPath(str(place).partition("://")[2]).name


def _by_name(found: _Found) -> str:
    return found.name


def _golden_first(found: _Found) -> tuple[bool, str]:
    return found.path.name != f"{_GOLDEN}{ENDING}", found.name
