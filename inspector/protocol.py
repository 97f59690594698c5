"""The stream of an inspection over a WebSocket: binary frames in, `kind`-tagged JSON out. All of it is here.

In, binary: a header of 24 bytes, little-endian, and the picture's bytes (JPEG, PNG, WebP, BMP, TIFF).

| bytes | | |
| --- | --- | --- |
| 0 | version | 1 |
| 1 | flags | bit 0: `encoder` is meant |
| 2-3 | size of the header | 24; what a later version adds stands between here and the picture |
| 4-7 | sequence | counts the camera's frames; each is higher than the one before; a gap is a lost frame |
| 8-15 | t_ns | time of exposure, nanoseconds since the epoch, below 2^63 |
| 16-23 | encoder | position of robot or conveyor, a double |

In, text: `{"kind": "conclude"}`, with `"stopped": true` where the line broke the sweep off because NG was certain.

Out, text: one JSON object each, with `kind`, and `n`, which counts the messages of the inspection from 0 (`ready`,
`saved`, `duplicate` and `problem` have none). A connection may break at any time: connect again with
`?after=N&log=L`, the last `n` that was got and the `log` of `ready`, and all since is sent once more; `next_sequence`
of `ready` says from where frames are wanted.

Where `saves` of `ready` is true, several processes share the work, and another one goes on where one is lost. It may
want frames again that were answered, from the last `saved` on, and tells with another `log` all that was said once
more. Answers to frames that were sent again are the same.

| kind | |
| --- | --- |
| `ready` | first: `credits`, `next_sequence`, `log`, `saves`, `inspection_id`, `recipe_id`, `appearance_id` |
| `saved` | `next_sequence`: frames below it will not be wanted again |
| `scored` | the answer to a frame: `sequence`, and the scored frame as in the result |
| `dropped` | the answer to a frame that could not be taken in time, with `sequence` and `why`; it is counted |
| `refused` | the answer to a frame that is no picture, or not of the learnt kind: `sequence`, `why`; it is counted |
| `duplicate` | the answer to a frame whose `sequence` is not above all before; ignored |
| `deviation_opened`, `deviation_closed` | `deviation`, as far as it is known |
| `early_ng` | NG whatever comes after, if the line stops here: `index`, `s`, `coverage` so far |
| `early_invalid` | INVALID as it stands, with the `reason`: the sweep does not begin as the learnt part; `index` |
| `recognised` | soon after that, where it is known what lies there instead: as in the result, and its `sentence` |
| `part_found` | the learnt part has come after all: `early_invalid` holds no more; `index` |
| `verdict` | `result`: the inspection is concluded |
| `aborted` | `reason`: the inspection ended without a verdict |
| `problem` | what was wrong, as a problem document; the connection is closed after it |

`/v1/workspaces/{id}/track` takes the same frames; what it answers is in api/README.md.

Credits: every frame sent is answered by exactly one of `scored`, `dropped`, `refused`, `duplicate`, in any order. At
most `credits` may be unanswered; what is sent beyond is dropped.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from math import isfinite

VERSION = 1
HEADER = struct.Struct("<BBHIqd")
WITH_ENCODER = 1
ANSWERS = frozenset({"scored", "dropped", "refused", "duplicate"})
"""Kinds that answer a frame, and give a credit back."""


class BadFrame(ValueError):
    """A binary message that is no frame; the message says why."""


@dataclass(frozen=True)
class SentFrame:
    """One frame as it travels."""

    sequence: int
    t_ns: int
    encoder: float | None
    picture: bytes | memoryview

    def to_bytes(self) -> bytes:
        """The header, and the picture after it."""
        flags = 0 if self.encoder is None else WITH_ENCODER
        head = HEADER.pack(VERSION, flags, HEADER.size, self.sequence, self.t_ns, self.encoder or 0.0)
        return head + self.picture

    @classmethod
    def from_bytes(cls, data: bytes) -> SentFrame:
        """The frame in a binary message. Raises BadFrame.

        >>> SentFrame.from_bytes(SentFrame(7, 5, None, b"picture").to_bytes()).sequence
        7
        """
        if len(data) < HEADER.size:
            raise BadFrame(f"a message of {len(data)} bytes, a frame begins with a header of {HEADER.size}")
        version, flags, size, sequence, t_ns, encoder = HEADER.unpack_from(data)
        if version != VERSION:
            raise BadFrame(f"version {version} of the header, this service reads {VERSION}")
        if not HEADER.size <= size <= len(data):
            raise BadFrame(f"a header of {size} bytes in a message of {len(data)}, allowed are {HEADER.size} and more")
        if t_ns < 0:
            raise BadFrame(f"a time of {t_ns} ns, allowed are 0 and above")
        if flags & WITH_ENCODER and not isfinite(encoder):
            raise BadFrame(f"an encoder position of {encoder}, allowed is a number")
        return cls(sequence, t_ns, encoder if flags & WITH_ENCODER else None, memoryview(data)[size:])
