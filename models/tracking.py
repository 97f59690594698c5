"""Tracking: where a part is, frame after frame, how fast it moves, and where a hand that follows it should go.

The paper's tracking (Nayar, Nene, Murase 1996) corrects the hand by the displacement that the manifold gives for each
frame. What is added: the motion is estimated, so that the hand goes where the part will be when it arrives there, and
a part that is not seen for a while is expected where its motion leads.

A hand that reports where it was at each exposure is followed by `place` = its position + q, the part's own place; where
nobody reports, the camera is taken to stand still, and `place` is q. Approximation: parameters add up and move each for
itself; a hand that turns must report displacements along the axes that q has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, sqrt
from typing import Literal, Protocol

import numpy as np
from jaxtyping import Float64, UInt8

from models.motion import Agility, Motion
from models.workspace import Located, Parameter

State = Literal["searching", "tracking", "lost", "recovered"]
"""`searching`: not seen yet; `lost`: not seen now; `recovered`: seen again, in the first frame."""
PATIENCE = 0.4
"""Seconds for which a part that is not seen is believed to go on as it moved."""
_GATE, _LEAST = 4.0, 0.1
"""The part is looked for within so many standard deviations of where it is expected, and so many reaches."""
_SURE = 0.002
"""Reaches: no measurement is believed to be better."""


class Locates(Protocol):
    """What tracking needs of a workspace."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What q is."""
        ...

    def reach(self, object: str) -> tuple[float, ...]:
        """Half of what was learnt of each parameter, half of a period."""
        ...

    def locate(self, pixels: UInt8[np.ndarray, "h w *c"]) -> Located:
        """Among all objects and places."""
        ...

    def locate_near(
        self, pixels: UInt8[np.ndarray, "h w *c"], object: str, q: tuple[float, ...], reach: tuple[float, ...]
    ) -> Located:
        """About one place of one object."""
        ...


@dataclass(frozen=True)
class Tracked:
    """What one frame says."""

    t_ns: int
    state: State
    located: Located
    """The picture by itself."""
    object: str | None
    """What is tracked; None before it was seen."""
    place: tuple[float, ...] | None
    """Where the part is believed to be: smoothed while it is seen, expected for a while where it is not."""
    velocity: tuple[float, ...] | None
    """Of the place, per second; None with it."""
    unseen: int
    """Frames since it was seen; 0 where it is."""


@dataclass(frozen=True, eq=False)
class Tracking:
    """One part that is followed. A value: `step` returns the next one."""

    workspace: Locates
    agility: Agility = Agility()  # noqa: RUF009 (a frozen value)
    """Lengths are reaches: half of what was learnt of a parameter."""
    object: str | None = None
    reach: Float64[np.ndarray, " m"] | None = None
    motion: Motion | None = None
    """In reaches; as it was when the part was last seen."""
    unseen: int = 0
    beyond: int = 0
    """Frames since its motion is no longer believed to go on."""


def begin(workspace: Locates, agility: Agility = Agility()) -> Tracking:  # noqa: B008 (a frozen value)
    """Before the first frame."""
    return Tracking(workspace, agility)


def step(
    tracking: Tracking, pixels: UInt8[np.ndarray, "h w *c"], t_ns: int, hand: Sequence[float] | None = None
) -> tuple[Tracking, Tracked]:
    """One frame, taken at t_ns, with the hand there (m,). Raises PictureError for a picture of another kind.

    The part is looked for where it is expected; where it is not there, among all places and objects.
    """
    at = np.zeros(len(tracking.workspace.parameters)) if hand is None else np.asarray(hand, np.float64)
    expected = _expected(tracking, t_ns)
    located = _located_near(tracking, expected, pixels, at)
    if located is None:
        located = tracking.workspace.locate(pixels)
        if located.state != "known":
            return _missed(tracking, located, t_ns)
    return _seen(tracking, expected, located, t_ns, at)


def aim(tracking: Tracking, t_ns: int) -> tuple[float, ...] | None:
    """Where the part will be at t_ns: where the hand should be then. None before it was seen.

    A part whose motion is no longer believed to go on is looked for about where it was expected last, on a square
    spiral through the first two parameters, a reach further with every frame.
    """
    if tracking.motion is None or tracking.reach is None:
        return None
    place = tracking.motion.at(min(t_ns, _believed_until(tracking.motion))).place.copy()
    turns = _spiral(tracking.beyond)
    for i in range(min(2, place.size)):
        place[i] += turns[i]
    return tuple((place * tracking.reach).tolist())


