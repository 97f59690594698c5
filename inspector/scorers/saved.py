"""An inspection of a scorer as bytes, for another one: what replaces what was saved before, and what is added to it."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import zstandard

from inspector.errors import PictureUnreadable
from inspector.pictures import decode
from inspector.scorers.wire import pack, receive
from inspector.scores_json import ScoresUnreadable, scores_from_bytes, scores_to_bytes
from models.appearance import Appearance
from models.checkpoint import from_bytes, to_bytes
from models.errors import CheckpointError
from models.frame import EncodedPicture, Frame
from models.inspection import Inspection
from models.verdict import Policy, ScoredFrame

_MAX_BYTES = 1 << 28
"""Of a state unpacked: a hundred times that of a camera of twelve megapixels."""
_LEVEL = 3


@dataclass(frozen=True)
class Saved:
    """What an inspection is saved as."""

    state: bytes
    """In place of the one before."""
    added: bytes
    """To be kept behind those before; joined, they are one."""


@dataclass(frozen=True, eq=False)
class Going:
    """An inspection, and what its scorer knows beside it."""

    inspection: Inspection
    sequence: int | None
    """Of the last frame that was handled, refused or not."""
    early: bool
    """Whether it was said that NG is certain."""
    foreign: bool | None
    """Whether it was said that another part lies there; None before."""


def save(going: Going, frames: Sequence[ScoredFrame], kept: Sequence[Frame]) -> Saved:
    """`frames` were scored, and `kept` were kept of the beginning, since it was saved before."""
    beside = {"sequence": going.sequence, "early": going.early, "foreign": going.foreign}
    packed = pack(beside, to_bytes(going.inspection))
    state = zstandard.ZstdCompressor(level=_LEVEL, write_checksum=True).compress(packed)
    if not frames and not kept:
        return Saved(state, b"")
    scores = scores_to_bytes(frames)
    pictures, listed = list[bytes](), list[list[object]]()
    for frame in kept:
        assert frame.encoded is not None
        pictures.append(frame.encoded.data)
        listed.append([frame.t_ns, frame.sequence, frame.encoder, frame.encoded.format, len(frame.encoded.data)])
    return Saved(state, pack({"scores": len(scores), "kept": listed}, b"".join((scores, *pictures))))


def resume(appearance: Appearance, policy: Policy, saved: Saved, max_pixels: int) -> Going:
    """Raises CheckpointError where that is not of this appearance and policy, or is damaged."""
    if not saved.state:
        raise CheckpointError("the checkpoint has lost its state, as a crash of the database may do")
    frames, kept = list[ScoredFrame](), list[Frame]()
    try:
        unpacked = zstandard.ZstdDecompressor().decompress(saved.state, max_output_size=_MAX_BYTES)
        beside, state = receive(io.BytesIO(unpacked)) or ({}, b"")
        sequence, early, foreign = beside["sequence"], beside["early"], beside["foreign"]
        stream = io.BytesIO(saved.added)
        while chunk := receive(stream):
            head, body = chunk
            at = head["scores"]
            frames += scores_from_bytes(body[:at])
            for t_ns, number, encoder, kind, size in head["kept"]:
                picture = EncodedPicture(kind, body[at : at + size])
                kept.append(Frame(decode(picture, max_pixels=max_pixels), t_ns, number, encoder, picture))
                at += size
    except (zstandard.ZstdError, ScoresUnreadable, PictureUnreadable, ValueError, LookupError, TypeError) as error:
        raise CheckpointError(f"the checkpoint cannot be read: {error}") from error
    inspection = from_bytes(appearance, state, frames, kept)
    if inspection.policy != policy:
        raise CheckpointError(f"the checkpoint is of {inspection.policy}, allowed is {policy}")
    return Going(inspection, sequence, early, foreign)
