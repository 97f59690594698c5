"""What the service and a scorer process say to each other over pipes: a JSON head and bytes beside it.

| to the scorer | | answered by |
| --- | --- | --- |
| `load` | `appearance_id`, `path`: have it ready | nothing, or `failed` |
| `begin` | `id`, `appearance_id`, `path`, `policy`, `names`, `record_to` | `begun`, or `failed` |
| | to go on: `resume`, the sizes of the last state and of all that was added; they follow | |
| `frame` | `id`, `sequence`, `t_ns`, `encoder`; the picture | `frame`: `sequence`, `kinds`, `took`, `brief`; lines |
| | | and once, where another part lies there, `doubted`: `sizes`; that many pictures of its beginning |
| `drop` | `id`, `count`, `t_ns`: recorded as lost | nothing |
| `conclude` | `id`, `stopped`, `announced` | `concluded`: `result`, `recording`, `doubted`, `json`; frames, scores |
| `abort` | `id`, `reason`, `announced` | the same |
| `checkpoint` | `id` | `checkpoint`: `sequence`, `size` of the state; state, what was added since the last one |
| `release` | `id`: goes on elsewhere, no verdict | `released`: `recording` |
| `locate` | `id`, `sequence`, `workspace_id`, `path`; the picture | `located`: `sequence`, `took`, `refused`; JSON |
| `track` | the same, `t_ns`, `hand`; what is tracked under that `id` goes on | the same |
| `prepare` | `id`, `sequence`, `workspace_id`, `path`: have it ready | `located`, without more |
| `forget` | `id`: is not tracked any more | nothing |

A checkpoint stands for all that came before it in the line, and is answered when its pictures are on the disk; it
holds up nobody. Its `sequence` is that of the last frame handled, null before the first.
What cannot be done is answered by `failed`: `id`, `do`, `sequence`, `why`.
"""

from __future__ import annotations

import asyncio
import json
import struct
from typing import Any, BinaryIO

SIZES = struct.Struct("<II")
Head = dict[str, Any]


def pack(head: Head, body: bytes | memoryview = b"") -> bytes:
    """One message as bytes."""
    said = json.dumps(head, separators=(",", ":")).encode()
    return b"".join((SIZES.pack(len(said), len(body)), said, body))


def receive(stream: BinaryIO) -> tuple[Head, bytes] | None:
    """The next message, None at the end of the stream; waits for it."""
    sizes = stream.read(SIZES.size)
    if len(sizes) < SIZES.size:
        return None
    head_size, body_size = SIZES.unpack(sizes)
    said = stream.read(head_size + body_size)
    if len(said) < head_size + body_size:
        return None
    return json.loads(said[:head_size]), said[head_size:]


async def receive_async(stream: asyncio.StreamReader) -> tuple[Head, bytes] | None:
    """The same, on an event loop."""
    try:
        head_size, body_size = SIZES.unpack(await stream.readexactly(SIZES.size))
        said = await stream.readexactly(head_size + body_size)
    except asyncio.IncompleteReadError:
        return None
    return json.loads(said[:head_size]), said[head_size:]
