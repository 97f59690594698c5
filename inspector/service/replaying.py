"""Replays on the desk: of one recording there, or of many by an executor."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import UInt8

from inspector.executors import open_executor
from inspector.learner import load_appearance, packed, unpacked
from inspector.locations import to_location
from inspector.others import Others
from inspector.recording import SweepReader, count_frames
from inspector.replay import OnScored
from inspector.replay import replay as replay_recording
from inspector.result_json import result_record
from inspector.scores_json import scores_to_bytes
from inspector.service.showing import load_cached
from models.appearance import Appearance
from models.errors import InspectionError
from models.frame import Frame
from models.limits import promise
from models.recognition import Other
from models.verdict import Policy, ScoredFrame

Json = dict[str, Any]
OTHERS = Others()


def others_of(parts: Mapping[str, str]) -> list[Other]:
    """Those whose files can be read here, by the names of their parts."""
    return OTHERS.readable({name: to_location(path) for name, path in parts.items()})


def replay(
    progress: Callable[[float], object],
    *,
    recording: str,
    appearance: str,
    policy: Mapping[str, float],
    names: Mapping[str, str | None],
    others: Mapping[str, str],
) -> Json:
    """A recording inspected; `names` has `result_id`, `recipe_id`, `product_id`, `part_id` for the result.

    `others` are the appearances of other products, one of which it may be of. `result` and `scores`.
    """
    reader = SweepReader(recording)
    announced = count_frames(reader.path)

    def tell(frame: Frame, scored: ScoredFrame) -> None:
        if announced:
            progress(min(1.0, (scored.index + 1) / announced))

    return _replayed(reader, load_cached(appearance), Policy(**policy), names, others_of(others), on_scored=tell)


def batch(
    made: Callable[[Json], object],
    *,
    executor: str,
    pieces: Sequence[Json],
    appearance: str,
    policy: Mapping[str, float],
    others: Mapping[str, str],
) -> Json:
    """Many replays by the same: `made` is told `number`, and `result` and `scores`, or `error`, of each piece.

    A piece has `number`, `recording` and `names`. Raises as `open_executor` does, and WorkersLost.
    """
    with open_executor(executor) as workers:
        judged_by, learnt = Policy(**policy), packed(load_appearance(appearance))
        for piece in workers.each(_piece, pieces, learnt, judged_by, dict(others), lost=_failed):
            made(piece)
    return {}


def _piece(piece: Json, appearance: UInt8[np.ndarray, " bytes"], policy: Policy, others: Mapping[str, str]) -> Json:
    """In a worker, wherever it is."""
    try:
        reader, learnt = SweepReader(piece["recording"]), unpacked(appearance)
        return {"number": piece["number"], **_replayed(reader, learnt, policy, piece["names"], others_of(others))}
    except InspectionError as error:
        return _failed(piece, str(error))
    except OSError as error:
        return _failed(piece, f"{piece['recording']}: {error.strerror or error}")


def _failed(piece: Json, why: str) -> Json:
    return {"number": piece["number"], "error": why}


def _replayed(
    reader: SweepReader,
    learnt: Appearance,
    policy: Policy,
    names: Mapping[str, str | None],
    others: Sequence[Other],
    *,
    on_scored: OnScored | None = None,
) -> Json:
    replayed = replay_recording(reader, learnt, policy, on_scored=on_scored, others=others)
    facts = {name: said for name in ("product_id", "part_id") if (said := names.get(name)) is not None}
    result = result_record(
        replayed.result, replayed.facts | facts, is_simulated=True, recipe_id=names["recipe_id"],
        promise=promise(learnt.peaks, policy.false_rejects), result_id=names["result_id"], with_frames=False,
    )  # fmt: skip
    scores = b64encode(scores_to_bytes(replayed.result.frames)).decode()
    return {"result": {**result, "losses": list(replayed.losses)}, "scores": scores}
