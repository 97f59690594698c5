"""An evaluation, and its JSON, by the names that scripts rely on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from functools import cached_property
from importlib.metadata import version

import cv2
import numpy as np
import scipy

from inspector.evaluation.baseline import KIND, Compared
from inspector.evaluation.labelled_set import LabelledSet
from inspector.evaluation.part_records import part_record
from inspector.evaluation.running import Failed, Run
from models.comparison import Changed, Difference
from models.labelled import Label, Summary, summarise
from models.limits import Promise, promise
from models.measures import CONFIDENCE, Proportion

VERSION = 1


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A labelled set, evaluated: what is told as text, JSON or a page."""

    labelled: LabelledSet
    run: Run
    learnt: bool
    """Whether the appearance was learnt from the golden sweeps of the set just now."""
    made: datetime
    baseline: Compared | None = None

    @cached_property
    def name(self) -> str:
        """Of the folder, or of the first of several places."""
        return self.labelled.name

    @cached_property
    def summary(self) -> Summary:
        """The figures."""
        return summarise(self.run.outcomes)

    @cached_property
    def promise(self) -> Promise:
        """What the golden sweeps promise of false rejects, to hold what was counted against."""
        return promise(self.run.appearance.peaks, self.run.policy.false_rejects)

    @cached_property
    def golden(self) -> tuple[str, ...]:
        """Names of the recordings that were learnt from; none where an appearance was given."""
        return tuple(path.name for path in self.labelled.golden) if self.learnt else ()

    @cached_property
    def libraries(self) -> dict[str, str]:
        """Versions of what counted."""
        modules = {"numpy": np, "scipy": scipy, "opencv": cv2}
        libraries = {name: str(module.__version__) for name, module in modules.items()}
        return {"sweep-inspector": version("sweep-inspector"), **libraries}

    def count(self, label: Label) -> int:
        """Parts inspected with that label."""
        return sum(each.label is label for each in self.run.outcomes)

    @cached_property
    def with_truth(self) -> int:
        """Parts of which it is known what each frame shows."""
        return sum(each.tally is not None for each in self.run.outcomes)


def evaluation_record(evaluation: Evaluation) -> dict[str, object]:
    """Everything but the pictures; what is not known is null."""
    run, baseline = evaluation.run, evaluation.baseline
    return {
        "kind": KIND,
        "version": VERSION,
        "folder": evaluation.name,
        "made": evaluation.made.isoformat(timespec="seconds"),
        "golden": list(evaluation.golden),
        "appearance_id": run.appearance.id,
        "appearance": dict(run.appearance.facts),
        "policy": asdict(run.policy),
        "promise": asdict(evaluation.promise),
        "libraries": evaluation.libraries,
        "counts": {
            **{label.value: evaluation.count(label) for label in Label},
            "failed": len(run.failed),
            "with_truth": evaluation.with_truth,
        },
        "confusion": {
            verdict.value: {label.value: count for label, count in labels.items()}
            for verdict, labels in evaluation.summary.confusion.items()
        },
        "confidence": CONFIDENCE,
        "figures": figures_record(evaluation.summary),
        "worst": {label.value: [each.outcome.name for each in run.worst(label)] for label in Label},
        "parts": [part_record(each) for each in run.inspected],
        "failed": [_failed(each) for each in run.failed],
        "baseline": _baseline(baseline) if baseline else None,
    }


def figures_record(summary: Summary) -> dict[str, object]:
    """The figures by name. Those counted in frames have no interval: frames of one part are not independent."""
    return {
        "false_rejects": _counted(summary.false_rejects),
        "escapes": _counted(summary.escapes),
        "part_auroc": summary.part_auroc,
        "frame_auroc": summary.frame_auroc,
        "defects_found": _counted(summary.defects_found),
        "clean_frames_flagged": _of_frames(summary.clean_flagged),
        "position_within_one_frame": _of_frames(summary.within_one_frame),
        "frames_not_scored": _of_frames(summary.unscored),
        "frames_missing": summary.missing,
    }


def _counted(proportion: Proportion | None) -> dict[str, object] | None:
    if proportion is None:
        return None
    interval = proportion.interval
    return {**asdict(proportion), "share": proportion.share, "interval": list(interval) if interval else None}


def _of_frames(proportion: Proportion | None) -> dict[str, object] | None:
    return {**asdict(proportion), "share": proportion.share} if proportion else None


def _failed(failed: Failed) -> Mapping[str, object]:
    return {"name": failed.name, "label": failed.label.value, "why": failed.why}


NAMES = {
    "clean_flagged": "clean_frames_flagged",
    "within_one_frame": "position_within_one_frame",
    "unscored": "frames_not_scored",
}
"""Figures that have another name in the JSON than in `models.labelled.Summary`."""


def _baseline(compared: Compared) -> dict[str, object]:
    comparison = compared.comparison
    return {
        "file": compared.file,
        "what": compared.what,
        "appearance_id": compared.appearance_id,
        "policy": dict(compared.policy),
        "parts": comparison.parts,
        "changed": [_changed(each) for each in comparison.changed],
        "differences": {NAMES.get(each.figure, each.figure): _difference(each) for each in comparison.differences},
        "only_before": list(comparison.only_before),
        "only_now": list(comparison.only_now),
        "other_recordings": list(compared.other_recordings),
        "failed": [_failed(each) for each in compared.failed],
    }


def _changed(each: Changed) -> dict[str, object]:
    return {
        "name": each.name,
        "label": each.label.value,
        "before": each.before.value,
        "now": each.now.value,
        "turn": each.turn.value,
    }


def _difference(each: Difference) -> dict[str, object]:
    return {
        "before": each.before,
        "now": each.now,
        "interval": list(each.interval) if each.interval else None,
        "turn": each.turn.value if each.turn else None,
        "may_be_chance": each.may_be_chance,
    }
