"""One pass over a recording: messages -> frames, with a record of everything that was lost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, BinaryIO

from google.protobuf.message import DecodeError
from mcap.records import Message, MessageIndex

from inspector.errors import NoPictures, PictureUnreadable
from inspector.locations import Location
from inspector.recording.decoding import Fields, Picture, holds_pictures, picture_reader, protobuf_reader
from inspector.recording.framing import Damage, RecordScan, Unchecked
from inspector.recording.schemas import PACKAGE
from inspector.recording.summary import Survey
from inspector.recording.writer import ENCODER, EVENTS
from models.errors import PictureError
from models.frame import Frame

FIELDS = {ENCODER: ("position",), EVENTS: ("kind", "count")}


class Pass:
    """State of one iteration; a new one for each."""

    def __init__(self, path: Location, survey: Survey, topic: str, max_pixels: int) -> None:
        self.drops: list[tuple[int, int]] = []
        self.yielded = 0
        self._survey = survey
        self._pictures = _picture_readers(path, survey, topic, max_pixels)
        self._beside = _readers_beside(survey)
        self._position: tuple[int, int, float] | None = None
        """Sequence, time and value of the encoder's last word; it comes just before its frame."""
        self._last = -1
        self._gap = 0
        """Frames of damaged chunks since the last frame."""
        self._damages: list[tuple[Damage, int]] = []
        """Each with the number of frames known to be lost by it."""
        self._open = False
        """Whether a damaged chunk was the last thing with messages."""
        self._bad: list[str] = []
        self._seen = 0
        self._finished = False

    def frames(self, file: BinaryIO) -> Iterator[Frame]:
        """The frames that can be read; everything else is kept for `losses`."""
        for item in RecordScan(file, self._survey.chunks):
            match item:
                case Message():
                    self._open = False
                    yield from self._take(item)
                case Unchecked():
                    yield from self._take(item.message, checked=False)
                case Damage():
                    self._damages.append((item, 0))
                    self._open = item.chunk
                case MessageIndex():
                    self._count_lost(item)
                case _:
                    pass
        self._finished = True

    def losses(self) -> Iterator[str]:
        """A sentence for each thing that was lost."""
        for damage, frames in self._damages:
            lost = f", {frames} frames are lost" if frames else ""
            yield f"{damage.why} (byte {damage.offset}){lost}"
        if self._bad:
            yield f"{len(self._bad)} pictures could not be decoded; the first is {self._bad[0]}"
        if not self._finished:
            return
        missing = sum(self._survey.counts.get(number, 0) for number in self._pictures) - self._seen
        if missing > 0 and not self._damages:
            yield f"{missing} frames that the index announces are not in the file"
        if self._survey.note and not self._damages:
            yield self._survey.note

    def _count_lost(self, index: MessageIndex) -> None:
        """The indexes behind a damaged chunk tell how many frames it held."""
        if self._open and index.channel_id in self._pictures:
            damage, frames = self._damages[-1]
            self._damages[-1] = damage, frames + len(index.records)
            self._gap += len(index.records)

    def _take(self, message: Message, *, checked: bool = True) -> Iterator[Frame]:
        if message.channel_id in self._beside:
            self._take_beside(message)
        if message.channel_id not in self._pictures:
            return
        self._seen += 1
        sequence = self._number(message.sequence)
        try:
            picture = self._pictures[message.channel_id](message.data)
            frame = Frame(picture.pixels, message.log_time, sequence, self._encoder(message), picture.encoded)
        except (PictureUnreadable, PictureError) as error:
            self._bad.append(f"frame {sequence}: {error}")
            return
        # Where no checksum vouches, only what its decoder checks: raw pixels would be believed whatever they are.
        if checked or frame.encoded is not None:
            self.yielded += 1
            yield frame

    def _number(self, recorded: int) -> int:
        """The recorded number where it counts on, else the next one: many writers leave it at 0."""
        self._last = recorded if recorded > self._last + self._gap else self._last + 1 + self._gap
        self._gap = 0
        return self._last

    def _encoder(self, message: Message) -> float | None:
        if self._position and self._position[:2] == (message.sequence, message.log_time):
            return self._position[2]
        return None

    def _take_beside(self, message: Message) -> None:
        topic, read = self._beside[message.channel_id]
        try:
            fields: Any = read(message.data)
        except (DecodeError, ValueError) as error:
            self._bad.append(f"a message on {topic}: {error}")
            return
        if topic == ENCODER:
            self._position = message.sequence, message.log_time, float(fields["position"])
        elif fields["kind"] == "drop":
            self.drops.append((message.log_time, int(fields["count"])))


def _picture_readers(
    path: Location, survey: Survey, topic: str, max_pixels: int
) -> dict[int, Callable[[bytes], Picture]]:
    readers: dict[int, Callable[[bytes], Picture]] = {}
    for number, channel in survey.channels.items():
        schema = survey.schemas.get(channel.schema_id)
        if channel.topic == topic and schema is not None and holds_pictures(channel, schema):
            try:
                readers[number] = picture_reader(channel, schema, max_pixels)
            except ValueError as error:
                raise NoPictures(path, f"topic {topic}: {error}") from error
    return readers


def _readers_beside(survey: Survey) -> dict[int, tuple[str, Callable[[bytes], Fields]]]:
    """Of the channels that this program adds to a recording."""
    readers: dict[int, tuple[str, Callable[[bytes], Fields]]] = {}
    for number, channel in survey.channels.items():
        schema = survey.schemas.get(channel.schema_id)
        if channel.topic in FIELDS and schema is not None and schema.name.startswith(PACKAGE):
            with suppress(ValueError):
                readers[number] = channel.topic, protobuf_reader(schema, FIELDS[channel.topic])
    return readers
