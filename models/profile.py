"""A part in fifty numbers: the highest score in each fiftieth of its sweep, so that many parts can be compared."""

from __future__ import annotations

from collections.abc import Iterable

from models.verdict import FrameState, ScoredFrame

BINS = 50


def profile(frames: Iterable[ScoredFrame], bins: int = BINS) -> tuple[float | None, ...]:
    """The highest score of the frames with k / bins <= s < (k + 1) / bins, k from 0; s = 1 belongs to the last.

    1.0 is at the threshold; None where no frame was scored.

    >>> from models.verdict import Residuals
    >>> none = Residuals(0, 0, 0)
    >>> scores = {0.0: 0.2, 0.24: 0.5, 0.25: 0.1, 1.0: 1.3}
    >>> profile([ScoredFrame(0, 0, FrameState.SCORED, s, score, 0, none) for s, score in scores.items()], bins=4)
    (0.5, 0.1, None, 1.3)
    """
    found: list[float | None] = [None] * bins
    for frame in frames:
        if frame.state is FrameState.SCORED and frame.s is not None:
            at = min(max(int(frame.s * bins), 0), bins - 1)
            found[at] = max(found[at] or 0.0, frame.score)
    return tuple(found)
