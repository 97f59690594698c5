"""Recordings of other programs: every encoding, every compression, with and without index."""

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from inspector.errors import ManyCameras, NoPictures, NoSuchTopic, NotARecording
from inspector.pictures import encode_png
from inspector.recording import SweepReader, count_frames
from models.frame import EncodedPicture
from tests.inspector.recordings import (
    BARE,
    COMPRESSIONS,
    FOREIGN,
    ROS1_COMPRESSED,
    ROS_IMAGE,
    START_NS,
    cdr,
    foreign,
    pixels,
    ros1_compressed,
    ros1_image,
    ros2_compressed,
    same,
    write_messages,
)


def assert_whole(path: Path, count: int = 12) -> None:
    reader = SweepReader(path)
    frames = list(reader)
    assert [f.sequence for f in frames] == list(range(count))
    assert [f.t_ns for f in frames] == [START_NS + n * 40_000_000 for n in range(count)]
    assert all(same(f, n) for n, f in enumerate(frames))
    assert frames[0].encoded == encode_png(pixels(0))
    assert reader.losses == ()


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("kind", FOREIGN)
def test_every_encoding_under_every_compression(tmp_path, kind, compression):
    assert_whole(foreign(tmp_path / "a.mcap", kind, compression=compression))


@pytest.mark.parametrize("kind", FOREIGN)
def test_without_chunks_and_without_index(tmp_path, kind):
    assert_whole(foreign(tmp_path / "loose.mcap", kind, use_chunking=False))
    assert_whole(foreign(tmp_path / "bare.mcap", kind, **BARE))
    assert_whole(foreign(tmp_path / "both.mcap", kind, use_chunking=False, **BARE))
    assert count_frames(tmp_path / "bare.mcap") is None


def test_numbers_that_are_all_zero_are_counted_instead(tmp_path):
    assert_whole(foreign(tmp_path / "a.mcap", "ros2", sequences=[0] * 12))


def test_big_endian_ros2(tmp_path):
    message = ros2_compressed(encode_png(pixels(0)), ">")
    encoding, schema, _ = FOREIGN["ros2"]
    assert_whole(write_messages(tmp_path / "a.mcap", encoding, schema, [message]), 1)


def image_file(path: Path, *fields: object, **order: bool) -> Path:
    schema = ("sensor_msgs/Image", "ros1msg", ROS_IMAGE.encode())
    return write_messages(path, "ros1", schema, [ros1_image(*fields, **order)])


def only(path: Path) -> np.ndarray:
    (frame,) = SweepReader(path)
    return frame.pixels


COLOUR = pixels(3, (6, 8, 3))
ALPHA = pixels(4, (6, 8, 1))


@pytest.mark.parametrize(
    ("encoding", "stored", "seen"),
    [
        ("mono8", pixels(1, (6, 8)), pixels(1, (6, 8))),
        ("8UC1", pixels(1, (6, 8)), pixels(1, (6, 8))),
        ("mono16", pixels(1, (6, 8), np.uint16), pixels(1, (6, 8), np.uint16)),
        ("16UC1", pixels(1, (6, 8), np.uint16), pixels(1, (6, 8), np.uint16)),
        ("bgr8", COLOUR, COLOUR),
        ("8UC3", COLOUR, COLOUR),
        ("rgb8", COLOUR[:, :, ::-1], COLOUR),
        ("bgra8", np.dstack((COLOUR, ALPHA)), COLOUR),
        ("rgba8", np.dstack((COLOUR[:, :, ::-1], ALPHA)), COLOUR),
        ("rgb16", COLOUR[:, :, ::-1].astype(np.uint16) * 3, COLOUR.astype(np.uint16) * 3),
    ],
)
def test_raw_encodings_with_padded_rows_and_both_byte_orders(tmp_path, encoding, stored, seen):
    order = ["<", ">"] if stored.dtype == np.uint16 else ["<"]
    for sign in order:
        rows = [row.astype(row.dtype.newbyteorder(sign)).tobytes() for row in stored]
        for padding in (0, 5):
            path = tmp_path / f"{ord(sign)}-{padding}.mcap"
            data = b"".join(row + b"\xee" * padding for row in rows)
            image_file(path, 8, 6, encoding, len(rows[0]) + padding, data, big_endian=sign == ">")
            assert only(path).dtype == seen.dtype
            assert np.array_equal(only(path), seen)


