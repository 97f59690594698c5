"""How something moves whose place is measured now and then: its place, its velocity, and where it will be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float64

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Of the integral over an interval, exact to many digits for intervals up to a few times the memory."""


@dataclass(frozen=True)
class Agility:
    """How what moves is expected to move. Lengths are those that the measurements have."""

    acceleration: float = 10.0
    """Usual acceleration, lengths per second squared."""
    memory: float = 1.0
    """Seconds for which an acceleration lasts."""
    velocity: float = 10.0
    """Usual velocity before anything is known, lengths per second."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What is believed of m coordinates that move each for itself: a Kalman filter with Singer's model.

    An acceleration fades within the memory, and new ones come by chance (Singer, IEEE Trans. AES-6(4), 1970): what
    moves straight on, on a circle or on any smooth path is followed without a lag that grows; when measurements stay
    away, it is believed to go on, first on its curve, then straight.

    >>> moving = Motion.seen(0, np.array([0.0]), np.array([1e-3]), Agility())
    >>> for t in (1, 2, 3):
    ...     moving = moving.at(t * 10**8).corrected(np.array([0.5 * t]), np.array([1e-3]))
    >>> moving.velocity.round(1), moving.at(5 * 10**8).place.round(1)
    (array([5.]), array([2.5]))
    """

    t_ns: int
    state: Float64[np.ndarray, "3 m"]
    """Place, velocity and acceleration, in lengths and seconds."""
    spread: Float64[np.ndarray, "m 3 3"]
    """Their covariance."""
    agility: Agility

    @classmethod
    def seen(
        cls, t_ns: int, place: Float64[np.ndarray, " m"], error: Float64[np.ndarray, " m"], agility: Agility
    ) -> Motion:
        """After one measurement with its standard deviation; nothing is known of the velocity."""
        state, spread = np.zeros((3, place.size)), np.zeros((place.size, 3, 3))
        state[0], spread[:, 0, 0] = place, np.square(error)
        spread[:, 1, 1], spread[:, 2, 2] = agility.velocity**2, agility.acceleration**2
        return cls(t_ns, state, spread, agility)

    @property
    def place(self) -> Float64[np.ndarray, " m"]:
        """Where it is."""
        return self.state[0]

    @property
    def velocity(self) -> Float64[np.ndarray, " m"]:
        """Lengths per second."""
        return self.state[1]

    @property
    def error(self) -> Float64[np.ndarray, " m"]:
        """Standard deviation of the place."""
        return np.sqrt(self.spread[:, 0, 0])

    def at(self, t_ns: int) -> Motion:
        """The same at a later time, nothing measured in between; an earlier one changes nothing."""
        if t_ns <= self.t_ns:
            return self
        over, chance = _passage(round((t_ns - self.t_ns) / 1e5), self.agility)
        return Motion(t_ns, over @ self.state, over @ self.spread @ over.T + chance, self.agility)

    def corrected(self, place: Float64[np.ndarray, " m"], error: Float64[np.ndarray, " m"]) -> Motion:
        """With a measurement made at this time, and its standard deviation."""
        gain = self.spread[:, :, 0] / (self.spread[:, 0, 0] + np.square(error))[:, None]
        state = self.state + gain.T * (place - self.place)
        # Joseph's form: stays symmetric and positive whatever is rounded
        kept = np.broadcast_to(np.eye(3), self.spread.shape).copy()
        kept[:, :, 0] -= gain
        noise = np.square(error)[:, None, None] * gain[:, :, None] * gain[:, None, :]
        return replace(self, state=state, spread=kept @ self.spread @ kept.transpose(0, 2, 1) + noise)


@lru_cache(maxsize=256)
def _passage(tenths_ms: int, agility: Agility) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, "3 3"]]:
    """What so much time makes of place, velocity and acceleration, and the covariance that chance adds to them."""
    t = tenths_ms / 1e4
    over = np.eye(3)
    over[0, 1] = t
    over[:, 2] = _response(np.array([t]), agility.memory)[:, 0]
    ages = t * (NODES + 1) / 2
    responses = _response(ages, agility.memory)
    chance = (responses * WEIGHTS * t / 2) @ responses.T * (2 * agility.acceleration**2 / agility.memory)
    return over, chance


def _response(ages: Float64[np.ndarray, " n"], memory: float) -> Float64[np.ndarray, "3 n"]:
    """What an acceleration of 1, so many seconds ago, does to place, velocity and acceleration now."""
    x = ages / memory
    left = np.exp(-x)
    return np.stack([memory**2 * (np.expm1(-x) + x), -memory * np.expm1(-x), left])
