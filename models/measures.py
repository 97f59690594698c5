"""How well scores tell good from bad, and how sure one can be of it: areas under ROC curves, shares, intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.special import betaincinv, stdtrit

CONFIDENCE = 0.95
"""Of every interval given here."""
_TAIL = (1 - CONFIDENCE) / 2

Interval: TypeAlias = tuple[float, float]
"""Its ends, both included."""
Scores: TypeAlias = Float[np.ndarray, " n"] | Sequence[float]


@dataclass(frozen=True)
class Proportion:
    """So many of so many, with the interval in which the true share lies.

    The interval is Clopper and Pearson's (Biometrika 26, 1934), exact where the cases are independent of each other.

    >>> Proportion(0, 20).share, [round(end, 4) for end in Proportion(0, 20).interval]
    (0.0, [0.0, 0.1684])
    """

    count: int
    of: int

    @property
    def share(self) -> float | None:
        """In [0, 1]; None of nothing."""
        return self.count / self.of if self.of else None

    @property
    def interval(self) -> Interval | None:
        """95 %, both ends included; None of nothing."""
        k, n = self.count, self.of
        if n == 0:
            return None
        low = float(betaincinv(k, n - k + 1, _TAIL)) if k else 0.0
        high = float(betaincinv(k + 1, n - k, 1 - _TAIL)) if k < n else 1.0
        return low, high


def auroc(negative: Scores, positive: Scores) -> float | None:
    """Area under the ROC curve: how often a positive scores higher than a negative, a tie counts half.

    None where either is empty.

    >>> auroc([0.1, 0.2, 0.5], [0.5, 0.9])
    0.9166666666666666
    """
    if not len(negative) or not len(positive):
        return None
    return float(np.mean(_beaten(negative, positive)) / len(negative))


def auroc_without_each(groups: Sequence[tuple[Scores, Scores]]) -> list[float | None]:
    """The area under the curve of all groups' (negative, positive) scores but one, for each that is left out.

    >>> auroc_without_each([([0.1], [0.5]), ([0.3], [0.2]), ([0.6], [])])
    [0.0, 0.5, 0.75]
    """
    negative = np.concatenate([np.asarray(n, float) for n, _ in groups] or [np.zeros(0)])
    positive = np.concatenate([np.asarray(p, float) for _, p in groups] or [np.zeros(0)])
    won = float(_beaten(negative, positive).sum())
    left: list[float | None] = []
    for n, p in groups:
        pairs = (len(negative) - len(n)) * (len(positive) - len(p))
        its_own = _beaten(negative, p).sum() + (len(n) * len(positive) - _beaten(positive, n).sum())
        within = _beaten(n, p).sum()
        left.append(float(won - its_own + within) / pairs if pairs else None)
    return left


def _beaten(negative: Scores, positive: Scores) -> Float[np.ndarray, " p"]:
    """How many of the negatives each positive exceeds, ties half."""
    ordered, asked = np.sort(np.asarray(negative, float)), np.asarray(positive, float)
    return (np.searchsorted(ordered, asked, "left") + np.searchsorted(ordered, asked, "right")) / 2


def roc(negative: Scores, positive: Scores) -> Float[np.ndarray, "n 2"]:
    """The corners of the ROC curve from (0, 0) to (1, 1): share of negatives, share of positives at or above a limit.

    Both must hold something.

    >>> roc([0.1, 0.2], [0.2, 0.9]).tolist()
    [[0.0, 0.0], [0.0, 0.5], [0.5, 1.0], [1.0, 1.0]]
    """
    limits = np.unique(np.concatenate([np.asarray(negative, float), np.asarray(positive, float)]))[::-1]
    shares = [
        1 - np.searchsorted(np.sort(np.asarray(scores, float)), limits, "left") / len(scores)
        for scores in (negative, positive)
    ]
    points = np.vstack([np.zeros((1, 2)), np.stack(shares, axis=1)])
    ways = np.diff(points, axis=0)
    turns = np.abs(ways[:-1, 0] * ways[1:, 1] - ways[:-1, 1] * ways[1:, 0]) > 1e-12
    return points[np.concatenate([[True], turns, [True]])]


def jackknife(whole: float, without: Sequence[float]) -> Interval | None:
    """The interval of a figure, from what it is without each of the n parts that it was taken of; None below two.

    Tukey's: frames of one part resemble each other, parts do not; so it is parts that are left out. For a mean it is
    Student's interval. It is approximate, and says nothing where every part is alike.

    >>> [round(end, 3) for end in jackknife(2.0, [2.5, 2.0, 1.5])]
    [-0.484, 4.484]
    """
    n = len(without)
    if n < 2:
        return None
    left = np.asarray(without, float)
    spread = float(np.sqrt((n - 1) / n * ((left - left.mean()) ** 2).sum()) * stdtrit(n - 1, 1 - _TAIL))
    return whole - spread, whole + spread


def paired(gained: int, lost: int, of: int) -> Interval | None:
    """The interval of a difference of two shares over the same `of` cases, of which some were gained and some lost.

    Cases that did not change say nothing of the difference (McNemar 1947); of those that did, Clopper and Pearson's
    interval tells how many would be gains. None of nothing.

    >>> [round(end, 4) for end in paired(1, 0, 20)]
    [-0.0475, 0.05]
    """
    if not of:
        return None
    ends = Proportion(gained, gained + lost).interval or (0.5, 0.5)
    low, high = ((2 * end - 1) * (gained + lost) / of for end in ends)
    return low, high
