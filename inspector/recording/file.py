"""An MCAP file being written: on the disk within a second, readable after a kill, closed after a full disk."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from google.protobuf.message import Message
from mcap.records import Channel, Schema
from mcap.records import Message as Recorded
from mcap.writer import CompressionType, IndexType, Writer
from mcap_protobuf.schema import register_schema

from inspector.errors import NotRecorded, OutputExists, RecordingStopped


class McapFile:
    """Messages by topic into a new file; counts what is safely on the disk."""

    def __init__(self, path: Path, flush_seconds: float, clock: Callable[[], float]) -> None:
        try:
            self._file: BinaryIO = path.open("xb")
        except FileExistsError as error:
            raise OutputExists(path) from error
        except OSError as error:
            raise NotRecorded(path, error.strerror or str(error)) from error
        self.path = path
        self.saved = 0
        """Frames on the disk."""
        self.frames = 0
        """Frames written so far."""
        self._writer: Writer | None = None
        self._channels: dict[str, int] = {}
        self._flush_seconds, self._clock, self._flushed = flush_seconds, clock, clock()

    @property
    def begun(self) -> bool:
        return self._writer is not None

    @property
    def bytes(self) -> int:
        """Size on the disk."""
        return self.path.stat().st_size

    def begin(self, compress: bool, metadata: Mapping[str, Mapping[str, str]]) -> None:
        """Facts come first, outside the chunks, where a reader finds them at once."""
        kind = CompressionType.ZSTD if compress else CompressionType.NONE
        # No index of attachments: there are none, and the library would announce an empty one, which checkers refuse.
        indexes = IndexType.CHUNK | IndexType.MESSAGE | IndexType.METADATA
        self._writer = Writer(self._file, compression=kind, index_types=indexes, enable_data_crcs=True)
        self._attempt(lambda writer: writer.start(profile="", library="sweep-inspector"))
        for name, facts in metadata.items():
            self._attempt(lambda writer, name=name, facts=facts: writer.add_metadata(name, dict(facts)))

    def add(self, topic: str, message: Message, t_ns: int, sequence: int) -> None:
        """One message; its topic is announced before the first of its kind."""
        data = message.SerializeToString()

        def write(writer: Writer) -> None:
            if topic not in self._channels:
                self._channels[topic] = writer.register_channel(topic, "protobuf", register_schema(writer, message))
            writer.add_message(self._channels[topic], t_ns, data, t_ns, sequence)

        self._attempt(write)

    def copy(self, channel: Channel, schema: Schema, message: Recorded) -> None:
        """A message of another recording, byte for byte."""

        def write(writer: Writer) -> None:
            topic = channel.topic
            if topic not in self._channels:
                made = writer.register_schema(schema.name, schema.encoding, schema.data)
                self._channels[topic] = writer.register_channel(topic, channel.message_encoding, made)
            number, sequence = self._channels[topic], message.sequence
            writer.add_message(number, message.log_time, message.data, message.publish_time, sequence)

        self._attempt(write)

    def flush_if_due(self) -> None:
        """Bring everything so far to the disk, if the last time is `flush_seconds` ago."""
        if self._clock() - self._flushed >= self._flush_seconds:
            self.flush()

    def flush(self) -> None:
        """Bring everything so far to the disk: a kill or a power cut after this loses nothing of it."""
        self._attempt(self._flush)
        self._flushed = self._clock()

    def _flush(self, writer: Writer) -> None:
        writer.flush()
        self._file.flush()
        os.fsync(self._file.fileno())
        self.saved = self.frames

    def close(self) -> None:
        """Write the index and close. A second call does nothing."""
        if self._file.closed:
            return
        self._attempt(self._flush)
        self._attempt(lambda writer: writer.finish())
        self._attempt(self._flush)
        self._file.close()

    def abandon(self) -> None:
        """Close, and leave no file."""
        with suppress(OSError):
            self._file.close()
        self.path.unlink(missing_ok=True)

    def _attempt(self, action: Callable[[Writer], object]) -> None:
        if self._writer is None or self._file.closed:
            raise RecordingStopped(self.path, self.saved, "the recording is closed")
        try:
            action(self._writer)
        except OSError as error:
            # Closing tries once more to write what is buffered, fails the same way, and closes all the same.
            with suppress(OSError):
                self._file.close()
            raise RecordingStopped(self.path, self.saved, error.strerror or str(error)) from error
