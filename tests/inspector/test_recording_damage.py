"""Damaged recordings: what is whole is read, what is lost is told, and no wrong picture ever comes out."""

import struct
import zlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from inspector.errors import NoPictures, NotARecording, RecordingError
from inspector.recording import SweepReader, SweepWriter, count_frames
from tests.inspector.recordings import BARE, FOREIGN, encoded_frame, foreign, frame, same

COUNT = 12
SLOW = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def layout(path: Path) -> list[tuple[int, int, int]]:
    """Where each frame's message, or the chunk with it, ends: (end of record, first number, frames in it)."""
    data, at, number, found = path.read_bytes(), 8, 0, []
    while at < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        end = at + 9 + length
        if opcode in (0x05, 0x06):
            record = data[:8] + data[at:end]
            chunk = opcode == 0x06
            frames = _messages(record) if chunk else 1
            found.append((end, number, frames))
            number += frames
        at = end
    return found


def _messages(file_of_one_chunk: bytes) -> int:
    from io import BytesIO

    records = StreamReader(BytesIO(file_of_one_chunk)).records
    found = 0
    try:
        for record in records:
            found += type(record).__name__ == "Message"
    except Exception:  # the piece has no end
        return found
    return found


def read(path: Path) -> tuple[list[int], tuple[str, ...]]:
    """Numbers of the frames that came, each checked to be the original; and the losses."""
    reader = SweepReader(path)
    try:
        frames = list(reader)
    except NoPictures as error:
        return [], (*reader.losses, str(error))
    assert all(same(f, f.sequence) for f in frames)
    return [f.sequence for f in frames], reader.losses


MAKERS = {
    f"{kind}-{name}": (kind, options)
    for kind in FOREIGN
    for name, options in {
        "chunks": {},
        "bare": BARE,
        "loose": {"use_chunking": False},
        "loose-bare": {"use_chunking": False, **BARE},
    }.items()
}


@pytest.mark.parametrize("maker", MAKERS)
def test_cut_anywhere_exactly_the_whole_frames_come_and_the_loss_is_told(tmp_path, maker):
    kind, options = MAKERS[maker]
    path = foreign(tmp_path / "whole.mcap", kind, COUNT, **options)
    data, places = path.read_bytes(), layout(path)
    assert sum(frames for _, _, frames in places) == COUNT
    edges = {end + d for end, _, _ in places for d in (-1, 0, 1, 9)}
    for length in sorted({*range(8, len(data), 61), *edges, len(data) - 1} & set(range(8, len(data)))):
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(data[:length])
        numbers, losses = read(cut)
        whole = sum(frames for end, _, frames in places if end <= length)
        assert numbers == list(range(whole)), length
        assert losses or not whole, length
        assert all("\n" not in loss for loss in losses)


def test_of_a_cut_chunk_without_compression_the_whole_messages_come(tmp_path):
    path = foreign(tmp_path / "whole.mcap", "ros1", COUNT, compression="none", chunk_size=1 << 20)
    ((end, _, _),) = layout(path)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: end // 2])
    numbers, losses = read(cut)
    assert 3 < len(numbers) < COUNT
    assert numbers == list(range(len(numbers)))
    assert losses


def test_of_a_cut_chunk_with_raw_pictures_nothing_comes(tmp_path):
    path = tmp_path / "a.mcap"
    with SweepWriter(path, flush_seconds=1e9) as writer:
        for number in range(COUNT):
            writer.write(frame(number))
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: layout(path)[1][0] - 1])
    numbers, losses = read(cut)
    # The first frame has a chunk to itself; no checksum vouches for what is left of the second.
    assert numbers == [0]
    assert losses


@pytest.mark.parametrize("closed", [True, False])
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@SLOW
def test_a_flipped_bit_never_gives_a_wrong_picture_and_costs_one_chunk_at_most(tmp_path, closed, place, bit):
    path = tmp_path / f"whole-{closed}.mcap"
    if not path.exists():
        write_ours(path, closed)
    data = bytearray(path.read_bytes())
    data[int(place * len(data))] ^= 1 << bit
    flipped = tmp_path / "flipped.mcap"
    flipped.write_bytes(data)
    if bytes(data[:8]) != b"\x89MCAP0\r\n":
        with pytest.raises(NotARecording):
            SweepReader(flipped)
        return
    numbers, losses = read(flipped)
    missing = set(range(COUNT)) - set(numbers)
    assert numbers == sorted(set(numbers))
    assert not missing or losses
    assert all("\n" not in loss for loss in losses)
    if closed:
        assert len(missing) <= 3


