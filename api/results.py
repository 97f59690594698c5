"""What is told of an inspection: what is known of it, its result, its scored frames."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel

from inspector.result_json import frame_record
from inspector.scores_json import scores_from_bytes
from inspector.service.errors import NotConcluded, ScoresGone
from inspector.service.scored import kept_scores
from inspector.service.service import Service
from inspector.stores.records import Decision, InspectionSource, InspectionState, StoredInspection
from models.verdict import ScoredFrame


class Disposition(BaseModel):
    """What a person said; the machine's verdict stays as it was given."""

    decision: Decision
    verdict: str
    """What holds for that person."""
    comment: str
    actor: str
    t_ns: int


class Inspection(BaseModel):
    """What is known of an inspection, without its frames."""

    inspection_id: str
    number: int
    """Increases with every inspection begun."""
    product_id: str
    part_id: str | None
    recipe_id: str | None
    appearance_id: str
    state: InspectionState
    verdict: str | None
    reason: str | None
    """Why it was aborted, or failed."""
    is_simulated: bool
    source: InspectionSource
    begun_ns: int
    ended_ns: int | None
    acknowledged_ns: int | None
    disposition: Disposition | None
    """The last word of a person, where one spoke."""
    coverage: float | None
    frames_scored: int | None
    """So far, where it is processing."""
    frames_dropped: int | None
    digest: str | None
    recording: str
    """`being written`, `kept`, `none`, `removed`."""
    recording_note: str | None
    scores: str
    """Of its frames: `being written`, `kept`, `none`, `removed`."""
    next_sequence: int | None
    """The number that the next frame may have, where it is processing here."""
    profile: list[float | None] | None
    """The highest score in each fiftieth of the sweep; in lists only where it is asked for."""
    so_far: list[dict[str, Any]] | None = None
    """What was found until now, as the stream tells it: `deviation_opened`, `deviation_closed`, `early_ng`,
    `early_invalid`, `recognised`, `part_found`. None in lists, and where it is not processing here."""


def told(stored: StoredInspection, service: Service, profile: bool = True) -> Inspection:
    """What is known of it, with how far it is where it runs here."""
    running = service.inspections.find(stored.inspection_id) if stored.state == "processing" else None
    result = stored.result or {}
    live = {"frames_scored": running.scored, "frames_dropped": running.lost} if running is not None else result
    same = {name: getattr(stored, name) for name in Inspection.model_fields if hasattr(stored, name)}
    return Inspection(
        **same,
        coverage=result.get("coverage"),
        frames_scored=live.get("frames_scored"),
        frames_dropped=live.get("frames_dropped"),
        digest=result.get("digest"),
        next_sequence=running.next_sequence if running is not None and running.phase == "open" else None,
        profile=result.get("profile") if profile else None,
    )


def whole_result(service: Service, inspection_id: str, frames: bool = True) -> bytes:
    """The result as JSON, from the store. Blocks. Raises NoSuchInspection, NotConcluded.

    Where the scores of its frames are not kept any more, `frames` is null, and `frames_note` says why.
    """
    stored = service.store.inspection(inspection_id)
    if stored.state == "processing":
        raise NotConcluded(inspection_id)
    if stored.result is None:
        names = ("inspection_id", "product_id", "part_id", "recipe_id", "appearance_id", "verdict", "is_simulated")
        said = {name: getattr(stored, name) for name in names}
        bare = {"result_state": stored.state, "is_partial": True, "reasons": [stored.reason or ""], "frames": []}
        return json.dumps(said | bare).encode()
    return f"{json.dumps(stored.result)[:-1]}{_frames(service, stored) if frames else ''}}}".encode()


def _frames(service: Service, stored: StoredInspection) -> str:
    try:
        scores = kept_scores(service.store, stored)
    except ScoresGone as gone:
        return f', "frames": null, "frames_note": {json.dumps(str(gone))}'
    return f', "frames": {_listed(scores_from_bytes(scores))}' if scores is not None else ""


def stored_scores(service: Service, stored: StoredInspection, after: int, limit: int) -> bytes:
    """Scored frames with a higher index, of an inspection that has ended. Blocks. Raises ScoresGone."""
    scores = kept_scores(service.store, stored)
    frames = scores_from_bytes(scores)[after + 1 : after + 1 + limit] if scores is not None else ()
    return f'{{"items": {_listed(frames)}, "next": {after + len(frames)}, "state": "{stored.state}"}}'.encode()


def _listed(frames: Sequence[ScoredFrame]) -> str:
    """Frame by frame: one call for thousands of them would not let go of the interpreter, and frames would wait."""
    return f"[{', '.join(json.dumps(frame_record(frame)) for frame in frames)}]"
