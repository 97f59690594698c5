"""How strong evidence must be: thresholds from good sweeps, with what is assumed where they are too few to tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from models.errors import PolicyError
from models.verdict import ALLOWED

USUAL = 0.655
"""Assumed: the peak of a usual good sweep; of the loud products, to be on the safe side."""
PRODUCTS = 0.08
"""Assumed: how much that differs from product to product. Scale of a Student distribution of its logarithm."""
FREEDOM = 4.0
"""Degrees of freedom of that: a product far from the usual is believed after a few sweeps."""
SPREAD = 0.15
"""Assumed: standard deviation of the logarithm of the peaks of one product's good sweeps, middle of all products."""
SPREADS = 0.3
"""How much that differs from product to product: standard deviation of its logarithm."""
QUIET = 0.4
"""A peak below is noise, and says no more than that it lies below."""
SPOILT = 0.05
"""Assumed: share of golden sweeps that tell nothing of other parts, loud ones and quiet ones alike."""
_LOUD = 20.0
"""Up to where peaks of spoilt sweeps lie, evenly in the logarithm."""
SAME = 0.5
"""Assumed: how likely golden sweeps that are all quiet are of one and the same part, and tell nothing of others."""
STEP, LEAST = 0.05, 0.7
"""The limit falls by no more than this share of the assumed one for each golden sweep, and to no less than this."""
_SURE = 0.9
"""Probability of the intervals."""
_Z = np.linspace(-9.0, 9.0, 4001)
_BEYOND = np.array([math.erfc(z / math.sqrt(2)) / 2 for z in _Z])
"""Probability that a standard normal number exceeds each of `_Z`."""