def write_ours(path: Path, closed: bool) -> None:
    """Five chunks of three frames at most; with the index, or as after a kill."""
    with SweepWriter(path, part_id="0042", flush_seconds=1e9) as writer:
        for number in range(COUNT):
            writer.write(encoded_frame(number))
            if number % 3 == 2:
                writer.flush()
    if not closed:
        data = path.read_bytes()
        path.write_bytes(data[: data.rindex(struct.pack("<BQ", 0x0F, 4))])


def test_the_frames_of_a_damaged_chunk_are_counted_and_leave_a_gap(tmp_path):
    for zeros in (False, True):
        path = foreign(tmp_path / f"{zeros}.mcap", "ros2", COUNT, sequences=[0] * COUNT if zeros else None)
        data, places = bytearray(path.read_bytes()), layout(path)
        end, first, frames = places[1]
        data[end - 20] ^= 4
        path.write_bytes(data)
        numbers, losses = read(path)
        assert numbers == [n for n in range(COUNT) if not first <= n < first + frames]
        assert losses == (losses[0],)
        assert losses[0].endswith(f", {frames} frames are lost")


def test_a_damaged_length_is_bridged_with_the_index(tmp_path):
    path = foreign(tmp_path / "a.mcap", "json", COUNT)
    data, places = bytearray(path.read_bytes()), layout(path)
    start = data.index(b"\x06", 8)
    assert places[0][0] == start + 9 + struct.unpack_from("<Q", data, start + 1)[0]
    for at in range(start, start + 9):
        copy = bytearray(data)
        copy[at] ^= 0x40
        path.write_bytes(copy)
        numbers, losses = read(path)
        assert numbers == list(range(places[1][1], COUNT))
        assert losses


def test_a_damaged_index_is_done_without(tmp_path):
    path = foreign(tmp_path / "a.mcap", "protobuf", COUNT)
    data = bytearray(path.read_bytes())
    data[-60] ^= 1
    path.write_bytes(data)
    numbers, losses = read(path)
    assert numbers == list(range(COUNT))
    assert losses == (
        "the index at the end of the file is missing or damaged; every frame before it was read without it",
    )
    assert count_frames(path) is None


def test_a_flip_outside_the_chunks_is_told_by_the_checksum_over_the_file(tmp_path):
    path = tmp_path / "a.mcap"
    write_ours(path, closed=True)
    data = bytearray(path.read_bytes())
    data[data.index(b"0042")] ^= 1
    path.write_bytes(data)
    numbers, losses = read(path)
    assert numbers == list(range(COUNT))
    assert "the checksum over the file does not match" in losses[0]


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none", "brotli"])
def test_a_chunk_that_lies_about_its_size_is_refused_without_unpacking_it_all(tmp_path, compression):
    import lz4.frame
    import zstandard

    pack = {"zstd": zstandard.compress, "lz4": lz4.frame.compress}.get(compression, bytes)
    path = foreign(tmp_path / "a.mcap", "ros1", 3, **BARE)
    whole = path.read_bytes()
    for announced in (100, 1 << 40):
        builder = RecordBuilder()
        name = "" if compression == "none" else compression
        Chunk(name, pack(bytes(30_000_000)), 0, 0, zlib.crc32(b""), announced).write(builder)
        end = layout(path)[-1][0]
        (tmp_path / "b.mcap").write_bytes(whole[:end] + builder.end() + whole[end:])
        numbers, losses = read(tmp_path / "b.mcap")
        assert numbers == [0, 1, 2]
        assert losses[0].startswith("chunk: ")


@given(st.binary(max_size=300))
@SLOW
def test_rubbish_behind_the_magic_is_refused_with_one_sentence(tmp_path, rubbish):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + rubbish)
    with pytest.raises(RecordingError) as caught:
        list(SweepReader(path))
    assert "\n" not in str(caught.value)
