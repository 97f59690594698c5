"""Load: how much of a scorer's time an inspection needs, and how those who only look leave room for frames."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Sequence

from inspector.scorers.pool import Scorer

_SEARCHING = 10
_PICTURES = 80.0
"""A second, for all who watch together."""
_USUAL_BYTES = 1 << 16
"""A larger picture counts as several."""
_APART = 0.005
"""Seconds between two requests that only read, while parts are inspected: twenty at once would hold up frames."""


class Load:
    """How much of a scorer's time an inspection needs to keep up with its camera, by the frames' own clock.

    A recording that is pushed as fast as it goes needs no more than the camera that made it.
    """

    def __init__(self) -> None:
        self._work = self._interval = 0.0
        self._frames = 0
        self._last: int | None = None

    @property
    def share(self) -> float:
        """Seconds of work per second, 0 until it is known."""
        return self._work / self._interval if self._interval > 0 else 0.0

    def came(self, t_ns: int) -> None:
        """A frame of that time was sent."""
        if self._last is not None and t_ns > self._last:
            self._interval = _mean(self._interval, (t_ns - self._last) / 1e9)
        self._last = t_ns

    def took(self, seconds: float) -> None:
        """A frame was decoded, scored and recorded; the first ones, which look for their place, say little."""
        self._frames += 1
        if self._frames > _SEARCHING:
            self._work = _mean(self._work, seconds)


def no_time(
    count: int,
    inspections: Iterable[tuple[Scorer, float]],
    beside: Iterable[tuple[Scorer, float]],
    scorers: Sequence[Scorer],
) -> str | None:
    """Why one more inspection could not be scored in time, where `count` run or begin; None where it could.

    Shares of the time of scorers: what inspections need, one more of which needs as much as they do on average, and
    what else needs some.
    """
    needed = dict.fromkeys(scorers, 0.0)
    for scorer, share in inspections:
        needed[scorer] += share
    one_more = sum(needed.values()) / max(count, 1)
    for scorer, share in beside:
        needed[scorer] += share
    if count and min(needed.values()) + one_more > 1.0:
        return f"the {count} that are running need {sum(needed.values()) / len(needed):.0%} of the scorers' time"
    return None


class Turns:
    """Requests that only read take turns, so that frames find room between any two of them."""

    def __init__(self) -> None:
        self._next = 0.0

    async def wait(self) -> None:
        """Come back when it is this one's turn: at once, or so long after the one before."""
        now = asyncio.get_running_loop().time()
        mine = max(now, self._next)
        self._next = mine + _APART
        if mine > now:
            await asyncio.sleep(mine - now)


class Ration:
    """How many pictures may be told: so many a second for all who watch together, whatever they watch."""

    def __init__(self) -> None:
        self._left = 0.0

    def refill(self, seconds: float) -> None:
        """So much time has gone by."""
        self._left = min(self._left + _PICTURES * seconds, _PICTURES * seconds)

    def take(self, watching: int, size: int) -> bool:
        """Whether a picture of so many bytes may be told to so many now; it may leave a debt for later ones."""
        if watching == 0 or self._left <= 0:
            return False
        self._left -= watching * max(1.0, size / _USUAL_BYTES)
        return True


def _mean(so_far: float, value: float) -> float:
    return value if so_far == 0 else so_far + (value - so_far) / 16
