"""A recording at the pace at which it was recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from models.frame import Frame


def paced(frames: Iterable[Frame], clock: Callable[[], float], wait: Callable[[float], object]) -> Iterator[Frame]:
    """Each frame as long after the first as its time says, or at once where that has passed.

    `clock` tells seconds, `wait` waits so many. Time that was lost is made up for: no frame is left out.
    """
    start: tuple[float, int] | None = None
    for frame in frames:
        start = start or (clock(), frame.t_ns)
        if (early := start[0] + (frame.t_ns - start[1]) / 1e9 - clock()) > 0:
            wait(early)
        yield frame