@pytest.mark.parametrize(("pattern", "red"), [("rggb", (0, 0)), ("bggr", (1, 1)), ("gbrg", (1, 0)), ("grbg", (0, 1))])
def test_bayer_patterns_give_the_colour_that_was_in_front_of_them(tmp_path, pattern, red):
    # One flat colour seen through the filter: blue 10, green 100, red 200.
    mosaic = np.full((8, 8), 100, np.uint8)
    mosaic[red[0] :: 2, red[1] :: 2] = 200
    mosaic[1 - red[0] :: 2, 1 - red[1] :: 2] = 10
    picture = only(image_file(tmp_path / "a.mcap", 8, 8, f"bayer_{pattern}8", 8, mosaic.tobytes()))
    assert picture.tolist() == [[[10, 100, 200]] * 8] * 8


def test_ros2_image_and_foxglove_raw_image_as_json(tmp_path):
    fields = (1, 2, "frame of odd length", 4, 6, "mono8", False, 8, pixels(7, (4, 8)).tobytes())
    schema = ("sensor_msgs/msg/Image", "ros2msg", ROS_IMAGE.replace("std_msgs/", "std_msgs/msg/").encode())
    path = write_messages(tmp_path / "a.mcap", "cdr", schema, [cdr("<", *fields)])
    assert np.array_equal(only(path), pixels(7, (4, 8))[:, :6])
    picture = {"width": 2, "height": 1, "encoding": "mono8", "step": 2, "data": "AQI="}
    path = write_messages(
        tmp_path / "b.mcap", "json", ("foxglove.RawImage", "jsonschema", b"{}"), [json.dumps(picture).encode()]
    )
    assert only(path).tolist() == [[1, 2]]


