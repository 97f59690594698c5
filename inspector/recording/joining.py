"""Parts of a recording -> one: an inspection that moved was recorded piece by piece, by more than one process."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mcap.records import Message

from inspector.locations import Location, RemoteFile, to_location
from inspector.recording.decoding import protobuf_reader
from inspector.recording.file import McapFile
from inspector.recording.framing import RecordScan
from inspector.recording.reader import find_recording
from inspector.recording.schemas import new_message
from inspector.recording.summary import FACTS, Survey, read_facts, survey
from inspector.recording.writer import EVENTS, IMAGE

_RAW = "foxglove.RawImage"
_END = 1 << 32
"""MCAP counts in 32 bits."""


def join_parts(parts: Sequence[Path | RemoteFile | str], starts: Sequence[int], out: Path) -> int:
    """The parts as one new recording, as one process would have written it; returns its number of frames.

    Part k gives its frames with starts[k] <= sequence < starts[k + 1], the last one all from its start on: what one
    process recorded beyond the point from which the next went on was sent, scored and recorded again. Pictures are
    copied byte for byte, unread; encoder positions and drops go with them; the facts are those of all parts. What a
    part has lost, because it was cut or damaged, is left out.

    Raises NotARecording for a part that is none, ObjectError for one that cannot be had, OutputExists,
    RecordingStopped; then `out` is as it was.
    """
    found = [find_recording(to_location(part)) for part in parts]
    surveys, facts = list[Survey](), dict[str, str]()
    for part in found:
        with part.open("rb") as file:
            surveys.append(survey(file))
            facts |= read_facts(file)
    joined = McapFile(out, 1.0, time.monotonic)
    try:
        raw = any(schema.name == _RAW for each in surveys for schema in each.schemas.values())
        joined.begin(compress=raw, metadata={FACTS: facts})
        joining = _Joining(joined)
        for part, known, start, end in zip(found, surveys, starts, [*starts[1:], _END], strict=True):
            joining.take(part, known, start, end)
        joined.close()
    except BaseException:
        joined.abandon()
        raise
    return joined.frames


class _Joining:
    """A recording that is put together, part by part."""

    def __init__(self, out: McapFile) -> None:
        self._out = out
        self._drops = 0

    def take(self, part: Location, known: Survey, start: int, end: int) -> None:
        """The frames of a part with start <= sequence < end, and the drops before them."""
        counts = {
            number: protobuf_reader(known.schemas[channel.schema_id], ("count",))
            for number, channel in known.channels.items()
            if channel.topic == EVENTS
        }
        at = start
        """The number of the next frame, were none lost without a word."""
        with part.open("rb") as file:
            for item in RecordScan(file, known.chunks):
                if not isinstance(item, Message):
                    continue
                if read := counts.get(item.channel_id):
                    fields: Any = read(item.data)
                    # those that were lost at its end may have come again, for the next part
                    if at + int(fields["count"]) <= end:
                        at += int(fields["count"])
                        self._drop(int(fields["count"]), item.log_time)
                elif start <= item.sequence < end:
                    at = item.sequence + 1
                    self._copy(item, known)

    def _drop(self, count: int, t_ns: int) -> None:
        event = new_message("SweepEvent", t_ns, kind="drop", count=count)
        self._out.add(EVENTS, event, t_ns, self._drops)
        self._drops += count

    def _copy(self, message: Message, known: Survey) -> None:
        channel = known.channels[message.channel_id]
        self._out.copy(channel, known.schemas[channel.schema_id], message)
        if channel.topic == IMAGE:
            self._out.frames += 1
            if self._out.frames == 1:
                # topics and schemas stand in the first chunk: the smaller it is, the less can hit what all depends on
                self._out.flush()
