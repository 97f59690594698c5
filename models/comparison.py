"""Two appearances or policies on the same labelled parts: what changed, and what of it may be chance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TypeAlias

from models.labelled import Label, Outcome, Summary, Tally, summarise
from models.measures import Interval, Proportion, auroc_without_each, jackknife, paired
from models.verdict import Judgement

Pair: TypeAlias = tuple[Outcome, Outcome]
"""One part before and now."""


class Turn(StrEnum):
    """What a change is worth."""

    BETTER = "better"
    WORSE = "worse"
    SAME = "same"
    """Neither: no difference, or another verdict that is as right or as wrong."""


@dataclass(frozen=True)
class Changed:
    """A part whose verdict is another."""

    name: str
    label: Label
    before: Judgement
    now: Judgement
    turn: Turn


@dataclass(frozen=True)
class Difference:
    """One figure, before and now."""

    figure: str
    """A field of `models.labelled.Summary`."""
    before: float | None
    now: float | None
    interval: Interval | None
    """Of now less before, 95 %; None where it is not known."""
    turn: Turn | None
    """None where one of the two is not known."""

    @property
    def may_be_chance(self) -> bool | None:
        """Whether no difference at all lies inside the interval; None where that is not known."""
        return None if self.interval is None else self.interval[0] <= 0.0 <= self.interval[1]


@dataclass(frozen=True)
class Comparison:
    """Everything that changed, over the parts that both have."""

    parts: int
    changed: tuple[Changed, ...]
    differences: tuple[Difference, ...]
    only_before: tuple[str, ...]
    """Parts that are not compared: now they are not there, or have another label."""
    only_now: tuple[str, ...]


def compare(before: Sequence[Outcome], now: Sequence[Outcome]) -> Comparison:
    """What changed from `before` to `now`; parts are the same that have the same name and label."""
    known = {(each.name, each.label): each for each in before}
    pairs = [_alike(known[each.name, each.label], each) for each in now if (each.name, each.label) in known]
    both = {(each.name, each.label) for _, each in pairs}
    return Comparison(
        len(pairs),
        tuple(_changed(*pair) for pair in pairs if pair[0].verdict is not pair[1].verdict),
        tuple(_differences(pairs)),
        tuple(each.name for each in before if (each.name, each.label) not in both),
        tuple(each.name for each in now if (each.name, each.label) not in both),
    )


def _alike(before: Outcome, now: Outcome) -> Pair:
    """Without what only one of them knows."""
    if before.tally and now.tally:
        return before, now
    return replace(before, tally=None), replace(now, tally=None)


def _changed(before: Outcome, now: Outcome) -> Changed:
    turn = _turn(now.right - before.right)
    return Changed(now.name, now.label, before.verdict, now.verdict, turn)


def _turn(gain: float) -> Turn:
    if gain == 0:
        return Turn.SAME
    return Turn.BETTER if gain > 0 else Turn.WORSE


def _differences(pairs: Sequence[Pair]) -> list[Difference]:
    """A row for each figure. What is counted in parts or defects is compared one by one, the rest over parts."""
    sides = [[pair[side] for pair in pairs] for side in (0, 1)]
    before, now = (summarise(side) for side in sides)
    rows: list[Difference] = []
    for figure, good in FIGURES.items():
        a, b = (figure_of(summary, figure) for summary in (before, now))
        interval = None
        if a is not None and b is not None:
            cases = _CASES.get(figure)
            interval = _by_cases(cases(pairs)) if cases else _by_parts(figure, sides, b - a)
        turn = None if a is None or b is None else _turn(good * (b - a))
        rows.append(Difference(figure, a, b, interval, turn))
    return rows


FIGURES = {
    "false_rejects": -1,
    "escapes": -1,
    "part_auroc": 1,
    "frame_auroc": 1,
    "defects_found": 1,
    "clean_flagged": -1,
    "within_one_frame": 1,
    "unscored": -1,
}
"""Fields of Summary that are compared, and whether more is better."""


def figure_of(summary: Summary, figure: str) -> float | None:
    """One figure as a number; a share for a proportion."""
    value: Proportion | float | None = getattr(summary, figure)
    return value.share if isinstance(value, Proportion) else value


def _wrong(label: Label) -> Callable[[Sequence[Pair]], list[tuple[bool, bool]]]:
    return lambda pairs: [(not a.right, not b.right) for a, b in pairs if b.label is label]


def _found(pairs: Sequence[Pair]) -> list[tuple[bool, bool]]:
    tallies = [(a.tally, b.tally) for a, b in pairs if a.tally and b.tally and b.label is Label.BAD]
    return [(defect in a.found, defect in b.found) for a, b in tallies for defect in b.shown if defect in a.shown]


_CASES = {"false_rejects": _wrong(Label.GOOD), "escapes": _wrong(Label.BAD), "defects_found": _found}
"""What is counted one by one: whether it is so, before and now."""


def _by_cases(cases: Sequence[tuple[bool, bool]]) -> Interval | None:
    gained, lost = sum(b and not a for a, b in cases), sum(a and not b for a, b in cases)
    return paired(gained, lost, len(cases))


def _by_parts(figure: str, sides: Sequence[Sequence[Outcome]], difference: float) -> Interval | None:
    before, now = (_without_each(figure, side) for side in sides)
    left = [b - a for a, b in zip(before, now, strict=True) if a is not None and b is not None]
    return jackknife(difference, left) if len(left) == len(now) else None


def _without_each(figure: str, outcomes: Sequence[Outcome]) -> list[float | None]:
    """The figure without each part in turn."""
    if figure == "part_auroc":
        scores = [() if each.score is None else (each.score,) for each in outcomes]
        good = [each.label is Label.GOOD for each in outcomes]
        return auroc_without_each([(s, ()) if g else ((), s) for s, g in zip(scores, good, strict=True)])
    if figure == "frame_auroc":
        return auroc_without_each(
            [(each.tally.clean, each.tally.defective) if each.tally else ((), ()) for each in outcomes]
        )
    shares = [_share(figure, each) for each in outcomes]
    count, of = sum(each.count for each in shares), sum(each.of for each in shares)
    return [Proportion(count - each.count, of - each.of).share for each in shares]


def _share(figure: str, part: Outcome) -> Proportion:
    """One part's frames in a share over frames."""
    if figure == "unscored":
        return Proportion(part.unscored, part.frames)
    known: Tally | None = part.tally
    if known is None:
        return Proportion(0, 0)
    return known.flagged if figure == "clean_flagged" else known.within
