"""How strong evidence must be: thresholds from good sweeps, with what is assumed where they are too few to tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Limits:
    """What evidence (mean excess over a box of six pixels, in grey levels) is at the threshold.

    One golden sweep shows neither how much edges stray from part to part nor how the lamp wanders: it is assumed that
    good parts stay below `floor` on flat ground and below `share` of the local contrast beside edges. More golden
    sweeps raise that by `factor` where they themselves went beyond it.

    >>> Limits().threshold(np.array([[0.0, 100.0]]))
    array([[ 6.5, 22.5]])
    """

    floor: float = 6.5
    """Grey levels."""
    share: float = 0.16
    """Of the local contrast."""
    factor: float = 1.0
    """From golden sweeps beyond the first: what they reached, with a margin, never below 1."""
    good_peak: float | None = None
    """Highest score of a golden sweep against what was learnt before it; None with a single one."""

    def threshold(self, contrast: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
        """Evidence that scores 1.0, per cell, in grey levels."""
        return self.factor * (self.floor + self.share * contrast)
