"""What others wrote beside the pictures: JSON messages of one topic, with the time of each."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.records import Message

from inspector.errors import RecordingError
from inspector.locations import RemoteFile, to_location
from inspector.recording.framing import RecordScan
from inspector.recording.reader import find_recording
from inspector.recording.summary import survey


def json_messages(path: Path | RemoteFile | str, topic: str) -> Iterator[tuple[int, Any]]:
    """(log time in ns, what the message says) in recorded order; nothing where there is no such topic.

    Raises NotARecording; RecordingError where a message on that topic is no JSON.
    """
    path = find_recording(to_location(path))
    with path.open("rb") as file:
        found = survey(file)
        channels = {number for number, channel in found.channels.items() if channel.topic == topic}
        for item in RecordScan(file, found.chunks) if channels else ():
            if isinstance(item, Message) and item.channel_id in channels:
                try:
                    yield item.log_time, json.loads(item.data)
                except ValueError as error:
                    raise RecordingError(f"{path}: a message on {topic} is no JSON: {error}") from error
