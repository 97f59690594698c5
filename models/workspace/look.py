"""Look: how a picture of a workspace becomes the vector x that places are told by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt

from models.errors import AppearanceError
from models.preparation import Preparation, Size

SIDES, SIGMA, STRIDE = (64, 128), 2.0, 2
"""Pixels of the longer side that pictures may be scaled to; by how many they are smoothed then; every so many are kept.

Splines join pictures well where what moves between two of them is wider than its way. Scaling down at once to every
second pixel costs a third of the precision: averages over squares let fine texture alias.
"""


@dataclass(frozen=True, eq=False)
class Look:
    """Scaled, smoothed, thinned out, of length 1, so that the lamp's strength does not count.

    >>> look = Look.at((128, 96), colour=False, side=64)
    >>> x = look.x(np.full((96, 128), 7, np.uint8))
    >>> x.shape, round(float(x @ x), 6)
    ((768,), 1.0)
    """

    preparation: Preparation
    """Bound to a picture size; its x is not of length 1."""
    stride: int
    """Every so many rows and columns are kept."""

    @classmethod
    def at(cls, picture: Size, *, colour: bool, side: int) -> Look:
        """For pictures of this (width, height), scaled to no more than `side` pixels."""
        by = min(1.0, side / max(picture))
        size = (max(1, round(picture[0] * by)), max(1, round(picture[1] * by)))
        stride = STRIDE if min(size) >= side // 4 else 1
        sigma = SIGMA * max(size) / side
        how = Preparation(size=size, colour=colour, content="smooth", sigma=sigma, unit_energy=False)
        return cls(how.bind(picture), stride)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Of a picture before it is thinned out: rows, columns, channels."""
        width, height = self.preparation.size or (1, 1)
        return (height, width, 3 if self.preparation.colour else 1)

    @property
    def p(self) -> int:
        """Length of x."""
        height, width, channels = self.shape
        return -(-height // self.stride) * -(-width // self.stride) * channels

    @property
    def shrinks(self) -> float:
        """Size of a picture as it is looked at, of its own."""
        return max(self.preparation.size or (1,)) / max(self.preparation.picture or (1,))

    def seen(self, pixels: UInt[np.ndarray, "h w *c"]) -> tuple[Float32[np.ndarray, " p"], float]:
        """x (p,) of a picture, and the length that it had before.

        Raises PictureError where the picture is of another size than learnt from, or of another type.
        """
        plain = self.preparation.prepare(pixels).reshape(self.shape)[:: self.stride, :: self.stride].reshape(-1)
        length = float(np.sqrt(plain @ plain))
        return plain * np.float32(1 / length if length > 0 else 0.0), length

    def x(self, pixels: UInt[np.ndarray, "h w *c"]) -> Float32[np.ndarray, " p"]:
        """Only x."""
        return self.seen(pixels)[0]

    def to_header(self) -> dict[str, Any]:
        """Everything: it has no masks."""
        return self.preparation.to_header() | {"stride": self.stride}

    @classmethod
    def from_header(cls, header: Mapping[str, Any]) -> Look:
        """What `to_header` gave. Raises AppearanceError where it is none."""
        preparation, stride = Preparation.from_parts(header, {}), int(header["stride"])
        if preparation.picture is None or preparation.size is None or preparation.windows or stride < 1:
            raise AppearanceError(f"the workspace looks at {preparation.picture} pixels, every {stride}")
        return cls(preparation, stride)


def looks(picture: Size, *, colour: bool) -> list[Look]:
    """Those that pictures of this (width, height) allow, the coarsest first."""
    sides = [side for side in SIDES if side == SIDES[0] or side <= max(picture)]
    return [Look.at(picture, colour=colour, side=side) for side in sides]
