"""An evaluation in words: lines for a person at a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from inspector.evaluation.baseline import Compared
from inspector.evaluation.record import Evaluation
from inspector.evaluation.running import Inspected
from inspector.evaluation.words import FIGURES, area, between, counted, figure, percent, turned
from models.labelled import Label, Summary
from models.measures import Proportion

_INTERVAL = ("false_rejects", "escapes", "defects_found")


def lines(evaluation: Evaluation) -> Iterator[str]:
    """What was evaluated, verdicts by label, figures, the worst cases, what changed."""
    summary, run = evaluation.summary, evaluation.run
    good, bad = (evaluation.count(label) for label in Label)
    golden = f"learnt from {', '.join(evaluation.golden)}" if evaluation.golden else "not learnt from this folder"
    yield f"{evaluation.name}: {good} good and {bad} bad parts, {evaluation.with_truth} with truth; {golden}"
    yield run.appearance.id
    yield f"promised by {evaluation.promise.sentence()}"
    yield f"  {'':14}{'good':>6}{'bad':>6}"
    for verdict, labels in summary.confusion.items():
        yield f"  {verdict.value:14}" + "".join(f"{labels[label]:>6}" for label in Label)
    yield from (f"  {FIGURES[name]:28}{said}" for name, said in _figures(summary))
    for label, what in ((Label.GOOD, "highest"), (Label.BAD, "lowest")):
        if found := run.worst(label):
            yield f"  {what} of the {label} parts: {', '.join(_case(each) for each in found)}"
    if evaluation.baseline:
        yield from _changes(evaluation.baseline)
    if run.failed:
        yield f"not inspected, not counted: {', '.join(each.name for each in run.failed)}"


def _figures(summary: Summary) -> Iterator[tuple[str, str]]:
    for name in FIGURES:
        value: Proportion | float | None = getattr(summary, name)
        if not isinstance(value, Proportion):
            if value is not None:
                yield name, area(value)
        elif value.of:
            limits = f"   (95 %: {between(value.interval)})" if name in _INTERVAL else ""
            digits = 1 if name in _INTERVAL else 2
            yield name, f"{counted(value)}, {percent(value.share, digits)}{limits}"


def _case(part: Inspected) -> str:
    what = part.outcome
    wrong = "" if what.right else f" {what.verdict}"
    return f"{what.name}{wrong} {'no score' if what.score is None else f'{what.score:.2f}'}"


def _changes(compared: Compared) -> Iterator[str]:
    comparison = compared.comparison
    yield f"against {compared.file} ({compared.what}), {comparison.parts} parts:"
    for each in comparison.differences:
        if each.turn is not None:
            before, now = (figure(each.figure, value) for value in (each.before, each.now))
            yield f"  {FIGURES[each.figure]:28}{before:>9} -> {now:>9}  {turned(each)}"
    for each in comparison.changed:
        yield f"  {each.name}: {each.before} -> {each.now}  {each.turn}"
    if not comparison.changed:
        yield "  no part changed its verdict"
    for names, said in (
        (comparison.only_before, "only in the baseline"),
        (comparison.only_now, "not in the baseline"),
        (compared.other_recordings, "another recording than the baseline's"),
    ):
        if names:
            yield f"  {said}: {', '.join(names)}"
