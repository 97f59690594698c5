"""Load: how much of a scorer's time an inspection needs, and how often dashboards may ask for its picture."""

from __future__ import annotations

_SEARCHING = 10
_PICTURES = 40.0
"""A second, for all dashboards together: each costs the event loop a third of a millisecond or so."""
_OFTEN, _SELDOM = 4.0, 0.2


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


def pictures_per_second(listeners: int, running: int) -> float:
    """How often each of so many listeners may ask for the latest picture of each running inspection.

    >>> pictures_per_second(1, 1), pictures_per_second(20, 1), pictures_per_second(20, 4), pictures_per_second(64, 16)
    (4.0, 2.0, 0.5, 0.2)
    """
    asking = max(1, listeners) * max(1, running)
    return round(min(_OFTEN, max(_SELDOM, _PICTURES / asking)), 3)


def _mean(so_far: float, value: float) -> float:
    return value if so_far == 0 else so_far + (value - so_far) / 16
