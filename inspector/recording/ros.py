"""The two picture messages of ROS, from their bytes: sensor_msgs/CompressedImage and Image, of ROS 1 and ROS 2.

Both are read by their layout, which has not changed since 2010, after a look at the definition in the file; the
general decoders generate and run Python code from that definition, which comes from whoever wrote the file.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

COMPRESSED = [("Header", "header"), ("string", "format"), ("uint8[]", "data")]
IMAGE = [
    ("Header", "header"),
    ("uint32", "height"),
    ("uint32", "width"),
    ("string", "encoding"),
    ("uint8", "is_bigendian"),
    ("uint32", "step"),
    ("uint8[]", "data"),
]


def fields_of(definition: str) -> list[tuple[str, str]]:
    """Type and name of each field of the first message in a definition, without packages.

    >>> fields_of("std_msgs/Header header  # when\\nuint8 OK=1\\nstring format\\n====\\nMSG: x")
    [('Header', 'header'), ('string', 'format')]
    """
    lines = (line.partition("#")[0].split() for line in definition.partition("\n===")[0].splitlines())
    fields = (line for line in lines if len(line) == 2 and "=" not in line[1])
    return [(kind.rpartition("/")[2], name) for kind, name in fields]


@dataclass
class Cursor:
    """Reads field after field; ValueError when the bytes end before the message does."""

    data: bytes
    ros2: bool
    at: int = 0
    order: str = "<"

    def __post_init__(self) -> None:
        if self.ros2:
            if len(self.data) < 4 or self.data[0] or self.data[1] not in (0, 1, 6, 7):
                raise ValueError(f"no plain CDR: it begins with {self.data[:4].hex()}")
            self.order = "<" if self.data[1] & 1 else ">"
            # CDR aligns numbers to multiples of their size, counted behind its own header.
            self.data = self.data[4:]

    def uint8(self) -> int:
        return self.bytes(1)[0]

    def uint32(self) -> int:
        if self.ros2:
            self.at += -self.at % 4
        (value,) = struct.unpack(self.order + "I", self.bytes(4))
        return value

    def bytes(self, count: int) -> bytes:
        part = self.data[self.at : self.at + count]
        if len(part) < count:
            raise ValueError("the message is cut short")
        self.at += count
        return part

    def string(self) -> str:
        return self.bytes(self.uint32()).decode("utf-8", "replace").rstrip("\0")

    def header(self) -> None:
        for _ in range(2 if self.ros2 else 3):
            self.uint32()
        self.string()

    def last(self) -> bytes:
        """The bytes that end the message; more behind them than padding means another layout."""
        value = self.bytes(self.uint32())
        if len(self.data) - self.at > (3 if self.ros2 else 0):
            raise ValueError(f"{len(self.data) - self.at} bytes too many in the message")
        return value


def read_compressed(data: bytes, ros2: bool) -> dict[str, object]:
    """Fields of a sensor_msgs/CompressedImage."""
    cursor = Cursor(data, ros2)
    cursor.header()
    return {"format": cursor.string(), "data": cursor.last()}


def read_image(data: bytes, ros2: bool) -> dict[str, object]:
    """Fields of a sensor_msgs/Image."""
    cursor = Cursor(data, ros2)
    cursor.header()
    return {
        "height": cursor.uint32(),
        "width": cursor.uint32(),
        "encoding": cursor.string(),
        "is_bigendian": cursor.uint8(),
        "step": cursor.uint32(),
        "data": cursor.last(),
    }
