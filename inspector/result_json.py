"""Result -> JSON, by the names that scripts outside rely on, and back; written whole or not at all.

inspector.errors.WorldError
└── BadRecord                a record that tells of no result
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any
from uuid import uuid4

from inspector.errors import WorldError
from inspector.files import write_new
from models.limits import Promise
from models.profile import profile
from models.verdict import Deviation, Judgement, Recognised, Region, Result, ScoredFrame


class BadRecord(WorldError):
    """A record that tells of no result."""

    def __init__(self, why: str) -> None:
        super().__init__(f"this is not the record of a concluded inspection: {why}")


def result_record(
    result: Result,
    facts: Mapping[str, str],
    *,
    is_simulated: bool,
    recipe_id: str | None = None,
    promise: Promise | None = None,
    result_id: str | None = None,
    with_frames: bool = True,
) -> dict[str, object]:
    """Everything of a concluded inspection; `facts` tell product and part, which are null where nobody said.

    `promise` is what its limits were set by: whoever re-judges the scores for another target needs it. `result_id` is
    a new one where none is given. Without frames it is what a store keeps, which has their scores beside it.
    """
    record: dict[str, object] = {
        "result_id": result_id or str(uuid4()),
        "product_id": facts.get("product_id"),
        "part_id": facts.get("part_id"),
        "recipe_id": recipe_id,
        "appearance_id": result.appearance_id,
        "verdict": result.verdict.value,
        "result_state": "completed",
        "is_partial": False,
        "is_simulated": is_simulated,
        "reasons": list(result.reasons),
        "recognised": None if result.recognised is None else recognised_record(result.recognised),
        "coverage": number(result.coverage),
        "frames_scored": result.frames_scored,
        "frames_dropped": result.frames_dropped,
        "digest": result.digest,
        "promise": None if promise is None else {k: round(v, 6) for k, v in asdict(promise).items()},
        "deviations": [deviation_record(deviation) for deviation in result.deviations],
        "profile": [None if score is None else number(score) for score in profile(result.frames)],
    }
    return record | {"frames": frame_records(result.frames)} if with_frames else record


def frame_records(frames: Sequence[ScoredFrame]) -> list[dict[str, object]]:
    """The frames by the names of a result."""
    return [frame_record(frame) for frame in frames]


def recognised_record(recognised: Recognised) -> dict[str, object]:
    """What lies there instead, by the names of a result."""
    return asdict(recognised)


def deviation_record(deviation: Deviation) -> dict[str, object]:
    """A deviation by the names of a result."""
    return {
        "s_start": number(deviation.s_start),
        "s_end": number(deviation.s_end),
        "index_start": deviation.index_start,
        "index_end": deviation.index_end,
        "kind": deviation.kind,
        "polarity": deviation.polarity,
        "peak_score": number(deviation.peak_score),
        "peak_index": deviation.peak_index,
        "regions": [_region(region) for region in deviation.regions],
    }


def frame_record(frame: ScoredFrame) -> dict[str, object]:
    """A frame by the names of a result."""
    residuals = frame.residuals
    return {
        "index": frame.index,
        "t_ns": frame.t_ns,
        "state": frame.state.value,
        "s": None if frame.s is None else number(frame.s),
        "score": number(frame.score),
        "raw_score": number(frame.raw_score),
        "residuals": {
            "appearance": number(residuals.appearance),
            "position": number(residuals.position),
            "timing": number(residuals.timing),
        },
        "regions": [_region(region) for region in frame.regions],
    }


def result_of(record: Mapping[str, Any]) -> Result:
    """The result that a record tells of, without its frames; numbers are as exact as there. Raises BadRecord."""
    try:
        return Result(
            verdict=Judgement(record["verdict"]),
            reasons=tuple(record["reasons"]),
            coverage=record["coverage"],
            frames_scored=record["frames_scored"],
            frames_dropped=record["frames_dropped"],
            deviations=tuple(_deviation_of(each) for each in record["deviations"]),
            appearance_id=record["appearance_id"],
            digest=record["digest"],
            recognised=_recognised_of(record.get("recognised")),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise BadRecord(str(error)) from error


def _deviation_of(record: Mapping[str, Any]) -> Deviation:
    known = _known(Deviation, record)
    known["regions"] = tuple(Region(**_known(Region, each)) for each in record["regions"])
    return Deviation(**known)


def _recognised_of(record: Mapping[str, Any] | None) -> Recognised | None:
    if record is None:
        return None
    known = _known(Recognised, record)
    known["off"] = known["off"] and tuple(known["off"])
    return Recognised(**known)


def _known(kind: type[Deviation | Recognised | Region], record: Mapping[str, Any]) -> dict[str, Any]:
    """Without the names that a later version added."""
    return {each.name: record[each.name] for each in fields(kind)}


def number(value: float) -> float:
    """A millionth is below what any of these numbers means."""
    return round(float(value), 6)


def _region(region: Region) -> dict[str, object]:
    return {
        "x": region.x,
        "y": region.y,
        "width": region.width,
        "height": region.height,
        "score": number(region.score),
        "polarity": region.polarity,
    }


def write_result(path: Path, record: Mapping[str, object]) -> None:
    """The record as a new JSON file. Raises OutputExists, NotWritten."""
    write_new(path, json_bytes(record))


def json_bytes(record: Mapping[str, object]) -> bytes:
    """The record as it is in a file."""
    return json.dumps(record, indent=1, allow_nan=False).encode() + b"\n"
