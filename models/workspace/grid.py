"""Pictures with their task parameters, put in order: a grid per object, complete, every place once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int, UInt8

from models.errors import LearningError

_SAME = 1e-6
"""Of an axis' span: values closer than this are one."""
MOST = 4
"""Parameters that a workspace may have."""


@dataclass(frozen=True)
class Parameter:
    """One thing that pictures depend on: a displacement, an angle."""

    name: str
    period: float | None = None
    """After how much the appearance repeats, in the parameter's own unit; None where it does not."""


@dataclass(frozen=True, eq=False)
class LabelledPicture:
    """A picture to learn from, and what is known of it."""

    object: str
    q: tuple[float, ...]
    """One number per parameter, in its unit."""
    pixels: UInt8[np.ndarray, "h w *c"]
    """(h, w) grey or (h, w, 3) blue-green-red."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Where the n pictures of one object lie: the product of its axes.

    >>> turn = Grid.of("cup", np.array([[350.0], [10], [370 + 170]]), (Parameter("angle_deg", 360),))
    >>> turn.axes[0].tolist(), turn.order.tolist()
    ([10.0, 180.0, 350.0], [1, 2, 0])
    """

    axes: tuple[Float64[np.ndarray, " r"], ...]
    """Values of each parameter, increasing; those of a period from 0 to it."""
    order: Int[np.ndarray, "*r"]
    """Which of the pictures, in the order given, lies at each place of the grid."""

    @classmethod
    def of(cls, name: str, q: Float[np.ndarray, "n m"], parameters: Sequence[Parameter]) -> Grid:
        """The grid of one object's pictures. Raises LearningError that names the place where one lacks or is twice."""
        columns = [_places(name, q[:, i], parameter) for i, parameter in enumerate(parameters)]
        axes = tuple(axis for axis, _ in columns)
        counts = tuple(axis.size for axis in axes)
        flat = np.ravel_multi_index([at for _, at in columns], counts)
        found = np.bincount(flat, minlength=int(np.prod(counts)))
        for wrong, said in ((found > 1, "two pictures at {}; allowed is one"), (found < 1, "no picture at {}; {}")):
            if wrong.any():
                at = np.unravel_index(int(wrong.argmax()), counts)
                shape = " x ".join(map(str, counts))
                place = _named(tuple(float(axis[i]) for axis, i in zip(axes, at, strict=True)), parameters)
                needed = f"a grid of {shape} needs all of its {found.size}, there are {np.count_nonzero(found)}"
                raise LearningError(f"object {name}: {said.format(place, needed)}")
        return cls(axes, np.argsort(flat).reshape(counts))


def _places(
    name: str, values: Float[np.ndarray, " n"], parameter: Parameter
) -> tuple[Float64[np.ndarray, " r"], Int[np.ndarray, " n"]]:
    """The axis that the values make, and where on it each lies."""
    if not np.isfinite(values).all():
        raise LearningError(
            f"object {name}: {parameter.name} is {values[~np.isfinite(values)][0]}; allowed is a number"
        )
    if parameter.period is not None:
        values = values % parameter.period
    close = _SAME * (parameter.period or float(np.ptp(values)))
    if parameter.period is not None:
        values = np.where(values > parameter.period - close, 0.0, values)
    order = np.argsort(values, kind="stable")
    new = np.append(True, np.diff(values[order]) > close)
    at = np.empty(len(values), np.int64)
    at[order] = np.cumsum(new) - 1
    axis = values[order][new]
    if axis.size < 2:
        raise LearningError(f"object {name}: {parameter.name} is {axis[0]:g} everywhere; needed are two values or more")
    return axis, at


def _named(q: Sequence[float], parameters: Sequence[Parameter]) -> str:
    return ", ".join(f"{parameter.name} {value:g}" for parameter, value in zip(parameters, q, strict=True))


def check_parameters(parameters: Sequence[Parameter]) -> None:
    """Raises LearningError where they are none, too many, named alike, or have an impossible period."""
    names = [parameter.name for parameter in parameters]
    if not 1 <= len(names) <= MOST or len(set(names)) < len(names):
        raise LearningError(f"the parameters are {', '.join(names) or 'none'}; allowed are 1 to {MOST}, each once")
    for parameter in parameters:
        if parameter.period is not None and not 0 < parameter.period < np.inf:
            raise LearningError(f"the period of {parameter.name} is {parameter.period}; allowed is a number above 0")
