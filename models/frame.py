"""Frame: one picture with its time, sequence number and, where there is one, its encoder position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.errors import PictureError


@dataclass(frozen=True)
class EncodedPicture:
    """A picture as it was received, byte for byte: what is recorded is what was scored."""

    format: str
    """`jpeg`, `png`, `webp`, ... in lower case."""
    data: bytes


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of a sweep. The pixels are read-only from birth.

    >>> frame = Frame(np.zeros((2, 3), np.uint8), t_ns=5, sequence=0)
    >>> frame.size, frame.pixels.flags.writeable
    ((3, 2), False)
    """

    pixels: np.ndarray
    """(height, width) grey or (height, width, 3) blue-green-red; uint8 or uint16."""
    t_ns: int
    """Time of exposure in nanoseconds since the epoch."""
    sequence: int
    """Counts the frames of the camera from 0; a gap is a lost frame."""
    encoder: float | None = None
    """Position reported by the robot or conveyor, in its own unit, where there is one."""
    encoded: EncodedPicture | None = None
    """The bytes that the pixels were decoded from, where they came encoded."""

    def __post_init__(self) -> None:
        shape, kind = self.pixels.shape, self.pixels.dtype
        if kind not in (np.dtype(np.uint8), np.dtype(np.uint16)):
            raise PictureError(f"frame {self.sequence}: pixels are {kind}, allowed are uint8 and uint16")
        if len(shape) not in (2, 3) or (len(shape) == 3 and shape[2] != 3) or 0 in shape:
            raise PictureError(f"frame {self.sequence}: shape {shape}, allowed are (h, w) and (h, w, 3)")
        pixels = self.pixels.view()
        pixels.flags.writeable = False
        object.__setattr__(self, "pixels", pixels)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.pixels.shape[1], self.pixels.shape[0]

    @property
    def kind(self) -> str:
        """Size, colour and depth: what all pictures of a sweep have in common."""
        return kind_of(self.pixels)


def kind_of(pixels: np.ndarray) -> str:
    """Size, colour and depth of a picture, for people.

    >>> kind_of(np.zeros((240, 320), np.uint8))
    '320x240 grey 8 bit'
    """
    colour = "grey" if pixels.ndim == 2 else "colour"
    return f"{pixels.shape[1]}x{pixels.shape[0]} {colour} {8 * pixels.dtype.itemsize} bit"