BROKEN = {
    "short": ros1_image(8, 6, "mono8", 8, bytes(47)),
    "long": ros1_image(8, 6, "mono8", 8, bytes(49)),
    "narrow": ros1_image(8, 6, "mono8", 7, bytes(42)),
    "unknown": ros1_image(8, 6, "32FC1", 32, bytes(192)),
    "huge": ros1_image(1 << 20, 1 << 20, "mono8", 1 << 20, bytes(64)),
    "empty": ros1_image(0, 0, "mono8", 0, b""),
    "cut": ros1_image(8, 6, "mono8", 8, bytes(48))[:-1],
    "trailing": ros1_image(8, 6, "mono8", 8, bytes(48)) + b"x",
    "tiny": b"\x01",
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_picture_that_does_not_fit_is_left_out_told_and_leaves_a_gap(tmp_path, name):
    good = ros1_image(8, 6, "mono8", 8, pixels(1, (6, 8)).tobytes())
    schema = ("sensor_msgs/Image", "ros1msg", ROS_IMAGE.encode())
    path = write_messages(tmp_path / "a.mcap", "ros1", schema, [good, BROKEN[name], good], sequences=[0, 0, 0])
    reader = SweepReader(path)
    assert [f.sequence for f in reader] == [0, 2]
    (loss,) = reader.losses
    assert loss.startswith("1 pictures could not be decoded; the first is frame 1: ")
    assert "\n" not in loss


@pytest.mark.parametrize("kind", FOREIGN)
def test_a_cut_picture_or_message_is_left_out_in_every_encoding(tmp_path, kind):
    encoding, schema, pack = FOREIGN[kind]
    picture = encode_png(pixels(0))
    whole, cut = pack(picture), pack(EncodedPicture("png", picture.data[:-1]))
    messages = [whole, cut, whole[:-1], whole[: len(whole) // 2], b"", whole]
    reader = SweepReader(write_messages(tmp_path / "a.mcap", encoding, schema, messages))
    frames = list(reader)
    assert [f.sequence for f in frames] == [0, 5]
    assert reader.losses[0].startswith("4 pictures could not be decoded")


def test_a_recording_in_which_no_picture_can_be_read_is_refused(tmp_path):
    encoding, schema, _ = FOREIGN["json"]
    path = write_messages(tmp_path / "a.mcap", encoding, schema, [b"{}", b"[1]", b'{"format": 1, "data": "AA=="}'])
    reader = SweepReader(path)
    with pytest.raises(NoPictures, match=r"a\.mcap: no readable picture: 3 pictures could not be decoded") as caught:
        list(reader)
    assert "\n" not in str(caught.value)


def test_the_topic_is_chosen_or_asked_for(tmp_path):
    encoding, schema, pack = FOREIGN["ros1"]
    messages = [pack(encode_png(pixels(0)))]
    two = write_messages(tmp_path / "two.mcap", encoding, schema, messages, topics=("/left", "/right"))
    with pytest.raises(ManyCameras, match="choose one of /left, /right"):
        list(SweepReader(two))
    assert len(list(SweepReader(two, topic="/right"))) == 1
    with pytest.raises(NoSuchTopic, match="no pictures on topic /up, allowed is /left or /right"):
        list(SweepReader(two, topic="/up"))
    ours = write_messages(tmp_path / "ours.mcap", encoding, schema, messages, topics=("/a", "/camera/image"))
    assert SweepReader(ours).topic == "/camera/image"


def test_what_is_no_recording_of_pictures_is_refused_with_one_sentence(tmp_path):
    def refused(name: str, content: bytes) -> str:
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(NotARecording) as caught:
            SweepReader(path)
        return str(caught.value)

    whole = foreign(tmp_path / "whole.mcap", "json", 2).read_bytes()
    assert "the file is empty" in refused("empty.mcap", b"")
    assert "line endings were converted" in refused("text.mcap", whole.replace(b"\r\n", b"\n"))
    assert "no MCAP, it begins with 504b0304" in refused("zip.mcap", b"PK\x03\x04 and more")
    with pytest.raises(NotARecording, match="No such file"):
        SweepReader(tmp_path / "missing.mcap")
    other = write_messages(tmp_path / "other.mcap", "json", ("foxglove.Log", "jsonschema", b"{}"), [b"{}"])
    with pytest.raises(NoPictures, match="1 topics, none with pictures"):
        list(SweepReader(other))
    for options in ({}, BARE):
        nothing = write_messages(
            tmp_path / f"nothing{len(options)}.mcap", "json", ("x", "jsonschema", b""), [], topics=(), **options
        )
        with pytest.raises(NoPictures, match="no topics in it"):
            list(SweepReader(nothing))


def test_a_definition_that_is_not_that_of_ros_is_refused(tmp_path):
    swapped = ROS1_COMPRESSED.replace("string format", "uint32 format")
    schema = ("sensor_msgs/CompressedImage", "ros1msg", swapped.encode())
    path = write_messages(tmp_path / "a.mcap", "ros1", schema, [ros1_compressed(encode_png(pixels(0)))])
    with pytest.raises(NoPictures, match="is not the one of ROS"):
        list(SweepReader(path))


@pytest.mark.parametrize("schema", [b"\xff\xff", b"", struct.pack("<I", 7) * 9])
def test_a_protobuf_schema_that_is_rubbish_is_refused(tmp_path, schema):
    path = write_messages(tmp_path / "a.mcap", "protobuf", ("foxglove.CompressedImage", "protobuf", schema), [b"x"])
    with pytest.raises(NoPictures, match=r"the schema of foxglove\.CompressedImage in the file is not understood"):
        list(SweepReader(path))


def test_a_folder_that_holds_one_recording_is_that_recording(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    assert_whole(foreign(folder / "bag_0.mcap", "ros2").parent)
    foreign(folder / "bag_1.mcap", "ros2")
    with pytest.raises(NotARecording, match="a folder with 2 MCAP files"):
        SweepReader(folder)


def test_jpeg_of_a_ros_driver_is_read(tmp_path):
    picture = np.full((16, 16, 3), (10, 100, 200), np.uint8)
    data = cv2.imencode(".jpg", picture)[1].tobytes()
    encoding, schema, pack = FOREIGN["ros1"]
    message = pack(EncodedPicture("rgb8; jpeg compressed bgr8", data))
    assert (
        np.abs(only(write_messages(tmp_path / "a.mcap", encoding, schema, [message])).astype(int) - picture).max() < 4
    )
