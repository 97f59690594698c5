"""What the service saves of a running inspection, so that another process can go on with it: bytes for the store.

A checkpoint is a state, which replaces the one before, and chunks, each of which adds to those before. The scorer's
share of both is opaque here; the service adds which frame is wanted next, and what was said.
"""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import zstandard

from inspector.scorers.wire import Head
from inspector.stores.records import Checkpoint

_SIZE = struct.Struct("<I")


@dataclass(frozen=True)
class Kept:
    """What the service itself keeps of an inspection, beside what its scorer knows."""

    first: int | None = None
    """Number of the first frame."""
    next: int = 0
    """Number that is wanted next: all frames below it are in the checkpoint."""
    starts: tuple[tuple[int, int], ...] = ()
    """Each process that took it over, counted from 1, and the number of the frame from which it recorded."""
    keys: dict[str, int] = field(default_factory=dict[str, int])
    """The number that an Idempotency-Key was used for."""


@dataclass(frozen=True)
class Cut:
    """What is to be saved of an inspection at some frame."""

    kept: Kept
    state: bytes
    """The scorer's."""
    frames: bytes
    """Those scored since the cut before."""
    lines: list[bytes]
    """Messages since the cut before, but for answers to frames that come after this one."""


@dataclass(frozen=True)
class Restored:
    """What another process goes on with."""

    kept: Kept
    lines: list[bytes]
    """All messages."""
    chunks: int
    """That are in the store."""
    resume: Head
    """What the scorer's `begin` takes more in its head."""
    body: bytes
    """Its body."""


class Ledger:
    """What is saved of a running inspection, and what is not yet."""

    def __init__(self, since: float) -> None:
        self.kept = Kept()
        """As of the last cut."""
        self.turn = asyncio.Lock()
        """Cuts come one after the other."""
        self.saved_at = since
        self.below = 0
        """Frames below this are in the store."""
        self.chunks = 0
        """Chunks that are in the store."""
        self.unstored: list[tuple[bytes, list[bytes]]] = []
        """Of cuts that are not."""
        self._lines: list[tuple[int, bytes]] = []
        """Messages since the last cut; each with the frame that it answers, or -1."""

    @property
    def due(self) -> bool:
        """Whether there is something that no cut has."""
        return bool(self._lines)

    def said(self, line: bytes, sequence: int) -> None:
        """A message more."""
        self._lines.append((sequence, line))

    def restore(self, restored: Restored) -> None:
        """All so far is saved."""
        self.kept, self.below, self.chunks = restored.kept, restored.kept.next, restored.chunks
        self._lines.clear()

    def cut(self, last: int | None, first: int | None, keys: Mapping[str, int], state: bytes, frames: bytes) -> Cut:
        """When the scorer has said what it knows; `last` is the last frame that it was given."""
        if last is not None:
            answered = {key: sequence for key, sequence in keys.items() if sequence <= last}
            self.kept = replace(self.kept, first=first, next=max(last + 1, self.kept.next), keys=answered)
        lines = [line for sequence, line in self._lines if sequence < self.kept.next]
        self._lines = [each for each in self._lines if each[0] >= self.kept.next]
        return Cut(self.kept, state, frames, lines)


def state_bytes(kept: Kept, scorer: bytes) -> bytes:
    """A state."""
    head = json.dumps(asdict(kept), separators=(",", ":")).encode()
    return _SIZE.pack(len(head)) + head + scorer


def read_state(data: bytes) -> tuple[Kept, bytes]:
    """What the service keeps, and the scorer's share."""
    head, scorer = _split(data)
    said = json.loads(head)
    said["starts"] = tuple((int(take), int(start)) for take, start in said["starts"])
    return Kept(**said), scorer


def chunk_bytes(added: Iterable[tuple[bytes, Sequence[bytes]]]) -> bytes:
    """A chunk of what was added by one cut or several: the scorer's share, and messages, one in a line."""
    packed = zstandard.ZstdCompressor(level=3)
    parts = [part for frames, lines in added for part in (frames, packed.compress(b"\n".join(lines)))]
    return b"".join(_SIZE.pack(len(part)) + part for part in parts)


def read_chunks(chunks: Iterable[bytes]) -> tuple[list[bytes], list[bytes]]:
    """The scorer's share of each cut, and all messages."""
    frames: list[bytes] = []
    messages: list[bytes] = []
    for chunk in chunks:
        rest = chunk
        while rest:
            part, rest = _split(rest)
            packed, rest = _split(rest)
            lines = zstandard.ZstdDecompressor().decompress(packed)
            frames.append(part)
            messages += lines.split(b"\n") if lines else []
    return frames, messages


def restored(checkpoint: Checkpoint | None, takes: int) -> Restored:
    """What the process that has taken it over, as the so-manieth, goes on with; None: from the beginning."""
    if checkpoint is None:
        return Restored(replace(Kept(), starts=((takes, 0),)), [], 0, {}, b"")
    # one that a crash of the database has lost is empty, and the scorer says so
    kept, scorer = read_state(checkpoint.state) if checkpoint.state else (Kept(), b"")
    frames, lines = read_chunks(checkpoint.added)
    kept = replace(kept, starts=(*kept.starts, (takes, kept.next)))
    resume: Head = {"resume": [len(scorer), *map(len, frames)]}
    return Restored(kept, lines, len(checkpoint.added), resume, scorer + b"".join(frames))


def _split(data: bytes) -> tuple[bytes, bytes]:
    (size,) = _SIZE.unpack_from(data)
    return data[_SIZE.size : _SIZE.size + size], data[_SIZE.size + size :]
