"""Whether a sweep begins as the learnt one does: the right part, the right way round, within reach."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import cv2
import numpy as np
from jaxtyping import Float

from models.appearance import Appearance
from models.frame import Frame
from models.localise import belongs
from models.registration import smooth
from models.scoring import Look
from models.tolerance import levels

_FIRST, _FEWEST = 0.06, 5
"""Share of the sweep's places, and number, of the frames by which it is decided: well within the first tenth."""
_DEFECT = 0.02
"""Share of the picture out of tolerance, up to which a frame that agrees too little may be the part with a defect."""
_KEPT = 6
"""Frames that are kept for asking what lies there instead."""
_MOVED = 1.2
"""Grey levels (standard deviation) from which on a picture shows something new: noise alone stays below."""


@dataclass(frozen=True, eq=False)
class Beginning:
    """What the first frames say of the whole. A value: `with_frame` returns the next one.

    Two thirds of so many frames in a row must agree with the learnt part, by what is asked for at each place; then all
    is well for good. A sweep that has shown so many and has not come to that `failed`: until it comes to it later,
    its frames that do not agree are not compared. Pictures that show nothing new do not count while no part was seen:
    a line may wait for it. Nor do frames where little is out of tolerance: where there is hardly anything to see, one
    defect is most of it.
    """

    needed: int
    """Frames that decide."""
    agreed: tuple[bool, ...] = ()
    """Whether each of the last ones that counted did."""
    kept: tuple[Frame, ...] = ()
    """Some of them, evenly; none any more where all was well."""
    counted: int = 0
    confirmed: bool = False
    last: Float[np.ndarray, "h w"] | None = None
    """The last picture that counted without being the part's, smoothed."""

    @classmethod
    def of(cls, appearance: Appearance) -> Beginning:
        """Before the first frame."""
        return cls(_needed(appearance))

    @property
    def failed(self) -> bool:
        """Whether what was shown so far is not the part as it was learnt."""
        return not self.confirmed and len(self.agreed) == self.needed

    @property
    def doubted(self) -> bool:
        """Whether it has failed, even if the sweep came to the part later: on stretches that parts share, others do."""
        return self.failed or (self.confirmed and bool(self.kept))

    def with_frame(self, appearance: Appearance, frame: Frame, shown: Look | None) -> Beginning:
        """One frame more; `shown` is what it showed, None where that was nothing."""
        if self.confirmed or shown is None:
            return self
        fits, last = agrees(appearance, shown), self.last
        if fits is None:
            return self
        if not shown.located.verified:
            last = smooth(levels(frame.pixels))
            if self.last is not None and cv2.norm(last, self.last) <= _MOVED * np.sqrt(last.size):
                return self
        agreed = (*self.agreed, fits)[-self.needed :]
        if sum(agreed) >= ceil(self.needed * 2 / 3):
            return Beginning(self.needed, kept=self.kept if self.failed else (), confirmed=True)
        keep = not self.failed and self.counted % _every(self.needed) == 0
        kept = (*self.kept, frame) if keep else self.kept
        return replace(self, agreed=agreed, kept=kept, counted=self.counted + 1, last=last)


def kept_every(appearance: Appearance) -> int:
    """Frames that count from one that is kept to the next."""
    return _every(_needed(appearance))


def _needed(appearance: Appearance) -> int:
    return max(_FEWEST, round(_FIRST * appearance.places))


def _every(needed: int) -> int:
    return ceil(needed / _KEPT)


def agrees(appearance: Appearance, shown: Look) -> bool | None:
    """Whether a frame agrees with its place as the learnt part does, which is more than is asked for to follow a sweep.

    None where it does not, and so little is out of tolerance that this may be a defect.
    """
    located, guide = shown.located, appearance.guide
    if guide.turn is not None or shown.agreed is None:
        return located.verified
    if belongs(guide, located.reference, located.registered, located.agreement):
        return True
    return None if float((shown.agreed.max(axis=2) >= 1.0).mean()) <= _DEFECT else False
