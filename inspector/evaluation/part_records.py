"""One part of an evaluation <-> its JSON; what is written can be a baseline later."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from inspector.evaluation.running import Inspected
from models.labelled import Label, Outcome, Tally
from models.measures import Proportion
from models.verdict import Judgement

Count = Annotated[int, Field(ge=0)]
Score = Annotated[float, Field(ge=0, allow_inf_nan=False)]


def part_record(part: Inspected) -> dict[str, object]:
    """Everything of one part; `truth` is null where there was none."""
    what = part.outcome
    return {
        "name": what.name,
        "label": what.label.value,
        "verdict": what.verdict.value,
        "right": what.right,
        "reasons": list(part.reasons),
        "score": what.score,
        "peak_index": part.peak_index,
        "peak_s": part.peak_s,
        "coverage": part.coverage,
        "frames": what.frames,
        "frames_not_scored": what.unscored,
        "product_id": part.facts.get("product_id"),
        "part_id": part.facts.get("part_id"),
        "digest": part.digest,
        "recording": part.recording,
        "losses": list(part.losses),
        "truth": _tally_record(what.tally) if what.tally else None,
    }


def _tally_record(tally: Tally) -> dict[str, object]:
    return {
        "defects_shown": list(tally.shown),
        "defects_found": list(tally.found),
        "clean_scores": list(tally.clean),
        "defective_scores": list(tally.defective),
        "positions": tally.within.of,
        "positions_within_one_frame": tally.within.count,
        "frames_missing": tally.missing,
    }


class _Read(BaseModel):
    model_config = ConfigDict(extra="ignore")


class TallyInFile(_Read):
    """One part's frames against the truth."""

    defects_shown: tuple[int | str, ...]
    defects_found: tuple[int | str, ...]
    clean_scores: tuple[Score, ...]
    defective_scores: tuple[Score, ...]
    positions: Count
    positions_within_one_frame: Count
    frames_missing: Count

    def tally(self) -> Tally:
        """As it was when it was written."""
        within = Proportion(self.positions_within_one_frame, self.positions)
        shown, found = self.defects_shown, self.defects_found
        return Tally(self.clean_scores, self.defective_scores, within, self.frames_missing, shown, found)


class PartInFile(_Read):
    """What is read of one part."""

    name: str
    label: Label
    verdict: Judgement
    score: Score | None
    frames: Count
    frames_not_scored: Count
    recording: str
    truth: TallyInFile | None

    def outcome(self) -> Outcome:
        """As it was when it was written."""
        tally = self.truth.tally() if self.truth else None
        return Outcome(self.name, self.label, self.verdict, self.score, self.frames, self.frames_not_scored, tally)
