"""A folder of recordings whose names tell what they are: golden, good, bad; with their truth where there is one.

inspector.errors.WorldError
└── SetRefused               a folder in which there is nothing to evaluate
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from inspector.errors import WorldError
from inspector.evaluation.truth import read_truth, truth_of
from models.labelled import Label, Truth


class SetRefused(WorldError):
    """A folder in which there is nothing to evaluate."""

    def __init__(self, folder: Path, why: str) -> None:
        super().__init__(f"{folder}: {why}")


@dataclass(frozen=True)
class Part:
    """A recording, and what is known of it beforehand."""

    path: Path
    label: Label
    truth: Truth | None

    @property
    def name(self) -> str:
        """Of the file, without its suffix."""
        return self.path.stem


@dataclass(frozen=True)
class LabelledSet:
    """What is in a folder."""

    folder: Path
    golden: tuple[Path, ...]
    """To learn from: `golden.mcap` first, the others by name."""
    parts: tuple[Part, ...]
    """To inspect: the good ones, then the bad ones, each by name."""


def read_set(folder: Path, *, learns: bool) -> LabelledSet:
    """What is in the folder; `learns` says that there must be golden sweeps. Every truth is read now.

    Raises SetRefused, TruthRefused.
    """
    if not folder.is_dir():
        raise SetRefused(folder, "no such folder; allowed is one with golden*.mcap, good*.mcap and bad*.mcap")
    golden = sorted(folder.glob("golden*.mcap"), key=lambda path: (path.name != "golden.mcap", path.name))
    if learns and not golden:
        raise SetRefused(folder, "no golden*.mcap to learn from; add one, or name what was learnt with --appearance")
    parts = tuple(
        Part(path, label, read_truth(truth_of(path)) if truth_of(path).exists() else None)
        for label in Label
        for path in sorted(folder.glob(f"{label}*.mcap"))
    )
    if not parts:
        raise SetRefused(folder, "neither good*.mcap nor bad*.mcap in it; there is nothing to evaluate")
    return LabelledSet(folder, tuple(golden), parts)
