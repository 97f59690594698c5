"""The messages of our own, as protobuf: built here in code, so that no compiler and no generated file is needed.

Their definition travels in every recording, so that Foxglove, rerun and scripts plot them without this program.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from google.protobuf import descriptor_pb2, timestamp_pb2
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass

PACKAGE = "sweep_inspector"
STAMP = ".google.protobuf.Timestamp"
Field = descriptor_pb2.FieldDescriptorProto
TYPES: Mapping[str, Any] = {
    "double": Field.TYPE_DOUBLE,
    "string": Field.TYPE_STRING,
    "uint32": Field.TYPE_UINT32,
    "int32": Field.TYPE_INT32,
}
# Field numbers follow the order: append, never insert. `?` marks what may be missing, `*` what may come many times.
MESSAGES: Mapping[str, Mapping[str, str]] = {
    "Encoder": {"timestamp": STAMP, "position": "double"},
    "SweepEvent": {"timestamp": STAMP, "kind": "string", "count": "uint32"},
    "Region": {
        "x": "int32",
        "y": "int32",
        "width": "int32",
        "height": "int32",
        "score": "double",
        "polarity": "string",
    },
    "Score": {
        "timestamp": STAMP,
        "index": "uint32",
        "state": "string",
        "s": "double?",
        "score": "double",
        "raw_score": "double",
        "appearance": "double",
        "position": "double",
        "timing": "double",
        "reference": "int32",
        "regions": f".{PACKAGE}.Region*",
    },
}


def _pool() -> DescriptorPool:
    pool = DescriptorPool()
    stamp = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamp)
    pool.Add(stamp)
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{PACKAGE}.proto", package=PACKAGE, syntax="proto3", dependency=[stamp.name]
    )
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        for number, (field, kind) in enumerate(fields.items(), start=1):
            _add_field(message, number, field, kind)
    pool.Add(file)
    return pool


def _add_field(message: descriptor_pb2.DescriptorProto, number: int, name: str, kind: str) -> None:
    plain = kind.rstrip("?*")
    field = message.field.add(name=name, number=number)
    field.label = Field.LABEL_REPEATED if kind.endswith("*") else Field.LABEL_OPTIONAL
    if plain.startswith("."):
        field.type, field.type_name = Field.TYPE_MESSAGE, plain
    else:
        field.type = TYPES[plain]
    if kind.endswith("?"):
        # Protobuf's way to tell 0.0 from nothing: a choice of one.
        field.proto3_optional, field.oneof_index = True, len(message.oneof_decl)
        message.oneof_decl.add(name=f"_{name}")


POOL = _pool()


def new_message(name: str, t_ns: int, **fields: object) -> Message:
    """One of the messages above, with its time.

    >>> new_message("Encoder", 1_500_000_000, position=2.5).position
    2.5
    """
    kind: Any = GetMessageClass(POOL.FindMessageTypeByName(f"{PACKAGE}.{name}"))
    message = kind(**fields)
    stamp(message.timestamp, t_ns)
    return message


def stamp(timestamp: Any, t_ns: int) -> None:
    """Write nanoseconds into a google.protobuf.Timestamp."""
    timestamp.seconds, timestamp.nanos = divmod(t_ns, 1_000_000_000)
