"""Seen: pictures to learn from, read once, and kept as they may be looked at."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float32, Float64

from models.errors import LearningError, PictureError
from models.workspace.grid import LabelledPicture, Parameter
from models.workspace.look import Look, looks

SENSOR = 2.0
"""Noise that is assumed of every pixel, in grey levels of 255."""


@dataclass
class Eye:
    """One way to look at all pictures, and what was seen so."""

    look: Look
    xs: dict[str, list[Float32[np.ndarray, " p"]]] = field(default_factory=dict[str, list[np.ndarray]])
    """Of each object, in the order of its pictures."""
    lengths: list[float] = field(default_factory=list[float])

    @property
    def noise(self) -> float:
        """The variance that the sensor's noise gives each coordinate."""
        return (SENSOR / 255 * self.look.shrinks / max(float(np.median(self.lengths)), 1e-9)) ** 2

    def of(self, name: str) -> Float32[np.ndarray, "n p"]:
        """All pictures of an object."""
        return np.stack(self.xs[name])


def seen(
    pictures: Iterable[LabelledPicture], parameters: Sequence[Parameter]
) -> tuple[dict[str, Float64[np.ndarray, "n m"]], list[Eye]]:
    """q (n, m) of each object's pictures, and the pictures as they may be looked at.

    Raises LearningError where there is none, or one has more or fewer q than there are parameters; PictureError that
    names object and place where pictures differ in size or type.
    """
    qs, eyes = dict[str, list[tuple[float, ...]]](), list[Eye]()
    for picture in pictures:
        place = ", ".join(f"{each.name} {value:g}" for each, value in zip(parameters, picture.q, strict=False))
        if len(picture.q) != len(parameters):
            allowed = ", ".join(parameter.name for parameter in parameters)
            raise LearningError(f"object {picture.object}: {len(picture.q)} numbers at {place}; needed are {allowed}")
        if not eyes:
            height, width = picture.pixels.shape[:2]
            eyes = [Eye(look) for look in looks((width, height), colour=picture.pixels.ndim == 3)]
        qs.setdefault(picture.object, []).append(picture.q)
        for eye in eyes:
            try:
                x, length = eye.look.seen(picture.pixels)
            except PictureError as error:
                raise PictureError(f"object {picture.object} at {place}: {error}") from error
            eye.xs.setdefault(picture.object, []).append(x)
            eye.lengths.append(length)
    if not eyes:
        raise LearningError("no picture to learn from")
    return {name: np.array(each, np.float64) for name, each in qs.items()}, eyes
