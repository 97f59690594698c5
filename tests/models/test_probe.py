"""Probing a small part: what is larger or stronger is not harder, what is blind is said to be, twice is the same."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from models.appearance import Appearance
from models.defects import Defect, Kind
from models.detectability import Detectability
from models.errors import LearningError, PictureError
from models.learning import learn
from models.probe import SPACING, probe
from models.rehearsal import Planted, ReferenceSweep, Rehearsal
from models.sites import sites
from models.verdict import Policy
from tests.models.parts import FIRST, STEP, View, places, surface, swept

SIZE = (112, 84)
VIEW = View(size=SIZE, noise=0.5)
SATURATED = slice(170, 260)
"""Columns of the part that the camera shows as white."""
LAST = 34
FEW = 1 / 3
"""Sites as far apart as a third of the picture is wide."""


def part() -> np.ndarray:
    """Half of its middle is white."""
    spoilt = surface().copy()
    spoilt[110:, SATURATED] = 400
    return spoilt


@lru_cache
def small() -> Appearance:
    return learn([swept(part(), places(last=LAST), VIEW)])


@lru_cache
def mapped() -> Detectability:
    return probe(small(), kinds=[Kind.SPOT], contrasts=[60], spacing=1 / 5)


@lru_cache
def coarse() -> Detectability:
    return probe(small(), kinds=[Kind.SPOT], contrasts=[60], spacing=FEW)


def test_what_cannot_be_seen_is_blind() -> None:
    found = mapped()
    sizes = found.at(Kind.SPOT, 60)
    x = np.array([FIRST + STEP * site.place + site.x - (SIZE[0] - 1) / 2 for site in found.sites])
    y = np.array([110 + site.y - (SIZE[1] - 1) / 2 for site in found.sites])
    white = (x > SATURATED.start + 14) & (x < SATURATED.stop - 14) & (y > 124)
    textured = found.inner & ((x < SATURATED.start - 14) | (y < 100))
    assert white.sum() >= 3
    assert textured.sum() >= 8
    assert np.isinf(sizes[white]).all()
    assert np.isfinite(sizes[textured]).mean() > 0.8


def test_the_same_again() -> None:
    again = probe(small(), kinds=[Kind.SPOT], contrasts=[60], spacing=FEW)
    assert np.array_equal(again.smallest, coarse().smallest)
    assert (again.sites, again.blur) == (coarse().sites, coarse().blur)


def test_placement_does_not_suffer() -> None:
    assert mapped().astray == 0
    assert mapped().sweeps == 0


@pytest.mark.parametrize("kind", [Kind.SPOT, Kind.LINE])
def test_larger_and_stronger_is_not_harder(kind: Kind) -> None:
    rehearsal = Rehearsal.of(small(), Policy(), ReferenceSweep(small()), 1.0)
    inner = [site for site in sites(small(), SPACING * SIZE[0]) if site.depth > 20][::14]
    bright = [bool(small().references.get(site.place).picture[int(site.y), int(site.x)] < 120) for site in inner]

    def caught(size: float, contrast: float) -> np.ndarray:
        tried = [
            rehearsal.attempt([Planted(site, Defect(kind, size, contrast, up))])[0]
            for site, up in zip(inner, bright, strict=True)
        ]
        return np.array(tried)

    by_size = [caught(size, 80) for size in (1.0, 3.0, 6.0, 10.0)]
    by_contrast = [caught(6.0, contrast) for contrast in (5, 40, 100)]
    for less, more in [*pairwise(by_size), *pairwise(by_contrast)]:
        assert (less <= more).all()
    assert not by_contrast[0].any()
    assert by_size[-1].any()


def test_more_sensitive_policies_catch_smaller_ones() -> None:
    finer = probe(small(), Policy(sensitivity=2.0), kinds=[Kind.SPOT], contrasts=[60], spacing=FEW)
    assert finer.usual(Kind.SPOT, 60) < coarse().usual(Kind.SPOT, 60)


def test_a_recording_of_another_part_or_another_kind_is_refused() -> None:
    other = swept(surface(5), places(last=3), VIEW)
    with pytest.raises(LearningError, match="none of the 4 frames of sweep 1 fits the appearance"):
        probe(small(), sweeps=[other])
    with pytest.raises(PictureError, match="learnt from 112x84 grey 8 bit"):
        probe(small(), sweeps=[swept(part(), places(last=3))])
