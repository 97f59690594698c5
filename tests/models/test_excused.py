"""Excused regions move with the part: what lies in them is no defect at any place, and all else still is."""

from dataclasses import replace

import numpy as np
import pytest

from models.appearance import Appearance
from models.errors import LearningError
from models.excused import excused
from models.learning import absorb
from models.verdict import Judgement
from tests.models.parts import FIRST, MIDDLE, STEP, View, golden, inspected, surface, swept, with_spot

LABEL = (230, 110)
"""Where a label lies on the part."""
SEEN = View(dx=0.5, dy=0.5, seed=21)


def drawn(appearance: Appearance, place: int) -> np.ndarray:
    """The label on the picture of a place."""
    x, y = int(LABEL[0] - FIRST - STEP * place + 79.5), int(LABEL[1] - MIDDLE + 59.5)
    region = np.zeros(appearance.size[::-1], bool)
    region[y - 12 : y + 13, max(x - 12, 0) : x + 13] = True
    return region


@pytest.mark.parametrize("share", [0.35, 0.6, 0.85], ids=["coming", "in the middle", "going"])
def test_what_lies_in_an_excused_region_is_tolerated_wherever_it_is_seen(share: float):
    appearance = golden()
    place = int(appearance.keys[int(share * len(appearance.keys))])
    excusing = excused(appearance, place, drawn(appearance, place))
    assert excusing.id != appearance.id
    assert Appearance.from_bytes(excusing.to_bytes()).id == excusing.id
    printed, beside = (with_spot(surface(), x, 110, level=90) for x in (LABEL[0], LABEL[0] + 45))
    assert inspected(appearance, swept(printed, view=SEEN))[0].verdict is Judgement.NG
    assert inspected(excusing, swept(printed, view=SEEN))[0].verdict is Judgement.OK
    assert inspected(excusing, swept(beside, view=SEEN))[0].verdict is Judgement.NG


def test_what_was_excused_stays_so_when_a_sweep_is_added():
    place = int(golden().keys[15])
    excusing = excused(golden(), place, drawn(golden(), place))
    more = absorb(excusing, swept(surface(), view=View(seed=5)))
    printed = with_spot(surface(), *LABEL, level=90)
    assert inspected(more, swept(printed, view=SEEN))[0].verdict is Judgement.OK


def test_a_region_that_cannot_be_excused_is_refused():
    region = np.ones((120, 160), bool)
    with pytest.raises(LearningError, match="place 1 has no reference picture to draw on; allowed are \\[0, "):
        excused(golden(), 1, region)
    with pytest.raises(LearningError, match="the region is 80x60, the picture 160x120"):
        excused(golden(), 0, region[:60, :80])
    with pytest.raises(LearningError, match="does not move"):
        excused(replace(golden(), shifts=False), 0, region)
