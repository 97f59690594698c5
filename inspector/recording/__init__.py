"""Frames <-> MCAP, the only place that knows the format.

`SweepWriter` records, `ScoredWriter` adds what the inspection said, `SweepReader` reads those and what others wrote;
`count_frames` tells the length of a recording from its summary, `json_messages` reads what others wrote beside the
pictures, `join_parts` makes one recording of several. Each file of the package stands on those named before it:
schemas, file, framing, summary, ros, raw_images, decoding, writer, scored, reading, reader, joining, beside.
"""

from inspector.recording.beside import json_messages
from inspector.recording.joining import join_parts
from inspector.recording.reader import Drop, SweepReader, begins_as_mcap, count_frames
from inspector.recording.scored import ScoredWriter
from inspector.recording.writer import SweepWriter

__all__ = [
    "Drop",
    "ScoredWriter",
    "SweepReader",
    "SweepWriter",
    "begins_as_mcap",
    "count_frames",
    "join_parts",
    "json_messages",
]
