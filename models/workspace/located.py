"""Located: what one picture says of which object is seen, and where it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["known", "ambiguous", "unknown"]


@dataclass(frozen=True)
class Rival:
    """Another place, or another object, at which the picture fits best round about."""

    object: str
    q: tuple[float, ...]
    distance: float
    """From the manifold there."""


@dataclass(frozen=True)
class Located:
    """Which object a picture shows, and where."""

    object: str | None
    """None where the picture is of none of the objects."""
    q: tuple[float, ...] | None
    """In the parameters' units; a period counts from 0 to it. None with `object`."""
    uncertainty: tuple[float, ...] | None
    """Of each of q, one standard deviation; where the picture is ambiguous, as far as the rivals lie off."""
    distance: float
    """From the closest manifold point, pictures being of length 1: 0 is a picture that was learnt, 1 nothing alike."""
    state: State
    """`ambiguous`: another place, or object, fits nearly as well; or any between two samples. `unknown`: none fits."""
    others: tuple[Rival, ...] = ()
    """What else was looked at, the closest first."""
