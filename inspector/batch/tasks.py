"""A piece of a batch: one recording, inspected by one appearance and one policy, wherever that happens to be done.

inspector.errors.WorldError
├── NothingThere             no recording where some were looked for
└── NamedAlike               two recordings whose results would have one name
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from inspector.errors import WorldError
from inspector.learner import load_appearance
from inspector.locations import Location, RemoteFile, is_bucket, list_locations, to_location
from inspector.objects import Objects
from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.result_json import json_bytes, result_record
from models.appearance import Appearance
from models.errors import AppearanceError, InspectionError
from models.limits import promise
from models.verdict import Policy

ENDING = ".mcap"
COLUMNS = {
    "recording": str,
    "state": str,
    "verdict": str,
    "product_id": str,
    "part_id": str,
    "coverage": float,
    "frames_scored": int,
    "frames_dropped": int,
    "deviations": int,
    "peak_score": float,
    "peak_s": float,
    "t_ns": int,
    "reasons": str,
    "losses": str,
    "digest": str,
    "error": str,
}
"""Of the table of all recordings; what is not known is None."""
Stamp = tuple[int, int | str]
Row = dict[str, Any]
"""Values of the columns."""
Record = dict[str, Any]


class NothingThere(WorldError):
    """No recording where some were looked for."""

    def __init__(self, places: Sequence[Location]) -> None:
        named = ", ".join(map(str, places))
        super().__init__(f"no recording in {named}; allowed are MCAP files, and folders and s3:// prefixes with some")


class NamedAlike(WorldError):
    """Two recordings whose results would have one name."""

    def __init__(self, name: str, one: Location, other: Location) -> None:
        super().__init__(f"{one} and {other} would both be {name} in the results; name a folder that holds both")


@dataclass(frozen=True)
class Task:
    """A recording of the batch."""

    name: str
    """Names its result: its path below the folder or prefix that was named, without `.mcap`."""
    path: Location


@dataclass(frozen=True)
class By:
    """What all recordings of a batch are inspected by; the file is read where the work is done."""

    appearance: Location
    appearance_id: str
    policy: Policy
    topic: str | None = None

    @property
    def key(self) -> str:
        """Results of the same key need not be made again."""
        told = json.dumps([self.appearance_id, asdict(self.policy), self.topic], sort_keys=True)
        return hashlib.sha256(told.encode()).hexdigest()


@dataclass(frozen=True)
class Outcome:
    """What became of a recording: its record, or why there is none."""

    name: str
    row: Row
    """For the table."""
    stamp: Stamp | None = None
    """Of the recording when it was read."""
    record: bytes | None = None
    """JSON, as `replay` writes it: made where the work is done, which is many times more hands than keep it."""


def find_recordings(places: Sequence[Path | RemoteFile | str]) -> list[Task]:
    """Files, and all `.mcap` files in folders and beneath URLs of buckets, however deep, by name.

    Raises NothingThere, NamedAlike, ObjectError.
    """
    named = [to_location(place) for place in places]
    found: dict[str, Task] = {}
    for place in named:
        folder = place.is_dir() if isinstance(place, Path) else is_bucket(place) and not place.name.endswith(ENDING)
        parts = _parts(place)
        for path in list_locations(place, ENDING) if folder else [place]:
            below = "/".join(_parts(path)[len(parts) if folder else -1 :]).removesuffix(ENDING)
            name = f"{parts[-1]}/{below}" if folder and len(places) > 1 else below
            task = Task(name, path.absolute() if isinstance(path, Path) else path)
            if found.setdefault(name, task) != task:
                raise NamedAlike(name, found[name].path, task.path)
    if not found:
        raise NothingThere(named)
    return [found[name] for name in sorted(found)]


def _parts(place: Location) -> tuple[str, ...]:
    """Of its path; of a URL the bucket is one. None of them leads up: results stay in their folder."""
    if isinstance(place, Path):
        return Path(os.path.abspath(place)).parts
    return tuple(part for part in PurePosixPath(str(place).partition("://")[2]).parts if part not in ("/", ".."))


def stamp(path: Location) -> Stamp:
    """What tells that it is another recording now: size and time of change, or what stands for its content.

    Raises OSError, ObjectError.
    """
    if isinstance(path, RemoteFile):
        return Objects(path.url).version()
    facts = path.stat()
    return facts.st_size, facts.st_mtime_ns


def inspected(task: Task, by: By) -> Outcome:
    """Do it, here. Whatever is wrong with the recording becomes the outcome's error."""
    at = None
    try:
        at = stamp(task.path)
        record = _record(task, by)
    except InspectionError as error:
        return failed(task, str(error), at)
    except OSError as error:
        return failed(task, f"{task.path}: {error.strerror or error}", at)
    return Outcome(task.name, _row(task.name, record), at, json_bytes(record))


def failed(task: Task, why: str, at: Stamp | None = None) -> Outcome:
    """The outcome of a recording that no inspection could be made of."""
    return Outcome(task.name, dict.fromkeys(COLUMNS) | {"recording": task.name, "state": "failed", "error": why}, at)


def _record(task: Task, by: By) -> Record:
    appearance = _appearance(by.appearance, by.appearance_id)
    replayed = replay(SweepReader(task.path, topic=by.topic), appearance, by.policy)
    promised = promise(appearance.peaks, by.policy.false_rejects)
    name = str(uuid5(NAMESPACE_URL, f"{task.name} {by.key} {replayed.result.digest}"))
    record = result_record(replayed.result, replayed.facts, is_simulated=True, promise=promised, result_id=name)
    return record | {"recording": task.name, "losses": list(replayed.losses)}


def _row(name: str, record: Record) -> Row:
    scored = [frame for frame in record["frames"] if frame["state"] == "scored"]
    peak = max(scored, key=lambda frame: frame["score"], default=None)
    return {column: record.get(column) for column in COLUMNS} | {
        "recording": name,
        "state": "done",
        "deviations": len(record["deviations"]),
        "peak_score": peak and peak["score"],
        "peak_s": peak and peak["s"],
        "t_ns": record["frames"][0]["t_ns"] if record["frames"] else None,
        "reasons": "; ".join(record["reasons"]),
        "losses": "; ".join(record["losses"]),
    }


@lru_cache(maxsize=2)
def _appearance(path: Location, appearance_id: str) -> Appearance:
    """Once for each process. Raises AppearanceError, also where the file is another one by now."""
    appearance = load_appearance(path)
    if appearance.id != appearance_id:
        raise AppearanceError(f"{path}: it has the id {appearance.id} now; the batch was begun with {appearance_id}")
    return appearance
