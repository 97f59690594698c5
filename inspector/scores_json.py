"""Scored frames <-> bytes, exactly: what the store keeps, so that an inspection can be judged again without a picture.

inspector.errors.WorldError
└── ScoresUnreadable         stored scores that are damaged, or newer than this program
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import zstandard

from inspector.errors import WorldError
from models.verdict import FrameState, Region, Residuals, ScoredFrame

VERSION = 1
MAX_BYTES = 1 << 30
"""Of the scores unpacked; a hundred thousand frames with regions need a tenth of it."""


class ScoresUnreadable(WorldError):
    """Stored scores that are damaged, or newer than this program."""

    def __init__(self, why: str) -> None:
        super().__init__(
            f"stored scores cannot be read: {why}; allowed is version {VERSION}, as this program writes it"
        )


def scores_to_bytes(frames: Sequence[ScoredFrame]) -> bytes:
    """Every field of every frame; `scores_from_bytes` gives back an equal one, to the last bit of each number."""
    rows = [_row(frame) for frame in frames]
    text = json.dumps({"version": VERSION, "frames": rows}, separators=(",", ":"))
    return zstandard.ZstdCompressor(level=3, write_checksum=True).compress(text.encode())


def scores_from_bytes(data: bytes) -> tuple[ScoredFrame, ...]:
    """The frames as they were scored. Raises ScoresUnreadable."""
    try:
        unpacked = zstandard.ZstdDecompressor().decompress(data, max_output_size=MAX_BYTES)
        stored: Any = json.loads(unpacked)
        if stored["version"] == VERSION:
            return tuple(_frame(row) for row in stored["frames"])
    except (zstandard.ZstdError, ValueError, LookupError, TypeError) as error:
        raise ScoresUnreadable(str(error)) from error
    raise ScoresUnreadable(f"they are of version {stored['version']!r}")


def _row(frame: ScoredFrame) -> list[object]:
    residuals = frame.residuals
    return [
        frame.index,
        frame.t_ns,
        frame.state.value,
        frame.s,
        frame.score,
        frame.raw_score,
        [residuals.appearance, residuals.position, residuals.timing],
        [[r.x, r.y, r.width, r.height, r.score, r.polarity] for r in frame.regions],
        frame.reference,
        frame.placement,
        frame.light,
    ]


def _frame(row: list[Any]) -> ScoredFrame:
    index, t_ns, state, s, score, raw_score, residuals, regions, reference, placement, light = row
    return ScoredFrame(
        index,
        t_ns,
        FrameState(state),
        s,
        score,
        raw_score,
        Residuals(*residuals),
        tuple(Region(*region) for region in regions),
        reference,
        tuple(placement),
        tuple(light),
    )
