"""Encoder: where a robot or conveyor says that it is, as one more guess at the place, which may be wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite

import numpy as np
from jaxtyping import Float

_LEARNS, _WORST, _HONEST = 0.2, 4.0, 0.5
"""How quickly it is learnt how far an encoder strays, in places a frame; the most that one frame says; what it may."""


@dataclass(frozen=True)
class Reading:
    """The encoder when the picture last said where the frame was: what tells another zero, and a liar."""

    position: float
    at: float
    """The place that the picture gave, in reference frames."""
    strays: float = 2 * _HONEST
    """Places that encoder and pictures have differed by of late, from frame to frame: it must prove itself."""

    @property
    def honest(self) -> bool:
        """Whether the encoder has moved as the pictures did."""
        return self.strays < _HONEST


@dataclass(frozen=True, eq=False)
class Encoder:
    """Positions of the reference sweep's places, which never turn back.

    >>> encoder = Encoder(np.array([10.0, 12.0, 14.0]))
    >>> encoder.place(13.0), encoder.place(113.0, Reading(112.0, 1.0))
    (1.5, 1.5)
    """

    positions: Float[np.ndarray, " n"]
    """In the encoder's own unit; rising or falling."""

    @cached_property
    def _way(self) -> float:
        """1 where positions rise, -1 where they fall."""
        return float(np.sign(self.positions[-1] - self.positions[0]))

    @cached_property
    def _rising(self) -> Float[np.ndarray, " n"]:
        return self._way * self.positions

    @cached_property
    def _places(self) -> Float[np.ndarray, " n"]:
        return np.arange(len(self.positions), dtype=float)

    def place(self, position: float, last: Reading | None = None) -> float:
        """The place, in reference frames; the zero is that of the reference sweep, or what the last reading shows."""
        if last is not None:
            position += float(np.interp(last.at, self._places, self.positions)) - last.position
        return float(np.interp(self._way * position, self._rising, self._places))

    def read(self, position: float, at: float, last: Reading | None) -> Reading:
        """What is kept of a frame that the picture has placed."""
        if last is None:
            return Reading(position, at)
        off = min(abs(self.place(position, last) - at), _WORST)
        return Reading(position, at, last.strays + _LEARNS * (off - last.strays))


def positions(encoders: Sequence[float | None]) -> Float[np.ndarray, " n"]:
    """Those of a sweep's places, where all have one and none turns back; else nothing.

    >>> positions([0.0, -1.0, -1.0, -3.0]), positions([0.0, 2.0, 1.0]), positions([1.0, None])
    (array([ 0., -1., -1., -3.]), array([], dtype=float64), array([], dtype=float64))
    """
    known = [encoder for encoder in encoders if encoder is not None and isfinite(encoder)]
    found = np.array(known)
    return found if len(known) == len(encoders) and leads_on(found) else np.zeros(0)


def leads_on(positions: Float[np.ndarray, " n"]) -> bool:
    """Whether positions lead from one end to another and never turn back."""
    steps = np.diff(positions)
    return bool((steps >= 0).all() or (steps <= 0).all()) and bool(steps.any())
