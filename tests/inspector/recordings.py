"""Recordings as other programs write them, made with the MCAP library's own writer, for the tests of the reader."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path

import numpy as np
from google.protobuf import descriptor_pb2
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType, IndexType, Writer

from inspector.pictures import encode_png
from models.frame import EncodedPicture, Frame

START_NS = 1_700_000_000_000_000_000
COMPRESSIONS = {"none": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
ROS1_COMPRESSED = "std_msgs/Header header\nstring format  # jpeg or png\nuint8[] data\n====\nMSG: std_msgs/Header\n"
ROS2_COMPRESSED = ROS1_COMPRESSED.replace("std_msgs/Header header", "std_msgs/msg/Header header")
ROS_IMAGE = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n"
    "uint8 is_bigendian\nuint32 step\nuint8[] data\n"
)


def pixels(number: int, shape: tuple[int, ...] = (12, 16), kind: type = np.uint8) -> np.ndarray:
    """Different for every number, and nothing a damaged file would make by chance."""
    return np.random.default_rng(number).integers(0, np.iinfo(kind).max, shape, dtype=kind)


def frame(number: int, **changes: object) -> Frame:
    known = {"pixels": pixels(number), "t_ns": START_NS + number * 40_000_000, "sequence": number}
    return Frame(**(known | changes))


def encoded_frame(number: int, **changes: object) -> Frame:
    return frame(number, encoded=encode_png(pixels(number)), **changes)


def same(frame: Frame, number: int) -> bool:
    return np.array_equal(frame.pixels, pixels(number))


def renumbered() -> tuple[str, str, bytes, type]:
    """A foxglove.CompressedImage whose fields have other numbers than Foxglove's own."""
    file = descriptor_pb2.FileDescriptorProto(name="other.proto", package="foxglove", syntax="proto3")
    message = file.message_type.add(name="CompressedImage")
    message.field.add(name="format", number=7, type=9, label=1)
    message.field.add(name="frame_id", number=2, type=9, label=1)
    message.field.add(name="data", number=1, type=12, label=1)
    pool = DescriptorPool()
    pool.Add(file)
    data = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
    return (
        "foxglove.CompressedImage",
        "protobuf",
        data,
        GetMessageClass(pool.FindMessageTypeByName(f"foxglove.{message.name}")),
    )


def ros1_string(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def ros1_compressed(picture: EncodedPicture) -> bytes:
    header = struct.pack("<III", 3, 1_700_000_000, 5) + ros1_string(b"camera")
    return header + ros1_string(picture.format.encode()) + ros1_string(picture.data)


def ros1_image(width: int, height: int, encoding: str, step: int, data: bytes, *, big_endian: bool = False) -> bytes:
    header = struct.pack("<III", 3, 1_700_000_000, 5) + ros1_string(b"cam")
    middle = ros1_string(encoding.encode()) + struct.pack("<BI", big_endian, step)
    return header + struct.pack("<II", height, width) + middle + ros1_string(data)


def cdr(order: str, *fields: object) -> bytes:
    """Common Data Representation: integers aligned to four bytes, strings closed by a zero."""
    out = b""
    for field in fields:
        if isinstance(field, bool):
            out += bytes([field])
            continue
        out += bytes(-len(out) % 4)
        if isinstance(field, int):
            out += struct.pack(order + "I", field)
        else:
            data = field.encode() + b"\0" if isinstance(field, str) else field
            out += struct.pack(order + "I", len(data)) + data
    return bytes((0, order == "<", 0, 0)) + out


def ros2_compressed(picture: EncodedPicture, order: str = "<") -> bytes:
    return cdr(order, 1_700_000_000, 5, "cam", picture.format, picture.data)


def json_compressed(picture: EncodedPicture) -> bytes:
    stamp = {"sec": 1_700_000_000, "nsec": 5}
    return json.dumps(
        {"timestamp": stamp, "format": picture.format, "data": base64.b64encode(picture.data).decode()}
    ).encode()


def protobuf_compressed(picture: EncodedPicture) -> bytes:
    return renumbered()[3](format=picture.format, frame_id="x", data=picture.data).SerializeToString()


FOREIGN = {
    "json": ("json", ("foxglove.CompressedImage", "jsonschema", b"{}"), json_compressed),
    "protobuf": ("protobuf", renumbered()[:3], protobuf_compressed),
    "ros1": ("ros1", ("sensor_msgs/CompressedImage", "ros1msg", ROS1_COMPRESSED.encode()), ros1_compressed),
    "ros2": ("cdr", ("sensor_msgs/msg/CompressedImage", "ros2msg", ROS2_COMPRESSED.encode()), ros2_compressed),
}
"""Message encoding, schema, and the function from a picture to a message's bytes."""


def write_messages(
    path: Path,
    encoding: str,
    schema: tuple[str, str, bytes],
    messages: list[bytes],
    *,
    topics: tuple[str, ...] = ("/cam",),
    sequences: list[int] | None = None,
    **options: object,
) -> Path:
    """The messages on every topic, by the library's writer with its options."""
    with path.open("xb") as file:
        writer = Writer(file, **({"chunk_size": 1500} | options))
        writer.start()
        channels = [writer.register_channel(topic, encoding, writer.register_schema(*schema)) for topic in topics]
        for number, message in enumerate(messages):
            sequence = number if sequences is None else sequences[number]
            for channel in channels:
                time = START_NS + number * 40_000_000
                writer.add_message(channel, time, message, time, sequence)
        writer.finish()
    return path


def foreign(path: Path, kind: str, count: int = 12, compression: str = "zstd", **options: object) -> Path:
    """A recording of `count` frames, each `encoded_frame(number)`, in one of the FOREIGN kinds."""
    encoding, schema, pack = FOREIGN[kind]
    messages = [pack(encode_png(pixels(number))) for number in range(count)]
    return write_messages(path, encoding, schema, messages, compression=COMPRESSIONS[compression], **options)


BARE = {
    "index_types": IndexType.NONE,
    "repeat_channels": False,
    "repeat_schemas": False,
    "use_statistics": False,
    "use_summary_offsets": False,
}
"""Options of a writer that leaves out every index and summary."""
