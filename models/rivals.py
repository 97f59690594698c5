"""How well wrong places agree: what agreement with a reference picture is worth, learnt from the reference sweep."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from jaxtyping import Float32

from models.localise import Guide, compare

_EVERY = 8
"""Places from one that is asked to the next."""
_RIVALS = 3
"""Wrong places that are tried for each: those that the eigenspace finds most alike."""
_AT_LEAST, _FEW, _STRICT = 0.5, 8, 0.8
"""Whatever was tried, rivals reach this; where so few could be tried, they may reach that."""
_REACH = 24
"""Places either way for which the strongest rival speaks."""


def rivals(guide: Guide, smoothed: Callable[[int], np.ndarray]) -> Float32[np.ndarray, " n"]:
    """The agreement that pictures of other places reach at each place, between 0 and 1.

    `smoothed` gives the reference picture of a place as registration looks at it. A frame laid on a place that it
    belongs to by its motion is no rival: what is far along the way may be near in the picture.
    """
    n = len(guide.track.z)
    reached = np.zeros(n, np.float32)
    tried = 0
    for place in range(0, n, _EVERY):
        for other in _alike(guide, place):
            attempt = compare(guide, smoothed(place), float(other))
            away = attempt.registered.pose[:2] - guide.path.between(attempt.reference, place)
            step = float(np.hypot(*guide.path.speed(place)))
            if abs(attempt.fixture.seen(guide.path) - place) <= 1 or np.hypot(*away) <= step:
                continue
            tried += 1
            # that `place` looks like `attempt.reference` speaks against either
            for end in (place, attempt.reference):
                reached[end] = max(reached[end], min(attempt.agreement, 1.0))
    strongest = cv2.dilate(reached[None], np.ones((1, 2 * _REACH + 1), np.uint8))[0]
    return np.maximum(strongest, np.float32(_STRICT if tried < _FEW else _AT_LEAST))


def _alike(guide: Guide, place: int) -> Iterator[int]:
    """The places that look most like one that is not near them."""
    track = guide.track
    cost, _ = track.looks(track.z[place], slice(0, len(track.z)))
    cost = cost.copy()
    for _ in range(1 + _RIVALS):
        cost[max(0, place - _EVERY) : place + _EVERY + 1] = np.inf
        place = int(cost.argmin())
        if not np.isfinite(cost[place]):
            return
        yield place
