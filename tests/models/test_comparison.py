"""Comparison: what changed is counted part by part, and turning the sides round turns the differences round."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.comparison import FIGURES, Turn, compare
from models.labelled import Label, Outcome, Tally
from models.measures import Proportion
from models.verdict import Judgement
from tests.models.parts import MANY

SCORES = st.lists(st.integers(0, 4).map(lambda tenths: tenths / 2), max_size=4).map(tuple)


@st.composite
def tallies(draw: st.DrawFn) -> Tally:
    found = draw(st.sets(st.integers(0, 2)))
    within = Proportion(draw(st.integers(0, 5)), 5)
    return Tally(draw(SCORES), draw(SCORES), within, 0, (0, 1, 2), tuple(sorted(found)))


@st.composite
def sets(draw: st.DrawFn, count: int = 4) -> list[Outcome]:
    return [
        Outcome(
            f"part {n}",
            Label.GOOD if n % 2 else Label.BAD,
            draw(st.sampled_from([Judgement.OK, Judgement.NG, Judgement.REVIEW])),
            draw(st.none() | st.integers(0, 4).map(float)),
            10,
            draw(st.integers(0, 10)),
            draw(st.none() | tallies()),
        )
        for n in range(count)
    ]


@given(parts=sets())
@MANY
def test_against_itself_nothing_changed(parts: list[Outcome]) -> None:
    found = compare(parts, parts)
    assert found.changed == ()
    assert {each.turn for each in found.differences} <= {Turn.SAME, None}
    assert {each.may_be_chance for each in found.differences} <= {True, None}
    assert [each.figure for each in found.differences] == list(FIGURES)


@given(before=sets(), now=sets())
@MANY
def test_the_other_way_round_is_the_other_way_round(before: list[Outcome], now: list[Outcome]) -> None:
    other = {Turn.BETTER: Turn.WORSE, Turn.WORSE: Turn.BETTER, Turn.SAME: Turn.SAME, None: None}
    there, back = compare(before, now), compare(now, before)
    assert [each.turn for each in there.changed] == [other[each.turn] for each in back.changed]
    for a, b in zip(there.differences, back.differences, strict=True):
        assert (a.before, a.now, a.turn) == (b.now, b.before, other[b.turn])
        assert (a.interval is None) == (b.interval is None)
        if a.interval and b.interval:
            assert a.interval == pytest.approx((-b.interval[1], -b.interval[0]), abs=1e-9)


@given(before=sets(), now=sets())
@MANY
def test_a_difference_lies_in_its_interval(before: list[Outcome], now: list[Outcome]) -> None:
    for each in compare(before, now).differences:
        if each.interval and each.before is not None and each.now is not None:
            assert each.interval[0] - 1e-9 <= each.now - each.before <= each.interval[1] + 1e-9


def part(name: str, label: Label, verdict: Judgement) -> Outcome:
    return Outcome(name, label, verdict, 1.0, 10, 0)


def test_parts_are_the_same_by_name_and_label_and_the_rest_is_named() -> None:
    before = [
        part("a", Label.GOOD, Judgement.OK),
        part("b", Label.GOOD, Judgement.OK),
        part("c", Label.BAD, Judgement.NG),
    ]
    now = [part("a", Label.GOOD, Judgement.NG), part("b", Label.BAD, Judgement.NG), part("d", Label.BAD, Judgement.NG)]
    found = compare(before, now)
    assert (found.parts, found.only_before, found.only_now) == (1, ("b", "c"), ("b", "d"))
    assert [(each.name, each.before, each.now, each.turn) for each in found.changed] == [
        ("a", Judgement.OK, Judgement.NG, Turn.WORSE)
    ]


def test_another_wrong_verdict_is_neither_better_nor_worse() -> None:
    now = [part("a", Label.GOOD, Judgement.REVIEW)]
    assert compare([part("a", Label.GOOD, Judgement.NG)], now).changed[0].turn is Turn.SAME


@pytest.mark.parametrize(("changes", "chance"), [(5, True), (6, False)])
def test_five_escapes_less_may_be_chance_and_six_are_not(changes: int, chance: bool) -> None:
    before = [part(f"{n}", Label.BAD, Judgement.OK) for n in range(20)]
    now = [replace(each, verdict=Judgement.NG) if n < changes else each for n, each in enumerate(before)]
    escapes = next(each for each in compare(before, now).differences if each.figure == "escapes")
    assert (escapes.before, escapes.turn, escapes.may_be_chance) == (1.0, Turn.BETTER, chance)
    assert escapes.now == 1 - changes / 20
