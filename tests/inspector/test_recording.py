"""What is written can be read: by this program, exactly; by others, with the library's own reader."""

import resource
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from inspector.errors import NotARecording, NotRecorded, OutputExists, RecordingStopped
from inspector.objects import Objects, beneath
from inspector.pictures import encode_jpeg
from inspector.recording import Drop, ScoredWriter, SweepReader, SweepWriter, count_frames
from models.verdict import FrameState, Region, Residuals, ScoredFrame
from tests.inspector.line import cut
from tests.inspector.recordings import START_NS, encoded_frame, frame, pixels, same


def written(path: Path, frames, **options) -> Path:
    with SweepWriter(path, **options) as writer:
        for one in frames:
            writer.write(one)
    return path


def decoded(path: Path) -> dict[str, list]:
    """Messages by topic, through the library's reader, checksums validated."""
    topics: dict[str, list] = {}
    with path.open("rb") as file:
        for _, channel, message, body in make_reader(
            file, validate_crcs=True, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message, body))
    return topics


def chunk_compressions(path: Path) -> set[str]:
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True).records
        return {record.compression for record in records if type(record).__name__ == "Chunk"}


@pytest.mark.parametrize(
    ("shape", "kind"), [((9, 14), np.uint8), ((9, 14), np.uint16), ((9, 14, 3), np.uint8), ((9, 14, 3), np.uint16)]
)
def test_every_kind_of_pixels_comes_back_without_loss(tmp_path, shape, kind):
    sources = [frame(n, pixels=pixels(n, shape, kind)) for n in range(5)]
    frames = list(SweepReader(written(tmp_path / "a.mcap", sources)))
    assert [(f.sequence, f.t_ns) for f in frames] == [(f.sequence, f.t_ns) for f in sources]
    for one, source in zip(frames, sources, strict=True):
        assert one.pixels.dtype == kind
        assert np.array_equal(one.pixels, source.pixels)


def test_a_picture_that_came_encoded_is_kept_byte_for_byte(tmp_path):
    jpeg = encode_jpeg(pixels(1, (32, 40, 3)))
    path = written(tmp_path / "a.mcap", [frame(0, encoded=jpeg)])
    assert next(iter(SweepReader(path))).encoded == jpeg
    assert decoded(path)["/camera/image"][0][1].data == jpeg.data


@pytest.mark.parametrize("first", [frame, encoded_frame])
def test_pictures_that_came_encoded_and_others_can_stand_in_one_recording(tmp_path, first):
    other = encoded_frame if first is frame else frame
    path = written(tmp_path / "sweep.mcap", [first(0), other(1), first(2)])
    reader = SweepReader(path)
    assert all(same(one, number) for number, one in enumerate(reader))
    assert reader.losses == ()
    assert len(list(reader)) == 3


def test_chunks_of_raw_pictures_are_compressed_and_those_of_jpeg_are_not(tmp_path):
    assert chunk_compressions(written(tmp_path / "raw.mcap", [frame(0)])) == {"zstd"}
    assert chunk_compressions(written(tmp_path / "encoded.mcap", [encoded_frame(0)])) == {""}


def test_others_read_the_messages_of_foxglove(tmp_path):
    path = written(tmp_path / "a.mcap", [frame(0, pixels=pixels(0, (4, 6), np.uint16))])
    (message, image), *_ = decoded(path)["/camera/image"]
    assert (image.encoding, image.width, image.height, image.step) == ("mono16", 6, 4, 12)
    assert image.timestamp.seconds * 10**9 + image.timestamp.nanos == message.log_time == START_NS


def test_the_summary_announces_nothing_that_is_not_there(tmp_path):
    path = written(tmp_path / "a.mcap", [frame(0)], part_id="7")
    with path.open("rb") as file:
        groups = [r.group_length for r in StreamReader(file).records if type(r).__name__ == "SummaryOffset"]
    assert groups
    assert all(groups)


