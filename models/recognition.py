"""What lies there instead: the learnt part turned by 180 degrees or far off, or the part of another recipe."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32

from models.appearance import Appearance
from models.beginning import kept_every
from models.displaced import displaced
from models.eigenspace import Eigenspace
from models.frame import kind_of
from models.localise import belongs, compare
from models.preparation import Preparation
from models.registration import smooth
from models.scoring import is_blind
from models.tolerance import levels
from models.turning import belongs as looks_alike
from models.verdict import Recognised

_ENOUGH = 2 / 3
"""Share of the pictures that must agree."""
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


class _Guess(NamedTuple):
    """What may lie there, and how well that fits."""

    fit: _Fit
    other: Other | None = None
    """None for the learnt part."""
    turned: bool = False
    off: tuple[float, float] | None = None


def recognise(own: Appearance, pictures: Sequence[np.ndarray], others: Sequence[Other] = ()) -> Recognised | None:
    """What pictures of a sweep that does not begin as `own` does show instead; None where nobody knows.

    `pictures` are those that `models.beginning` keeps. Each is laid, for itself, on the places of an appearance that
    look most like it; how well it agrees does not hang on any eigenspace, and what is asked for is what tells a place
    from wrong ones there. Two thirds of the pictures must agree, five sixths where the part lies off. Others are
    looked at by their cards first, so that fifty cost little more than five.
    """
    usable = [i for i, picture in enumerate(pictures) if kind_of(picture) == own.references.kind and _shows(picture)]
    if not usable:
        return None
    seen, count = [pictures[i] for i in usable], len(usable)
    turned = [cv2.rotate(picture, cv2.ROTATE_180) for picture in seen]
    as_it_is = _Guess(_fit(own, seen))
    best = max(
        as_it_is, _Guess(_fit(own, turned), turned=True), _lying_off(own, seen, usable), key=lambda each: each.fit
    )
    likely = [
        _Guess(_fit(other.appearance(), turned if is_turned else seen), other, is_turned)
        for other, is_turned in _likely(seen, turned, others)
    ]
    likeliest = max(likely, key=lambda each: each.fit, default=None)
    if likeliest is not None and likeliest.fit.better(best.fit, count):
        best = likeliest
    if best is as_it_is or best.fit.agree < ceil(count * (5 / 6 if best.off else _ENOUGH)):
        return None
    part, appearance = (None, own) if best.other is None else (best.other.name, best.other.appearance())
    return Recognised(part, appearance.id, best.turned, best.fit.agree, count, best.off)


def _lying_off(own: Appearance, seen: Sequence[np.ndarray], numbers: Sequence[int]) -> _Guess:
    """The learnt part, further off than can be followed; `numbers` are those of the pictures among all kept."""
    lies = displaced(own, seen, [number * kept_every(own) for number in numbers])
    if lies is None or not lies.is_off:
        return _Guess(_Fit(-1, 0.0))
    return _Guess(_Fit(lies.agree, lies.agreement), off=(round(lies.across, 1), round(lies.degrees, 1)))


def _shows(picture: np.ndarray) -> bool:
    return not is_blind(smooth(levels(picture)))


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
        if agree + len(pictures) - done < ceil(len(pictures) * _ENOUGH):
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
