"""SweepWriter: frames -> MCAP, exactly as they were scored.

A frame that came encoded is written byte for byte (`foxglove.CompressedImage`, no chunk compression: JPEG does not
shrink); any other as `foxglove.RawImage` under zstd, or, 16-bit colour, for which RawImage has no name, as PNG.
Chunks carry checksums. `/camera/encoder` holds the positions, `/sweep/events` the drops.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import Message

from inspector.pictures import encode_png
from inspector.recording.file import McapFile
from inspector.recording.schemas import new_message, stamp
from inspector.recording.summary import FACTS
from models.frame import EncodedPicture, Frame

IMAGE, ENCODER, EVENTS = "/camera/image", "/camera/encoder", "/sweep/events"
FRAME_ID = "camera"
RAW_ENCODINGS = {(2, "uint8"): "mono8", (2, "uint16"): "mono16", (3, "uint8"): "bgr8"}


class SweepWriter:
    """One sweep into one new file. A context manager: leaving it closes the file properly, whatever happened."""

    def __init__(
        self,
        path: Path | str,
        *,
        product_id: str | None = None,
        part_id: str | None = None,
        metadata: Mapping[str, str] | None = None,
        flush_seconds: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._file = McapFile(Path(path), flush_seconds, clock)
        facts = {"product_id": product_id, "part_id": part_id}
        self._as_encoded: bool | None = None
        """How the first frame went; a topic holds messages of one kind."""
        self._facts = {**(metadata or {}), **{name: value for name, value in facts.items() if value is not None}}
        self.drops = 0

    @property
    def path(self) -> Path:
        return self._file.path

    @property
    def frames(self) -> int:
        """Frames written so far."""
        return self._file.frames

    @property
    def saved(self) -> int:
        """Frames that are on the disk, come what may."""
        return self._file.saved

    @property
    def bytes(self) -> int:
        """Size of the file on the disk."""
        return self._file.bytes

    def write(self, frame: Frame, beside: Mapping[str, Message] | None = None) -> None:
        """Append a frame, and messages of the same moment by topic; what is due goes to the disk."""
        if not self._file.begun:
            self._file.begin(compress=frame.encoded is None, metadata={FACTS: self._facts})
        if self._as_encoded is None:
            self._as_encoded = frame.encoded is not None or not _has_name(frame)
        if frame.encoder is not None:
            position = new_message("Encoder", frame.t_ns, position=float(frame.encoder))
            self._file.add(ENCODER, position, frame.t_ns, frame.sequence)
        self._file.add(IMAGE, image_message(frame, self._as_encoded), frame.t_ns, frame.sequence)
        for topic, message in (beside or {}).items():
            self._file.add(topic, message, frame.t_ns, frame.sequence)
        self._file.frames += 1
        if self._file.frames == 1:
            # Topics and schemas stand in the first chunk: the smaller it is, the less can hit what all depends on.
            self._file.flush()
        else:
            self._file.flush_if_due()

    def drop(self, count: int, t_ns: int) -> None:
        """Tell that so many frames were lost before this time."""
        if not self._file.begun:
            self._file.begin(compress=True, metadata={FACTS: self._facts})
        self._file.add(EVENTS, new_message("SweepEvent", t_ns, kind="drop", count=count), t_ns, self.drops)
        self.drops += count

    def flush(self) -> None:
        """Bring everything so far to the disk."""
        if self._file.begun:
            self._file.flush()

    def flush_if_due(self) -> None:
        """The same, when it is time; for pauses in which no frame comes."""
        if self._file.begun:
            self._file.flush_if_due()

    def close(self) -> None:
        """Write the index and close. A second call does nothing."""
        if not self._file.begun:
            self._file.begin(compress=True, metadata={FACTS: self._facts})
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _has_name(frame: Frame) -> bool:
    """Whether RawImage has a name for such pixels."""
    return (frame.pixels.ndim, frame.pixels.dtype.name) in RAW_ENCODINGS


def image_message(frame: Frame, as_encoded: bool) -> Message:
    """The frame as Foxglove and rerun show it, with the bytes that it came with, or, without loss, as PNG or raw."""
    message: Any
    if as_encoded or not _has_name(frame):
        message = _compressed(frame.encoded or encode_png(frame.pixels))
    else:
        message = _raw(frame.pixels, RAW_ENCODINGS[frame.pixels.ndim, frame.pixels.dtype.name])
    stamp(message.timestamp, frame.t_ns)
    message.frame_id = FRAME_ID
    return message


def _compressed(picture: EncodedPicture) -> CompressedImage:
    return CompressedImage(format=picture.format, data=picture.data)


def _raw(pixels: np.ndarray, encoding: str) -> RawImage:
    height, width = pixels.shape[:2]
    # Little-endian, as Foxglove reads it.
    data = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<")).tobytes()
    return RawImage(width=width, height=height, encoding=encoding, step=len(data) // height, data=data)