def _believed_until(motion: Motion) -> int:
    return motion.t_ns + round(PATIENCE * 1e9)


def _expected(tracking: Tracking, t_ns: int) -> Motion | None:
    """The motion as it should have gone on; None where that is not believed."""
    motion = tracking.motion
    return None if motion is None or t_ns > _believed_until(motion) else motion.at(t_ns)


def _located_near(
    tracking: Tracking, expected: Motion | None, pixels: np.ndarray, hand: Float64[np.ndarray, " m"]
) -> Located | None:
    """The picture about the expected place; None where the part is not there."""
    if expected is None or tracking.object is None or tracking.reach is None:
        return None
    q = expected.place * tracking.reach - hand
    room = (_GATE * expected.error + _LEAST) * tracking.reach
    located = tracking.workspace.locate_near(pixels, tracking.object, tuple(q.tolist()), tuple(room.tolist()))
    return None if located.q is None else located


def _seen(
    tracking: Tracking, expected: Motion | None, located: Located, t_ns: int, hand: Float64[np.ndarray, " m"]
) -> tuple[Tracking, Tracked]:
    """The part is where `located` says."""
    assert located.object is not None
    assert located.q is not None
    assert located.uncertainty is not None
    reach = np.array(tracking.workspace.reach(located.object))
    place = (hand + np.array(located.q)) / reach
    error = np.maximum(np.array(located.uncertainty) / reach, _SURE)
    again = tracking.object is not None and tracking.unseen > 0
    if expected is not None and located.object == tracking.object:
        place = expected.place + _shorter(place - expected.place, tracking.workspace.parameters, reach)
        near = np.abs(place - expected.place) <= _GATE * np.hypot(expected.error, error) + _LEAST
        motion = expected.corrected(place, error) if near.all() else None
    else:
        motion = None
    motion = motion or Motion.seen(t_ns, place, error, tracking.agility)
    now = replace(tracking, object=located.object, reach=reach, motion=motion, unseen=0, beyond=0)
    return now, _told(now, "recovered" if again else "tracking", located, t_ns, motion)


def _missed(tracking: Tracking, located: Located, t_ns: int) -> tuple[Tracking, Tracked]:
    """The part is not in the picture."""
    if tracking.motion is None:
        return tracking, _told(tracking, "searching", located, t_ns, None)
    expected = _expected(tracking, t_ns)
    now = replace(tracking, unseen=tracking.unseen + 1, beyond=tracking.beyond + (expected is None))
    return now, _told(now, "lost", located, t_ns, expected)


def _told(tracking: Tracking, state: State, located: Located, t_ns: int, motion: Motion | None) -> Tracked:
    if motion is None or tracking.reach is None:
        return Tracked(t_ns, state, located, tracking.object, None, None, tracking.unseen)
    place, velocity = motion.place * tracking.reach, motion.velocity * tracking.reach
    place = [
        value if each.period is None else value % each.period
        for value, each in zip(place.tolist(), tracking.workspace.parameters, strict=True)
    ]
    return Tracked(t_ns, state, located, tracking.object, tuple(place), tuple(velocity.tolist()), tracking.unseen)


def _shorter(
    apart: Float64[np.ndarray, " m"], parameters: Sequence[Parameter], reach: Float64[np.ndarray, " m"]
) -> Float64[np.ndarray, " m"]:
    """The shorter way round where there is a period; in reaches."""
    apart = apart.copy()
    for i, each in enumerate(parameters):
        if each.period is not None:
            period = each.period / reach[i]
            apart[i] = (apart[i] + period / 2) % period - period / 2
    return apart


def _spiral(n: int) -> tuple[float, float]:
    """The n-th place of a square spiral with steps of 1 about 0.

    >>> [_spiral(n) for n in range(6)]
    [(0, 0), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)]
    """
    if n == 0:
        return 0, 0
    ring = ceil((sqrt(n + 1) - 1) / 2)
    side, along = divmod(n - (2 * ring - 1) ** 2, 2 * ring)
    x, y = ring, along + 1 - ring
    for _ in range(side):
        x, y = -y, x
    return x, y
