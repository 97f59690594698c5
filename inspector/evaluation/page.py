"""An evaluation as one page for a release record: nothing outside of it is asked for, and no script runs."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import asdict
from html import escape

from inspector.evaluation.baseline import Compared
from inspector.evaluation.charts import along_chart, roc_chart, scores_chart
from inspector.evaluation.markup import number, table
from inspector.evaluation.record import Evaluation
from inspector.evaluation.running import Case, Failed, Inspected, cases
from inspector.evaluation.style import STYLE
from inspector.evaluation.words import (
    FIGURES,
    MEANINGS,
    METHOD,
    UNKNOWN,
    area,
    between,
    counted,
    figure,
    percent,
    turned,
)
from models.comparison import Turn
from models.labelled import Label, Outcome, Summary
from models.measures import Proportion

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""What a browser may load for the page: the pictures and the style that are in it."""
COUNTED = ("false_rejects", "escapes", "defects_found")
"""Figures with an interval: what they count is independent, as frames of one part are not."""


def page(evaluation: Evaluation, *, topic: str | None = None) -> str:
    """The whole document. The recordings of the worst cases are read once more, for their pictures."""
    title = escape(f"Evaluation of {evaluation.name}")
    sections = [
        _head(evaluation),
        _failed(evaluation.run.failed),
        _tiles(evaluation.summary),
        _verdicts(evaluation),
        _compared(evaluation.baseline) if evaluation.baseline else "",
        _scores(evaluation),
        *(_worst(label, cases(evaluation.run, evaluation.labelled.parts, label, topic=topic)) for label in Label),
        _parts(evaluation.run.inspected),
        _evaluated(evaluation),
        f"<section><h2>How it is counted</h2>{''.join(f'<p>{escape(each)}</p>' for each in METHOD)}</section>",
    ]
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f'<link rel="icon" href="data:,">\n<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n'
        + "\n".join(section for section in sections if section)
        + "\n</main>\n</body>\n</html>\n"
    )


def _head(evaluation: Evaluation) -> str:
    good, bad = (evaluation.count(label) for label in Label)
    made = evaluation.made.strftime("%Y-%m-%d %H:%M UTC")
    said = f"{good} good and {bad} bad parts inspected, {evaluation.with_truth} with the truth of every frame"
    return (
        f"<header><h1>Evaluation of {escape(evaluation.name)}</h1>"
        f'<p class="faint">{made}. {said}.</p>'
        f'<p>Appearance <span class="id">{escape(evaluation.run.appearance.id)}</span></p></header>'
    )


def _failed(failed: Sequence[Failed]) -> str:
    if not failed:
        return ""
    rows = "".join(f"<li><b>{escape(each.name)}</b> ({each.label}): {escape(each.why)}</li>" for each in failed)
    count = "One recording" if len(failed) == 1 else f"{len(failed)} recordings"
    return (
        f'<section class="alarm"><p><b class="wrong">{count} could not be inspected</b>, and '
        f"nothing below counts them.</p><ul>{rows}</ul></section>"
    )


def _tiles(summary: Summary) -> str:
    tiles = [
        _tile("False rejects", summary.false_rejects),
        _tile("Escapes", summary.escapes),
        f"<li>Part AUROC<b>{area(summary.part_auroc)}</b><small>1 tells all bad parts from all good ones</small></li>",
        _tile("Defects found", summary.defects_found) if summary.defects_found else "",
    ]
    return f'<ul class="tiles">{"".join(tiles)}</ul>'


def _tile(name: str, proportion: Proportion) -> str:
    limits = between(proportion.interval)
    said = f"{percent(proportion.share)}, 95 %: {limits}" if limits else "nothing to count"
    return f"<li>{name}<b>{counted(proportion)}</b><small>{said}</small></li>"


def _verdicts(evaluation: Evaluation) -> str:
    rows = [
        (f"<th scope='row'>{verdict}</th>", *(number(labels[label]) for label in Label))
        for verdict, labels in evaluation.summary.confusion.items()
    ]
    verdicts = table(("verdict", *(f"{label} parts" for label in Label)), rows, "Verdict by label", numbers=2)
    both = f'<div class="beside">{verdicts}{_figures(evaluation.summary)}</div>'
    promised = f"<p>What the golden sweeps promise: {escape(evaluation.promise.sentence())}.</p>"
    return f"<section><h2>Verdicts and figures</h2>{both}{promised}</section>"


def _figures(summary: Summary) -> str:
    rows: list[Sequence[str]] = []
    for name, said in FIGURES.items():
        value: Proportion | float | None = getattr(summary, name)
        head = f"<th scope='row'>{said}<small>{MEANINGS[name]}</small></th>"
        if isinstance(value, float):
            rows.append((head, number(""), number(area(value)), number("")))
        elif isinstance(value, Proportion) and value.of:
            limits = between(value.interval) if name in COUNTED else ""
            share = percent(value.share, 1 if name in COUNTED else 2)
            rows.append((head, number(counted(value)), number(share), number(limits)))
        else:
            rows.append((head, number(""), number(UNKNOWN), number("")))
    return table(("figure", "count", "value", "95 % interval"), rows, "Figures", numbers=3)


