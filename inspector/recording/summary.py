"""What a recording says of itself before it is read: topics, counts, where the chunks are, facts of the sweep."""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, Message, Metadata, MetadataIndex, Schema, Statistics

from inspector.recording.framing import MAGIC, MAX_CHUNK, PREFIX, Damage, RecordScan, Unchecked

FOOTER_BYTES = PREFIX.size + 20
FACTS = "sweep"
"""Name of the metadata record that carries the facts of the sweep."""
LOST_INDEX = "the index at the end of the file is missing or damaged; every frame before it was read without it"


@dataclass
class Survey:
    """Every channel of a recording, with its schema and the number of its messages."""

    channels: dict[int, Channel] = field(default_factory=dict[int, Channel])
    schemas: dict[int, Schema] = field(default_factory=dict[int, Schema])
    counts: Mapping[int, int] = field(default_factory=dict[int, int])
    chunks: dict[int, int] = field(default_factory=dict[int, int])
    """Length of each chunk by its offset, as far as known."""
    metadata: dict[int, MetadataIndex] = field(default_factory=dict[int, MetadataIndex])
    """Where records of metadata are, by offset; only from a summary."""
    metadata_count: int | None = None
    """How many there are, where a summary says it."""
    note: str | None = None
    """What is wrong with the file, where something is known to be."""

    def add(self, record: object) -> None:
        match record:
            case Schema():
                self.schemas[record.id] = record
            case Channel():
                self.channels[record.id] = record
            case ChunkIndex():
                self.chunks[record.chunk_start_offset] = record.chunk_length
            case MetadataIndex():
                self.metadata[record.offset] = record
            case Statistics():
                self.counts = record.channel_message_counts
                self.metadata_count = record.metadata_count
            case _:
                pass


KINDS = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.STATISTICS: Statistics,
}


def survey_summary(file: BinaryIO) -> Survey | None:
    """The survey from the summary at the end of the file; None when it has none, or not a complete one.

    ValueError when the summary is damaged, or cut off.
    """
    try:
        section = _summary_section(file)
        return _survey(section) if section else None
    except (McapError, struct.error, UnicodeDecodeError) as error:
        raise ValueError(LOST_INDEX) from error


def survey(file: BinaryIO) -> Survey:
    """What there is in a recording, from its summary, or by reading all of it."""
    try:
        return survey_summary(file) or survey_by_reading(file)
    except ValueError as error:
        found = survey_by_reading(file)
        found.note = found.note or str(error)
        return found


def _summary_section(file: BinaryIO) -> bytes | None:
    size = file.seek(0, io.SEEK_END)
    tail = FOOTER_BYTES + len(MAGIC)
    file.seek(max(0, size - tail))
    end = file.read(tail)
    if len(end) < tail or not end.endswith(MAGIC) or end[0] != Opcode.FOOTER:
        raise ValueError(LOST_INDEX)
    footer = Footer.read(ReadDataStream(io.BytesIO(end[PREFIX.size :])))
    if not footer.summary_start:
        return None
    if not len(MAGIC) <= footer.summary_start < size - tail:
        raise ValueError(LOST_INDEX)
    file.seek(footer.summary_start)
    section = file.read(size - tail - footer.summary_start)
    # The checksum covers the footer too, up to itself.
    if footer.summary_crc not in (0, zlib.crc32(end[: FOOTER_BYTES - 4], zlib.crc32(section))):
        raise ValueError(LOST_INDEX)
    return section


def _survey(section: bytes) -> Survey | None:
    found, statistics, at = Survey(), None, 0
    while at + PREFIX.size <= len(section):
        opcode, length = PREFIX.unpack_from(section, at)
        at += PREFIX.size
        if opcode in KINDS:
            record = KINDS[opcode].read(ReadDataStream(io.BytesIO(section[at : at + length])))
            found.add(record)
            statistics = record if isinstance(record, Statistics) else statistics
        at += length
    whole = statistics is not None and statistics.channel_count == len(found.channels)
    return found if whole else None


def survey_by_reading(file: BinaryIO) -> Survey:
    """The same from the data section: reads all of it, for recordings that were cut or never had a summary."""
    found, counts = Survey(), Counter[int]()
    for item in RecordScan(file, {}):
        if isinstance(item, Message | Unchecked):
            counts[item.message.channel_id if isinstance(item, Unchecked) else item.channel_id] += 1
        elif isinstance(item, Damage):
            found.note = found.note or f"{item.why} (byte {item.offset})"
        else:
            found.add(item)
    found.counts = counts
    return found


def read_facts(file: BinaryIO) -> dict[str, str]:
    """The facts of the sweep: from where the summary says that they are, or by a pass over the heads of all records."""
    with suppress(ValueError):
        found = survey_summary(file)
        if found is not None and (known := _indexed_facts(file, found)) is not None:
            return known
    facts: dict[str, str] = {}
    for item in RecordScan(file, {}, only=frozenset((Opcode.METADATA,))):
        if isinstance(item, Metadata) and item.name == FACTS:
            facts |= item.metadata
        if isinstance(item, Damage):
            break
    return facts


def _indexed_facts(file: BinaryIO, found: Survey) -> dict[str, str] | None:
    """None where the summary does not tell all of them, or not rightly."""
    if found.metadata_count != len(found.metadata):
        return None
    facts: dict[str, str] = {}
    for offset, index in sorted(found.metadata.items()):
        if index.name == FACTS:
            file.seek(offset)
            opcode, length = PREFIX.unpack(file.read(PREFIX.size).ljust(PREFIX.size, b"\0"))
            if opcode != Opcode.METADATA or length != index.length - PREFIX.size or length > MAX_CHUNK:
                return None
            try:
                record = Metadata.read(ReadDataStream(io.BytesIO(file.read(length))))
            except (McapError, struct.error, UnicodeDecodeError):
                return None
            if record.name != FACTS:
                return None
            facts |= record.metadata
    return facts
