"""MCAP bytes -> records, for files that may be cut, damaged or hostile.

The library's own readers take a cut message for a whole one, reserve whatever a damaged length asks for, and give up
at the first bad checksum. This one reads what is whole, checks every checksum that there is, goes on behind a damaged
chunk, and yields a `Damage` in its place.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, BinaryIO, TypeAlias

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, McapRecord, Message, MessageIndex, Metadata, Schema

MAGIC = b"\x89MCAP0\r\n"
PREFIX = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQQ")
CHUNK = struct.Struct("<QQQII")
MAX_CHUNK = 1 << 29
"""A chunk that unpacks to more than this is a bomb, not a recording; ordinary writers stay near 1 MiB."""
WANTED = frozenset(
    (
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.MESSAGE,
        Opcode.CHUNK,
        Opcode.MESSAGE_INDEX,
        Opcode.METADATA,
        Opcode.DATA_END,
    )
)
BLOCK = 1 << 20


@dataclass(frozen=True)
class Damage:
    """A place of the file that could not be read."""

    offset: int
    why: str
    chunk: bool = False
    """A chunk with messages; the message indexes that follow it tell how many."""


@dataclass(frozen=True)
class Unchecked:
    """A message that lies whole in a chunk that was cut, where no checksum vouches for it."""

    message: Message


Item: TypeAlias = McapRecord | Damage | Unchecked


def _read_message(body: bytes) -> Message:
    channel, sequence, log_time, publish_time = MESSAGE.unpack_from(body)
    return Message(channel, log_time, body[MESSAGE.size :], publish_time, sequence)


def _by(read: Callable[[ReadDataStream], McapRecord]) -> Callable[[bytes], McapRecord]:
    return lambda body: read(ReadDataStream(io.BytesIO(body)))


PARSERS: dict[int, Callable[[bytes], McapRecord]] = {
    Opcode.MESSAGE: _read_message,
    Opcode.SCHEMA: _by(Schema.read),
    Opcode.CHANNEL: _by(Channel.read),
    Opcode.MESSAGE_INDEX: _by(MessageIndex.read),
    Opcode.METADATA: _by(Metadata.read),
    Opcode.DATA_END: _by(DataEnd.read),
}


def _parse(opcode: int, body: bytes) -> McapRecord | None:
    """A record that is not a chunk, None for one that is not needed; ValueError when its lengths do not fit."""
    try:
        return PARSERS[opcode](body) if opcode in PARSERS else None
    except (McapError, struct.error, UnicodeDecodeError) as error:
        raise ValueError(f"its content does not fit its kind {opcode:#x}") from error


def _unpack(compression: str, data: bytes, size: int) -> bytes:
    """At most `size` + 1 bytes: one more than announced is enough to know that the chunk lies."""
    if size > MAX_CHUNK:
        raise ValueError(f"unpacks to {size} bytes, allowed are {MAX_CHUNK}")
    try:
        match compression:
            case "":
                return data
            case "zstd":
                return zstandard.ZstdDecompressor().stream_reader(data).read(size + 1)
            case "lz4":
                unpacker: Any = lz4.frame.LZ4FrameDecompressor()
                return unpacker.decompress(data, max_length=size + 1)
            case _:
                raise ValueError(f"compression {compression!r}, allowed are none, zstd and lz4")
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise ValueError("its compressed data is damaged") from error


def open_chunk(body: bytes, *, cut: bool = False) -> Iterator[McapRecord]:
    """The records of a chunk; of a cut one those that lie whole before the cut, which no checksum covers."""
    try:
        _, _, size, crc, name_length = CHUNK.unpack_from(body)
        at = CHUNK.size + name_length
        compression = body[CHUNK.size : at].decode()
        (length,) = struct.unpack_from("<Q", body, at)
    except (struct.error, UnicodeDecodeError) as error:
        raise ValueError("its head is damaged") from error
    packed = body[at + 8 : at + 8 + length]
    data = _unpack(compression, packed, size)
    cut = cut and len(packed) < length
    if not cut and (len(packed) < length or len(data) != size or (crc and zlib.crc32(data) != crc)):
        raise ValueError("checksum or size does not match")
    return _records_of(data, cut)


def _records_of(data: bytes, cut: bool) -> Iterator[McapRecord]:
    at = 0
    while at + PREFIX.size <= len(data):
        opcode, length = PREFIX.unpack_from(data, at)
        at += PREFIX.size
        if at + length > len(data):
            break
        record = _parse(opcode, data[at : at + length])
        if record is not None:
            yield record
        at += length
    if at != len(data) and not cut:
        raise ValueError("the last record in it is not whole")


class RecordScan:
    """One pass over the data section of a file, in the order of the bytes."""

    def __init__(self, file: BinaryIO, chunks: Mapping[int, int], *, only: frozenset[int] | None = None) -> None:
        """`chunks`: offset and length of those known from a summary, so that a damaged length leads nobody astray.

        `only` leaves out all other records, and the checksum over the file with them.
        """
        self._file = file
        self._chunks = chunks
        self._starts = sorted(chunks)
        self._wanted = WANTED if only is None else only | {Opcode.DATA_END}
        self._size = file.seek(0, io.SEEK_END)
        self._crc = zlib.crc32(MAGIC) if only is None else None
        """Over everything so far; None once a jump has made it meaningless."""

    def __iter__(self) -> Iterator[Item]:
        offset: int | None = len(MAGIC)
        while offset is not None:
            offset = yield from self._step(offset)

    def _step(self, offset: int) -> Generator[Item, None, int | None]:
        """Reads one record; returns where the next one begins, None at the end."""
        self._file.seek(offset)
        prefix = self._file.read(PREFIX.size)
        if not prefix:
            yield Damage(offset, "the recording was not closed, it ends without its index")
            return None
        opcode, length = PREFIX.unpack(prefix) if len(prefix) == PREFIX.size else (0, 0)
        end = offset + PREFIX.size + length
        expected = self._chunks.get(offset)
        if expected and (opcode != Opcode.CHUNK or end != offset + expected):
            self._crc = None
            yield Damage(offset, "the head of a chunk is damaged", chunk=True)
            return offset + expected
        jump = next((start for start in self._starts if start > offset), None)
        if not opcode or end > self._size or (jump and jump < end):
            self._crc = None
            yield from self._unreadable(offset, opcode, jump)
            return jump
        checksum, body = self._body(prefix, length)
        yield from self._record(offset, opcode, body, checksum)
        return None if opcode == Opcode.DATA_END else end

    def _unreadable(self, offset: int, opcode: int, jump: int | None) -> Iterator[Item]:
        if jump is None and opcode == Opcode.CHUNK:
            with suppress(ValueError):
                for record in open_chunk(self._file.read(MAX_CHUNK), cut=True):
                    yield Unchecked(record) if isinstance(record, Message) else record
        yield Damage(offset, "a record is damaged" if jump else "the file is cut short or damaged from there on")

    def _body(self, prefix: bytes, length: int) -> tuple[int | None, bytes]:
        """The checksum before this record, and its body where it is wanted."""
        before = self._crc
        if prefix[0] in self._wanted and length <= MAX_CHUNK:
            body = self._file.read(length)
            self._crc = None if before is None else zlib.crc32(body, zlib.crc32(prefix, before))
            return before, body
        if before is not None:
            self._crc = zlib.crc32(prefix, before)
            for start in range(0, length, BLOCK):
                self._crc = zlib.crc32(self._file.read(min(BLOCK, length - start)), self._crc)
        return before, b""

    def _record(self, offset: int, opcode: int, body: bytes, checksum: int | None) -> Iterator[Item]:
        if opcode not in self._wanted:
            return
        try:
            if opcode == Opcode.CHUNK:
                # All or nothing: a chunk whose middle does not parse is not trusted at its beginning either.
                yield from list(open_chunk(body))
                return
            record = _parse(opcode, body)
        except ValueError as error:
            yield Damage(offset, f"{'chunk' if opcode == Opcode.CHUNK else 'record'}: {error}", opcode == Opcode.CHUNK)
            return
        if isinstance(record, DataEnd) and record.data_section_crc and checksum not in (None, record.data_section_crc):
            yield Damage(offset, "the checksum over the file does not match: a part of it is damaged")
        if record is not None:
            yield record