def _compared(compared: Compared) -> str:
    comparison = compared.comparison
    rows = [
        (
            f"<th scope='row'>{FIGURES[each.figure]}</th>",
            number(figure(each.figure, each.before)),
            number(figure(each.figure, each.now)),
            f"<td>{_turn(turned(each), each.turn)}</td>",
        )
        for each in comparison.differences
    ]
    changes = [
        (
            f"<th scope='row'>{escape(each.name)}</th>",
            f"<td>{each.label}</td>",
            f"<td>{each.before}</td>",
            f"<td>{each.now}</td>",
            f"<td>{_turn(each.turn.value, each.turn)}</td>",
        )
        for each in comparison.changed
    ]
    notes = [
        f"<p>{said}: {escape(', '.join(names))}</p>"
        for said, names in (
            ("Not compared, only in the baseline", comparison.only_before),
            ("Not compared, not in the baseline", comparison.only_now),
            ("Another recording than the baseline's", compared.other_recordings),
        )
        if names
    ]
    changed = (
        table(("part", "label", "before", "now", ""), changes, "Parts with another verdict")
        if changes
        else "<p>No part changed its verdict.</p>"
    )
    policy = ", ".join(f"{name} {value}" for name, value in compared.policy.items())
    return (
        f"<section><h2>Against the baseline</h2>"
        f"<p>{escape(compared.file)}: {compared.what}, over {comparison.parts} parts. "
        f'Its appearance is <span class="id">{escape(compared.appearance_id)}</span>; its policy: {escape(policy)}.</p>'
        + table(("figure", "before", "now", "difference"), rows, "Figures side by side", numbers=(1, 2))
        + changed
        + "".join(notes)
        + "</section>"
    )


def _turn(said: str, turn: Turn | None) -> str:
    return f'<span class="wrong">{said}</span>' if turn is Turn.WORSE else said


def _scores(evaluation: Evaluation) -> str:
    return (
        '<section><h2>Scores</h2><div class="beside"><figure>'
        f"{scores_chart(evaluation.run.inspected)}"
        "<figcaption>The highest score of each part. A cross is a part that was judged wrongly.</figcaption></figure>"
        f"<figure>{roc_chart(evaluation.run.outcomes)}</figure></div></section>"
    )


def _worst(label: Label, found: Sequence[Case]) -> str:
    if not found:
        return ""
    what = "highest" if label is Label.GOOD else "lowest"
    said = "false rejects" if label is Label.GOOD else "escapes"
    figures = "".join(_case(case) for case in found)
    return f"<section><h2>Worst cases: {label} parts, {said} first, then the {what} scores</h2>{figures}</section>"


def _case(case: Case) -> str:
    what, name = case.inspected.outcome, escape(case.inspected.outcome.name)
    picture = "<p>No frame was compared: there is nothing to show.</p>"
    if case.strip is not None:
        data = b64encode(case.strip).decode()
        alt = f"Filmstrip of {name}: expected, seen and their difference about the highest score"
        picture = f'<img alt="{alt}" src="data:image/jpeg;base64,{data}">'
    placed = case.part.truth and any(frame.defects for frame in case.part.truth.frames)
    shown = " Shaded: a defect is in view." if placed else ""
    return (
        f"<figure><h3>{name}: {_verdict(what)}, {_peak(case.inspected)}</h3>"
        f"<p>{escape('; '.join(case.result.reasons))}</p>"
        f"{along_chart(case.result, case.part.truth, what.name)}"
        f"<figcaption>Score along s (root scale); the dashed line is the limit.{shown}</figcaption>{picture}</figure>"
    )


def _peak(part: Inspected) -> str:
    if part.outcome.score is None:
        return "no score"
    place = "" if part.peak_s is None else f" at s = {part.peak_s:.3f}"
    return f"highest score {part.outcome.score:.2f}{place}"


def _verdict(what: Outcome) -> str:
    if what.right:
        return what.verdict.value
    name = "false reject" if what.label is Label.GOOD else "escape"
    return f'<span class="wrong">{what.verdict} ({name})</span>'


def _parts(parts: Sequence[Inspected]) -> str:
    rows = [
        (
            f"<th scope='row'>{escape(part.outcome.name)}</th>",
            f"<td>{part.outcome.label}</td>",
            f"<td>{_verdict(part.outcome)}</td>",
            number("–" if part.outcome.score is None else f"{part.outcome.score:.2f}"),
            number("–" if part.peak_s is None else f"{part.peak_s:.3f}"),
            number(percent(part.coverage)),
            number(counted(Proportion(part.outcome.unscored, part.outcome.frames))),
            number(_defects(part.outcome)),
        )
        for part in parts
    ]
    heads = ("part", "label", "verdict", "score", "at s", "coverage", "not scored", "defects found")
    return f"<section><h2>All parts</h2>{table(heads, rows, 'Each part inspected', numbers=(3, 4, 5, 6, 7))}</section>"


def _defects(what: Outcome) -> str:
    if what.tally is None or not what.tally.shown:
        return "–"
    return counted(Proportion(len(what.tally.found), len(what.tally.shown)))


def _evaluated(evaluation: Evaluation) -> str:
    run = evaluation.run
    golden = ", ".join(evaluation.golden) or "none of this folder: the appearance was given"
    rows = {
        "Folder": evaluation.name,
        "Made": evaluation.made.isoformat(timespec="seconds"),
        "Golden sweeps learnt from": golden,
        "Appearance": run.appearance.id,
        **{f"Learnt with, {name}": fact for name, fact in sorted(run.appearance.facts.items())},
        **{f"Policy, {name.replace('_', ' ')}": str(value) for name, value in asdict(run.policy).items()},
        **{f"Evaluated with, {name}": version for name, version in evaluation.libraries.items()},
    }
    cells = [
        (f"<th scope='row'>{escape(name)}</th>", f'<td class="id">{escape(said)}</td>') for name, said in rows.items()
    ]
    return (
        f"<section><h2>What was evaluated</h2>{table(('', ''), cells, 'Everything that decides a verdict')}</section>"
    )
