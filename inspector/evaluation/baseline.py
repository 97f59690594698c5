"""What an evaluation is compared with: another appearance, another policy, or an earlier evaluation; told by content.

inspector.errors.WorldError
└── BaselineRefused          a file that is none of them, or with which nothing could be compared
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, ValidationError

from inspector.errors import WorldError
from inspector.evaluation.labelled_set import Part
from inspector.evaluation.part_records import PartInFile
from inspector.evaluation.running import Failed, Run, run
from inspector.executors import Executor
from inspector.learner import load_appearance
from inspector.locations import Location
from inspector.policies import read_policy
from models.appearance import SEAL, Appearance
from models.comparison import Comparison, compare
from models.verdict import Policy

KIND = "evaluation"
"""What an evaluation's JSON says that it is."""


class BaselineRefused(WorldError):
    """A file that is no baseline, or with which nothing could be compared."""

    def __init__(self, path: Location, why: str) -> None:
        super().__init__(f"{path}: {why}")


class EarlierEvaluation(BaseModel):
    """What is read of an evaluation's JSON."""

    model_config = ConfigDict(extra="ignore")

    kind: Literal["evaluation"]
    version: Literal[1]
    appearance_id: str
    policy: dict[str, object]
    parts: tuple[PartInFile, ...]


Source: TypeAlias = Appearance | Policy | EarlierEvaluation


def read_baseline(path: Location) -> Source:
    """The baseline in a file. Raises BaselineRefused, AppearanceError, PolicyRefused."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BaselineRefused(path, error.strerror or str(error)) from error
    if data.startswith(SEAL.tag):
        return load_appearance(path)
    try:
        said = json.loads(data)
    except ValueError:
        said = None
    if not isinstance(said, dict):
        raise BaselineRefused(path, "no baseline; allowed is an appearance, a policy, or the JSON of an evaluation")
    if "kind" not in said:
        return read_policy(path)
    try:
        return EarlierEvaluation.model_validate_json(data)
    except ValidationError as error:
        wrong = error.errors()[0]
        name = ".".join(str(part) for part in wrong["loc"])
        why = f"{name}: {wrong['msg'].replace('Input should', 'it should')}; allowed is what `evaluate --json` writes"
        raise BaselineRefused(path, why) from error


@dataclass(frozen=True)
class Compared:
    """An evaluation beside its baseline."""

    file: str
    what: str
    """In words: which kind of baseline it is."""
    appearance_id: str
    policy: Mapping[str, object]
    comparison: Comparison
    failed: tuple[Failed, ...]
    """Recordings that the baseline could not inspect."""
    other_recordings: tuple[str, ...]
    """Parts whose recording is not the one that the earlier evaluation read."""


def compared(
    path: Location,
    source: Source,
    now: Run,
    parts: Sequence[Part],
    progress: Callable[[float], object] = lambda share: None,
    *,
    topic: str | None = None,
    executor: Executor | None = None,
) -> Compared:
    """Now beside the baseline, which is run over the same parts unless it is an earlier evaluation.

    Another appearance is judged by the policy of now, another policy judges by the appearance of now. Raises
    BaselineRefused where no part is in both.
    """
    if isinstance(source, EarlierEvaluation):
        return _beside_earlier(path, source, now)
    other = isinstance(source, Appearance)
    appearance, policy = (source, now.policy) if isinstance(source, Appearance) else (now.appearance, source)
    before = run(parts, appearance, policy, progress, topic=topic, executor=executor)
    comparison = compare(before.outcomes, now.outcomes)
    if not comparison.parts:
        why = before.failed[0].why if before.failed else now.failed[0].why
        raise BaselineRefused(path, f"no part can be compared: {why}")
    what = "another appearance, the same policy" if other else "another policy, the same appearance"
    return Compared(path.name, what, appearance.id, asdict(policy), comparison, before.failed, ())


def _beside_earlier(path: Location, source: EarlierEvaluation, now: Run) -> Compared:
    comparison = compare([part.outcome() for part in source.parts], now.outcomes)
    if not comparison.parts:
        raise BaselineRefused(path, "no part can be compared: no name and label is in both")
    recordings = {(part.name, part.label): part.recording for part in source.parts}
    other = [
        each.outcome.name
        for each in now.inspected
        if recordings.get((each.outcome.name, each.outcome.label), each.recording) != each.recording
    ]
    what = "an earlier evaluation"
    return Compared(path.name, what, source.appearance_id, source.policy, comparison, (), tuple(other))