def test_facts_encoder_gaps_and_drops_come_back(tmp_path):
    path = tmp_path / "a.mcap"
    with SweepWriter(path, product_id="valve", part_id="0042", metadata={"operator": "Ünal"}) as writer:
        writer.write(encoded_frame(0, encoder=-1.5))
        writer.write(encoded_frame(1))
        writer.drop(3, START_NS + 99)
        writer.write(encoded_frame(5, encoder=0.1 + 0.2))
    reader = SweepReader(path)
    assert reader.facts == {"product_id": "valve", "part_id": "0042", "operator": "Ünal"}
    assert [(f.sequence, f.encoder) for f in reader] == [(0, -1.5), (1, None), (5, 0.1 + 0.2)]
    assert reader.drops == (Drop(START_NS + 99, 3),)
    assert reader.losses == ()
    assert (writer.frames, writer.saved, writer.drops) == (3, 3, 3)


def test_a_recording_can_be_read_again_and_again_and_side_by_side(tmp_path):
    reader = SweepReader(written(tmp_path / "a.mcap", [frame(n) for n in range(4)]))
    assert [f.sequence for f in reader] == [f.sequence for f in reader]
    assert [(a.sequence, b.sequence) for a, b in zip(reader, reader, strict=True)] == [(n, n) for n in range(4)]


def test_frames_are_counted_without_reading_them(tmp_path):
    path = written(tmp_path / "a.mcap", [frame(n, encoder=1.0) for n in range(7)])
    assert count_frames(path) == 7
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-9])
    assert count_frames(cut) is None
    assert count_frames(tmp_path / "missing.mcap") is None