@dataclass(frozen=True)
class Limits:
    """What is assumed of the evidence (mean excess over a box, in grey levels) of good parts at one scale.

    One golden sweep shows neither how much edges stray from part to part nor how the lamp wanders: it is assumed that
    good parts stay below `floor` on flat ground and below `share` of the local contrast beside edges. What golden
    sweeps show beyond that is tolerated where they show it, and moves the limit by the factor of a `Promise`.

    >>> Limits(6.5, 0.16).threshold(np.array([[0.0, 100.0]]))
    array([[ 6.5, 22.5]])
    """

    floor: float
    """Grey levels."""
    share: float
    """Of the local contrast."""
    weight: float = 1.0
    """Times that, where golden sweeps come nearer to the limits of this scale than to those of the other."""

    def threshold(self, contrast: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
        """Evidence that scores 1.0 where golden sweeps showed none, per cell, in grey levels."""
        return self.weight * (self.floor + self.share * contrast)


FINE, COARSE = Limits(6.5, 0.16), Limits(6.5, 0.05)


@dataclass(frozen=True)
class Promise:
    """What golden sweeps can promise of the good parts to come. Rates are per sweep, in [0, 1].

    Refused is a part whose highest score reaches 1.0; a REVIEW is none yet.
    """

    target: float
    """Share of good sweeps that may be refused."""
    factor: float
    """Times the assumed tolerance: where the limit lies."""
    sweeps: int
    """Golden sweeps that it rests on, the reference among them."""
    expected: float
    """False rejects to be expected, by what was assumed and what the golden sweeps reached."""
    low: float
    """From `low` to `high` the true share lies for 90 of 100 products."""
    high: float
    unassumed: float
    """What the golden sweeps bear out without any assumption: (1 + those beyond the limit) / (1 + all)."""
    needed: int
    """Golden sweeps that would bear out `target` without any assumption, were none of them beyond the limit."""

    def sentence(self) -> str:
        """In plain words.

        >>> print(promise((), 0.02).sentence())
        one golden sweep: limit at 1.00 of the assumed tolerance; 2 % false rejects expected, 0 % to 8.7 % (90 %), \
resting on the stated assumptions; 49 golden sweeps would promise 2 % without them
        """
        sweeps = f"{self.sweeps} golden sweeps" if self.sweeps > 1 else "one golden sweep"
        said = (
            f"{sweeps}: limit at {self.factor:.2f} of the assumed tolerance; {_percent(self.expected)} false rejects "
            f"expected, {_percent(self.low)} to {_percent(self.high)} (90 %)"
        )
        if self.unassumed <= self.target:
            return f"{said}; at most {_percent(self.unassumed)} without any assumption"
        return (
            f"{said}, resting on the stated assumptions; {self.needed} golden sweeps would promise "
            f"{_percent(self.target)} without them"
        )


def promise(peaks: Sequence[float], target: float) -> Promise:
    """Where the limit must lie so that `target` of the good sweeps are refused, and how sure that is.

    `peaks` are the highest scores of the golden sweeps that were learnt from, each against what the *other* ones show,
    at factor 1: one for each sweep after the reference, none where there is but that one. Scores go with 1 / factor.
    Raises PolicyError for a target out of range.

    The logarithm of a product's peaks is taken as normal. Its middle and spread are known from the assumptions above
    before the first sweep, and from the peaks after (Bayes, summed over a grid: no chance in it); the limit is the
    quantile of what the next sweep is then expected to reach. A peak below `QUIET` says only that it lies below. Any
    sweep may be `SPOILT`, so one glitch hardly counts where sweeps that agree do.

    >>> loud = promise((1.7, 2.1, 2.4, 1.9, 2.0), 0.01)
    >>> round(loud.factor, 1), loud.needed
    (2.9, 99)
    >>> promise((), 0.05).factor < promise((), 0.01).factor
    True
    """
    low, high = ALLOWED["false_rejects"]
    if not low <= target <= high:
        raise PolicyError(f"false_rejects is {target}, allowed are {low} to {high}")
    return _promised(tuple(float(peak) for peak in peaks), float(target))


@lru_cache(maxsize=64)
def _promised(peaks: tuple[float, ...], target: float) -> Promise:
    mu, sigma, weight = _believed(peaks)

    def rates(factor: float) -> Float[np.ndarray, " cells"]:
        return np.interp((math.log(factor) - mu) / sigma, _Z, _BEYOND)

    factor = _falling_to(target, lambda factor: float(weight @ rates(factor)))
    if peaks:
        factor = max(factor, max(1 - STEP * len(peaks), LEAST) * _promised((), target).factor)
    rate = rates(factor)
    low, high = _quantiles(rate, weight)
    beyond = sum(peak >= factor for peak in peaks)
    needed = math.ceil(1 / target - 1 - 1e-9)
    expected = float(weight @ rate)
    return Promise(target, factor, len(peaks) + 1, expected, low, high, (1 + beyond) / (1 + len(peaks)), needed)


def _believed(peaks: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles and spreads of the logarithm of a product's peaks, and how far each pair is believed: three (cells,)."""
    middles, spreads = np.arange(-2.5, 3.7, 0.01), np.geomspace(SPREAD / 3, SPREAD * 3, 15)
    mu, sigma = (grid.ravel() for grid in np.meshgrid(middles, spreads))
    prior = -(FREEDOM + 1) / 2 * np.log1p(((mu - math.log(USUAL)) / PRODUCTS) ** 2 / FREEDOM)
    prior -= (np.log(sigma / SPREAD) / SPREADS) ** 2 / 2
    agreed = np.zeros_like(mu)
    for peak in peaks:
        if peak < QUIET:
            likely = 1 - np.interp((math.log(QUIET) - mu) / sigma, _Z, _BEYOND)
            spoilt = 0.5
        else:
            likely = np.exp(-(((math.log(peak) - mu) / sigma) ** 2) / 2) / (math.sqrt(2 * math.pi) * sigma)
            spoilt = 0.5 / math.log(_LOUD / QUIET)
        agreed += np.log((1 - SPOILT) * likely + SPOILT * spoilt)
    if all(peak < QUIET for peak in peaks):
        agreed = np.log((1 - SAME) * np.exp(agreed) + SAME)
    belief = prior + agreed
    weight = np.exp(belief - belief.max())
    matter = weight > 1e-7 * weight.max()
    return mu[matter], sigma[matter], weight[matter] / weight[matter].sum()


def _falling_to(value: float, falling: Callable[[float], float]) -> float:
    """Where a function of a positive number that falls comes down to a value."""
    low, high = -6.0, 9.0
    for _ in range(36):
        middle = (low + high) / 2
        low, high = (middle, high) if falling(math.exp(middle)) > value else (low, middle)
    return math.exp(high)


def _quantiles(rate: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Between what the rate lies with `_SURE`."""
    order = np.argsort(rate)
    share = np.cumsum(weight[order]) - weight[order] / 2
    low, high = np.interp([(1 - _SURE) / 2, (1 + _SURE) / 2], share, rate[order])
    return float(low), float(high)


def _percent(rate: float) -> str:
    """Two digits are more than is known.

    >>> _percent(0.0123), _percent(0.2), _percent(0.00001)
    ('1.2 %', '20 %', '0 %')
    """
    return f"{float(f'{100 * rate:.2g}'):g} %" if rate >= 0.0005 else "0 %"
