"""Messages of a channel -> pictures: finds out how a channel is encoded, and refuses what is not understood."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar, cast

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Channel, Schema
from mcap_protobuf.decoder import DecoderFactory

from inspector.errors import PictureUnreadable
from inspector.pictures import MAX_PIXELS, decode
from inspector.recording import ros
from inspector.recording.raw_images import RawImage, to_pixels
from models.frame import EncodedPicture

COMPRESSED = ("format", "data")
RAW = ("width", "height", "encoding", "step", "data")
KINDS = {
    "foxglove.CompressedImage": COMPRESSED,
    "foxglove.RawImage": RAW,
    "sensor_msgs/CompressedImage": COMPRESSED,
    "sensor_msgs/msg/CompressedImage": COMPRESSED,
    "sensor_msgs/Image": RAW,
    "sensor_msgs/msg/Image": RAW,
}
"""The fields that are needed of each message that holds a picture, by the name of its schema."""
ENCODINGS = frozenset(("protobuf", "json", "ros1", "cdr"))

Fields = Mapping[str, object]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Picture:
    """What one message shows."""

    pixels: np.ndarray
    encoded: EncodedPicture | None


def holds_pictures(channel: Channel, schema: Schema | None) -> bool:
    """True for a channel whose messages this module can turn into pictures."""
    return schema is not None and schema.name in KINDS and channel.message_encoding in ENCODINGS


def picture_reader(channel: Channel, schema: Schema, max_pixels: int = MAX_PIXELS) -> Callable[[bytes], Picture]:
    """The function from a message's bytes to its picture; ValueError when the schema in the file is not understood."""
    names = KINDS[schema.name]
    fields = _field_reader(channel.message_encoding, schema, names)
    build = _compressed if names is COMPRESSED else _raw

    def read(data: bytes) -> Picture:
        try:
            return build(fields(data), max_pixels)
        except (ValueError, TypeError, KeyError, RecursionError, DecodeError) as error:
            raise PictureUnreadable(schema.name, len(data), f"the message is damaged: {error}") from error

    return read


def _field_reader(encoding: str, schema: Schema, names: tuple[str, ...]) -> Callable[[bytes], Fields]:
    if encoding == "protobuf":
        return protobuf_reader(schema, names)
    if encoding == "json":
        return _json_fields
    wanted, read = (ros.COMPRESSED, ros.read_compressed) if names is COMPRESSED else (ros.IMAGE, ros.read_image)
    if schema.encoding in ("ros1msg", "ros2msg") and ros.fields_of(schema.data.decode("utf-8", "replace")) != wanted:
        raise ValueError(f"the definition of {schema.name} in the file is not the one of ROS")
    return lambda data: read(data, encoding == "cdr")


def protobuf_reader(schema: Schema, names: tuple[str, ...]) -> Callable[[bytes], Fields]:
    """Fields by name, decoded by the schema in the file: its fields can be numbered differently from ours."""
    try:
        decoder = DecoderFactory().decoder_for("protobuf", schema)
    except Exception as error:
        # The schema comes from a stranger, and the libraries answer a bad one with nearly any exception.
        raise ValueError(f"the schema of {schema.name} in the file is not understood") from error
    if decoder is None:
        raise ValueError(f"the schema of {schema.name} in the file is {schema.encoding}, allowed is protobuf")
    return lambda data: _attributes(decoder(data), names)


def _attributes(message: object, names: tuple[str, ...]) -> Fields:
    missing = [name for name in names if not hasattr(message, name)]
    if missing:
        raise ValueError(f"no field {missing[0]} in the schema of the file")
    return {name: getattr(message, name) for name in names}


def _json_fields(data: bytes) -> Fields:
    loaded: object = json.loads(data)
    if not isinstance(loaded, dict):
        raise TypeError("no JSON object")
    fields = cast("dict[str, object]", loaded)
    return fields | {"data": base64.b64decode(_typed(fields, "data", str), validate=True)}


def _typed(fields: Fields, name: str, kind: type[T]) -> T:
    value = fields[name]
    if not isinstance(value, kind) or isinstance(value, bool):
        raise TypeError(f"{name} is {type(value).__name__}, allowed is {kind.__name__}")
    return value


def _compressed(fields: Fields, max_pixels: int) -> Picture:
    picture = EncodedPicture(_typed(fields, "format", str), _typed(fields, "data", bytes))
    return Picture(decode(picture, max_pixels=max_pixels), picture)


def _raw(fields: Fields, max_pixels: int) -> Picture:
    width, height, step = (_typed(fields, name, int) for name in ("width", "height", "step"))
    encoding, data = _typed(fields, "encoding", str), _typed(fields, "data", bytes)
    image = RawImage(width, height, encoding, step, data, bool(fields.get("is_bigendian")))
    return Picture(to_pixels(image, max_pixels=max_pixels), None)