def test_an_existing_file_is_never_overwritten(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(OutputExists, match=r"a\.mcap exists already"):
        SweepWriter(path)
    assert path.read_bytes() == b"precious"


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(NotRecorded, match=r"No such file or directory"):
        SweepWriter(tmp_path / "nowhere" / "a.mcap")


def test_what_is_due_is_readable_while_the_recording_goes_on(tmp_path):
    now = [0.0]
    writer = SweepWriter(tmp_path / "a.mcap", flush_seconds=1.0, clock=lambda: now[0])
    for number in range(10):
        now[0] = number * 0.4
        writer.write(encoded_frame(number))
    reader = SweepReader(writer.path)
    frames = list(reader)
    # Flushed with the frames at 1.2, 2.4 and 3.6 seconds: the last of them is number 9.
    assert writer.saved == 10
    assert all(same(f, n) for n, f in enumerate(frames))
    assert len(frames) == 10
    writer.write(encoded_frame(10))
    assert len(list(reader)) == writer.saved == 10
    assert reader.losses == (f"the recording was not closed, it ends without its index (byte {writer.bytes})",)
    now[0] = 9.0
    writer.flush_if_due()
    assert len(list(SweepReader(writer.path))) == writer.saved == 11
    writer.close()


def fill(writer: SweepWriter) -> None:
    with writer:
        for number in range(1000):
            writer.write(frame(number, pixels=pixels(number, (60, 80))))


def test_a_full_disk_ends_the_recording_with_one_sentence_and_keeps_what_was_flushed(tmp_path):
    path = tmp_path / "a.mcap"
    writer = SweepWriter(path, flush_seconds=0.0)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(
            RecordingStopped, match=r"File too large; at least the first \d+ frames are saved"
        ) as caught:
            fill(writer)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "\n" not in str(caught.value)
    frames = list(reader := SweepReader(path))
    assert 10 < len(frames) == caught.value.saved
    assert all(np.array_equal(f.pixels, pixels(n, (60, 80))) for n, f in enumerate(frames))
    assert len(reader.losses) == 1
    with pytest.raises(RecordingStopped, match="the recording is closed"):
        writer.write(frame(1000))


def test_a_scored_recording_shows_scores_and_boxes_beside_the_frames(tmp_path):
    region = Region(x=3, y=4, width=5, height=6, score=2.25, polarity="bright")
    scored = ScoredFrame(0, START_NS, FrameState.SCORED, 0.25, 2.25, 40.0, Residuals(2.25, 0.5, 0.1), (region,), 7)
    lost = replace(scored, index=1, state=FrameState.LOST, s=None, score=0.0, regions=())
    path = tmp_path / "a.mcap"
    with ScoredWriter(SweepWriter(path, part_id="0042")) as writer:
        writer.write(encoded_frame(0), scored)
        writer.write(encoded_frame(1), lost)
    topics = decoded(path)
    first, second = (body for _, body in topics["/inspection/score"])
    assert (first.index, first.state, first.s, first.score, first.position) == (0, "scored", 0.25, 2.25, 0.5)
    assert (first.regions[0].x, first.regions[0].height, first.regions[0].polarity) == (3, 6, "bright")
    assert not second.HasField("s")
    boxes, none = (body for _, body in topics["/camera/annotations"])
    assert [(p.x, p.y) for p in boxes.points[0].points] == [(3, 4), (8, 4), (8, 10), (3, 10)]
    assert [t.text for t in boxes.texts] == ["s 0.250  score 2.25", "2.25 bright"]
    assert len(none.points) == 0
    assert [same(f, n) for n, f in enumerate(SweepReader(path))] == [True, True]


@pytest.mark.parametrize("share", [1.0, 0.6])
def test_a_recording_is_read_by_url_as_from_the_disk(tmp_path, buckets, share):
    whole = written(tmp_path / "a.mcap", [frame(n, pixels=pixels(n, (60, 80))) for n in range(30)], part_id="7")
    path, url = cut(whole, tmp_path / "cut.mcap", share), buckets.new()
    Objects(url).put_new("line/a.mcap", path)
    place = beneath(url, "line/a.mcap")
    here, there = SweepReader(path), SweepReader(place)
    for one, other in zip(here, there, strict=True):
        assert np.array_equal(one.pixels, other.pixels)
        assert (one.t_ns, one.sequence) == (other.t_ns, other.sequence)
    assert (there.facts, there.losses, count_frames(place)) == (here.facts, here.losses, count_frames(path))
    with pytest.raises(NotARecording, match=r"^s3://bucket-\d+/line/b.mcap: there is nothing by that name"):
        SweepReader(beneath(url, "line/b.mcap"))


def test_of_a_recording_far_away_facts_and_length_cost_little(tmp_path, buckets, monkeypatch):
    path = written(tmp_path / "a.mcap", (frame(n) for n in range(60)), part_id="7", flush_seconds=0.0)
    url, asked, whole = buckets.new(), [], Objects.range
    Objects(url).put_new("a.mcap", path)

    def told(self, name, start, end):
        asked.append(end - start)
        return whole(self, name, start, end)

    monkeypatch.setattr(Objects, "range", told)
    reader = SweepReader(beneath(url, "a.mcap"))
    assert (reader.facts, count_frames(reader.path)) == ({"part_id": "7"}, 60)
    # Each looks at the beginning, then at the end; the summary of 60 chunks may need one more.
    assert len(asked) <= 9


def test_facts_are_found_where_the_index_does_not_tell_them_rightly(tmp_path):
    path = written(tmp_path / "a.mcap", [frame(0)], part_id="7")
    data = path.read_bytes()
    with path.open("rb") as file:
        index = next(iter(make_reader(file).get_summary().metadata_indexes))
    for offset in (0, index.offset + 1, len(data) + 5):
        wrong = data.replace(
            index.offset.to_bytes(8, "little") + index.length.to_bytes(8, "little"),
            offset.to_bytes(8, "little") + index.length.to_bytes(8, "little"),
        )
        assert wrong != data
        (tmp_path / "wrong.mcap").write_bytes(wrong)
        assert SweepReader(tmp_path / "wrong.mcap").facts == {"part_id": "7"}
