"""Figures in words: what each is called, and how it is written."""

from __future__ import annotations

from models.comparison import Difference, Turn
from models.measures import Interval, Proportion

FIGURES = {
    "false_rejects": "False rejects",
    "escapes": "Escapes",
    "part_auroc": "Part AUROC",
    "frame_auroc": "Frame AUROC",
    "defects_found": "Defects found",
    "clean_flagged": "Clean frames flagged",
    "within_one_frame": "Position within one frame",
    "unscored": "Frames not scored",
}
"""Fields of `models.labelled.Summary`."""
MEANINGS = {
    "false_rejects": "good parts with any verdict but OK",
    "escapes": "bad parts that are OK",
    "part_auroc": "how often a bad part's highest frame score exceeds a good part's",
    "frame_auroc": "the same for frames: with a whole defect in view, against frames without any",
    "defects_found": "a region pointed at the defect in a frame at or above the limit",
    "clean_flagged": "frames without a defect, at or above the limit",
    "within_one_frame": "of the frames that have a place",
    "unscored": "without a place, ambiguous, or blind",
}
UNKNOWN = "not known"
METHOD = (
    "A false reject is a good part with any verdict but OK; an escape is a bad part that is OK. A part's score is the "
    "highest of its frames; 1 is the limit. A part without a scored frame has none, and no share in the AUROC.",
    "Intervals are Clopper and Pearson's at 95 %, exact for parts and defects that are independent of each other. "
    "Figures counted in frames have none, for the frames of one part resemble each other. A difference from a baseline "
    "has an interval all the same: by the parts or defects that changed, and for the other figures by leaving out each "
    "part in turn.",
    "A region finds a defect when its centre lies within 10 pixels of the defect's box, in a frame at or above the "
    "limit, and it is no larger than nine times that box with its 10 pixels. A place is right when it lies within one "
    "frame of the nominal sweep of where the camera was, or between that and where it was sent. Frames of a bad part "
    "count as clean only where its truth places its defects. Without a truth these figures are not known.",
)
"""How figures are counted, for whoever reads them later."""


def area(value: float | None) -> str:
    """An area under a curve; what is not 1 does not look like it.

    >>> area(0.99999), area(1.0), area(0.98765), area(None)
    ('> 0.9999', '1.0000', '0.9877', 'not known')
    """
    if value is None:
        return UNKNOWN
    return "> 0.9999" if 0.99995 <= value < 1 else f"{value:.4f}"


def percent(share: float | None, digits: int = 1) -> str:
    """A share; what is not nothing does not look like it, nor what is not all like all.

    >>> percent(0.123), percent(0.0001), percent(0.99999), percent(0.0)
    ('12.3 %', '< 0.1 %', '> 99.9 %', '0.0 %')
    """
    if share is None:
        return UNKNOWN
    least = 10**-digits
    if 0 < 100 * share < least / 2:
        return f"< {least:g} %"
    if 100 - least / 2 <= 100 * share < 100:
        return f"> {100 - least:g} %"
    return f"{100 * share:.{digits}f} %"


def counted(proportion: Proportion | None) -> str:
    """So many of so many.

    >>> counted(Proportion(1, 7))
    '1 of 7'
    """
    return UNKNOWN if proportion is None or not proportion.of else f"{proportion.count} of {proportion.of}"


def between(interval: Interval | None) -> str:
    """The ends of an interval of a share.

    >>> between((0.0, 0.1684))
    '0.0 to 16.8 %'
    """
    return "" if interval is None else f"{100 * interval[0]:.1f} to {100 * interval[1]:.1f} %"


def figure(name: str, value: float | None) -> str:
    """A figure of a comparison, by its field."""
    return area(value) if name.endswith("auroc") else percent(value, 2)


def turned(difference: Difference) -> str:
    """What a difference is worth.

    >>> turned(Difference("escapes", 0.1, 0.0, (-0.3, 0.05), Turn.BETTER))
    'better, but inside the confidence interval: may be chance'
    """
    if difference.turn is None:
        return UNKNOWN
    if difference.turn is Turn.SAME:
        return "the same"
    if difference.may_be_chance is None:
        return f"{difference.turn}; no interval is known"
    chance = ", but inside the confidence interval: may be chance" if difference.may_be_chance else ", beyond chance"
    return f"{difference.turn}{chance}"
