"""What lies there instead: the learnt part turned by 180 degrees, or the part of another recipe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32

from models.appearance import Appearance
from models.eigenspace import Eigenspace
from models.frame import kind_of
from models.localise import belongs, compare
from models.preparation import Preparation
from models.registration import smooth
from models.scoring import is_blind
from models.tolerance import levels
from models.turning import belongs as looks_alike
from models.verdict import Recognised

_TRIED = 5
"""Other parts, upright or turned, that pictures are laid on: those that look most like them."""
_BEGINS = (0, 4)
"""Places where a sweep is tried to begin, before all that look alike."""
_CLEARLY = 0.98
"""Agreement from which on no better place is looked for."""
_AS_WELL = 0.02
"""By so much more must pictures agree with another part: parts that begin alike are the learnt one."""
_ALIKE, _APART = 4, 8
"""Places that are tried for each picture, and how far they lie apart."""


@dataclass(frozen=True, eq=False)
class Card:
    """Of an appearance, what it costs little to hold, and to ask whether pictures look like it at all."""

    kind: str
    """Of its pictures."""
    preparation: Preparation
    eigenspace: Eigenspace
    z: Float32[np.ndarray, "n k"]

    @classmethod
    def of(cls, appearance: Appearance) -> Card:
        """The card of an appearance."""
        space, z = appearance.eigenspace, appearance.manifold.samples.astype(np.float32)
        return cls(appearance.references.kind, appearance.preparation, space, z)

    def away(self, picture: np.ndarray) -> float:
        """Distance of a picture from the nearest place, as a share of its energy where that is made one."""
        x = self.preparation.prepare(picture)
        z = self.eigenspace.project(x)
        inside = float(np.square(self.z - z).sum(axis=1).min())
        return inside + self.eigenspace.distance(x, z) ** 2


@dataclass(frozen=True, eq=False)
class Other:
    """The part of another recipe."""

    name: str
    card: Card
    appearance: Callable[[], Appearance]
    """Asked for where pictures look like it."""


class _Fit(NamedTuple):
    """How well pictures agree with an appearance: the higher, the better."""

    agree: int
    """How many do."""
    agreement: float
    """What all reach, together."""

    def better(self, other: _Fit, count: int) -> bool:
        """Whether of so many pictures more agree, or as many and clearly better."""
        if self.agree != other.agree:
            return self.agree > other.agree
        return self.agreement > other.agreement + _AS_WELL * count


def recognise(own: Appearance, pictures: Sequence[np.ndarray], others: Sequence[Other] = ()) -> Recognised | None:
    """What pictures of a sweep that does not begin as `own` does show instead; None where nobody knows.

    Each picture is laid, for itself, on the places of an appearance that look most like it; how well it agrees does not
    hang on any eigenspace, and what is asked for is what tells a place from wrong ones there. Two thirds of the
    pictures must agree. Others are looked at by their cards first, so that fifty cost little more than five.
    """
    seen = [picture for picture in pictures if not is_blind(smooth(levels(picture)))]
    seen = [picture for picture in seen if kind_of(picture) == own.references.kind]
    if not seen:
        return None
    turned = [cv2.rotate(picture, cv2.ROTATE_180) for picture in seen]
    count = len(seen)
    upright, as_turned = _fit(own, seen), _fit(own, turned)
    known, fit = Recognised(None, own.id, True, as_turned.agree, count), max(upright, as_turned)
    likely = _likely(seen, turned, others)
    tried = [_tried(other, turned if is_turned else seen, is_turned) for other, is_turned in likely]
    best = max(tried, key=lambda each: each[0], default=None)
    if best is not None and best[0].better(fit, count):
        fit, known = best
    elif upright >= as_turned:
        return None
    return known if fit.agree >= _enough(count) else None


def _tried(other: Other, pictures: Sequence[np.ndarray], is_turned: bool) -> tuple[_Fit, Recognised]:
    appearance = other.appearance()
    fit = _fit(appearance, pictures)
    return fit, Recognised(other.name, appearance.id, is_turned, fit.agree, len(pictures))


def _enough(count: int) -> int:
    return ceil(count * 2 / 3)


def _likely(
    seen: Sequence[np.ndarray], turned: Sequence[np.ndarray], others: Sequence[Other]
) -> list[tuple[Other, bool]]:
    """The others that the pictures look most like, as they came or turned."""
    kind = kind_of(seen[0])
    ranked: list[tuple[float, str, bool, Other]] = []
    for other in others:
        if other.card.kind == kind:
            for pictures, is_turned in ((seen, False), (turned, True)):
                away = float(np.median([other.card.away(picture) for picture in pictures]))
                ranked.append((away, other.name, is_turned, other))
    ranked.sort(key=lambda each: each[:3])
    return [(other, is_turned) for _, _, is_turned, other in ranked[:_TRIED]]


def _fit(appearance: Appearance, pictures: Sequence[np.ndarray]) -> _Fit:
    """How many of the pictures agree with the appearance; it is given up where they can be enough no more."""
    agree, agreement = 0, 0.0
    for done, picture in enumerate(pictures):
        if agree + len(pictures) - done < _enough(len(pictures)):
            break
        fits, reached = _laid(appearance, picture)
        agree, agreement = agree + fits, agreement + reached
    return _Fit(agree, agreement)


def _laid(appearance: Appearance, picture: np.ndarray) -> tuple[bool, float]:
    """Whether a picture agrees with the best place for it, wherever that is, and how well."""
    guide, space = appearance.guide, appearance.eigenspace
    x = appearance.preparation.prepare(picture)
    z = space.project(x).astype(float)
    if guide.turn is not None:
        away = float(guide.turn.away(z, space.distance(x, z.astype(np.float32)) ** 2).min())
        return looks_alike(away, away), -away
    cost, _ = guide.track.looks(z, slice(0, appearance.places))
    smoothed = smooth(appearance.ignored.filled(levels(picture)))
    fits, best = False, -1.0
    for at in _places(cost):
        tried = compare(guide, smoothed, float(at))
        agreement = min(tried.agreement, 1.0)
        fits = fits or belongs(guide, tried.reference, tried.registered, tried.agreement)
        best = max(best, agreement)
        if fits and best >= _CLEARLY:
            break
    return fits, best


def _places(cost: np.ndarray) -> list[int]:
    """Where to try a picture that costs so much at each place."""
    rest, places = cost.copy(), [at for at in _BEGINS if at < len(cost)]
    for _ in range(_ALIKE):
        at = int(rest.argmin())
        if not np.isfinite(rest[at]):
            break
        places.append(at)
        rest[max(0, at - _APART) : at + _APART + 1] = np.inf
    return places
