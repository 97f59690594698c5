"""The result as scripts outside read it: every name of the interface, and numbers that JSON has."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from inspector.errors import OutputExists
from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.report import sentences
from inspector.result_json import BadRecord, frame_records, result_of, result_record, write_result
from models.limits import promise
from models.verdict import Deviation, FrameState, Judgement, Recognised, Region, Residuals, Result, ScoredFrame
from tests.inspector.conftest import Line

REGION = Region(120, 88, 24, 17, 3.2, "bright")
FRAMES = (
    ScoredFrame(0, 5, FrameState.WAITING, None, 0.0, 0.0, Residuals(0.0, 0.0, 0.0)),
    ScoredFrame(
        1, 9, FrameState.SCORED, 1 / 3, 3.2, 44.4, Residuals(3.2, 0.2, 0.1), (REGION,), 7, (1.0, 0, 0, 0, 1, 0)
    ),
)
DEVIATION = Deviation(0.36, 0.39, 144, 156, "appearance", "bright", 3.2, 150, (REGION,))
LIES = Recognised(None, "sha256:a", False, 5, 6, (-31.2, 4.0))
RESULT = Result(Judgement.NG, ("why",), 0.998, 398, 2, (DEVIATION,), "sha256:a", "sha256:d", FRAMES, LIES)
SEEN = {"x": 120, "y": 88, "width": 24, "height": 17, "score": 3.2, "polarity": "bright"}


def test_every_name_and_value_is_there(tmp_path: Path) -> None:
    facts = {"product_id": "valve", "part_id": "7", "camera": "x"}
    write_result(tmp_path / "a.json", result_record(RESULT, facts, is_simulated=True))
    record = json.loads((tmp_path / "a.json").read_text())
    assert len(record.pop("result_id")) == 36
    assert record.pop("frames") == [
        {
            "index": 0, "t_ns": 5, "state": "waiting", "s": None, "score": 0.0, "raw_score": 0.0,
            "residuals": {"appearance": 0.0, "position": 0.0, "timing": 0.0}, "regions": [],
        },
        {
            "index": 1, "t_ns": 9, "state": "scored", "s": 0.333333, "score": 3.2, "raw_score": 44.4,
            "residuals": {"appearance": 3.2, "position": 0.2, "timing": 0.1}, "regions": [SEEN],
        },
    ]  # fmt: skip
    assert record.pop("deviations") == [
        {
            "s_start": 0.36, "s_end": 0.39, "index_start": 144, "index_end": 156, "kind": "appearance",
            "polarity": "bright", "peak_score": 3.2, "peak_index": 150, "regions": [SEEN],
        }
    ]  # fmt: skip
    assert record == {
        "product_id": "valve", "part_id": "7", "recipe_id": None, "appearance_id": "sha256:a", "verdict": "NG",
        "result_state": "completed", "is_partial": False, "is_simulated": True, "reasons": ["why"],
        "coverage": 0.998, "frames_scored": 398, "frames_dropped": 2, "digest": "sha256:d",
        "recognised": {
            "part": None, "appearance_id": "sha256:a", "turned": False, "agree": 5, "of": 6, "off": [-31.2, 4.0],
        },
        "promise": None, "profile": [None] * 16 + [3.2] + [None] * 33,
    }  # fmt: skip


def test_a_record_tells_of_the_same_result_even_where_a_later_version_added_names() -> None:
    record = json.loads(json.dumps(result_record(RESULT, {}, is_simulated=True)))
    later = record | {"news": 1, "deviations": [each | {"news": 1} for each in record["deviations"]]}
    later["deviations"][0]["regions"][0]["news"] = 1
    for each in (record, later):
        assert result_of(each) == replace(RESULT, frames=())
        assert list(sentences(result_of(each))) == list(sentences(RESULT))


@pytest.mark.parametrize("change", [{"verdict": "FINE"}, {"deviations": [{}]}, {"deviations": 5}, {"reasons": None}])
def test_what_is_no_record_is_told_so(change: dict[str, object]) -> None:
    with pytest.raises(BadRecord, match="not the record of a concluded inspection"):
        result_of(result_record(RESULT, {}, is_simulated=True) | change)


def test_what_the_limits_were_set_by_is_there_for_whoever_judges_the_scores_again() -> None:
    promised = promise((0.6, 0.7), 0.01)
    told = result_record(RESULT, {}, is_simulated=True, promise=promised)["promise"]
    assert told == pytest.approx(asdict(promised), abs=1e-6)


def test_what_nobody_told_is_null_and_every_result_has_an_id_of_its_own() -> None:
    one, other = (result_record(RESULT, {}, is_simulated=False) for _ in range(2))
    assert (one["product_id"], one["part_id"], one["is_simulated"]) == (None, None, False)
    assert one.pop("result_id") != other.pop("result_id")
    assert one == other


def test_a_store_gives_the_id_and_keeps_the_frames_elsewhere() -> None:
    stored = result_record(RESULT, {}, is_simulated=False, result_id="mine", with_frames=False)
    assert stored["result_id"] == "mine"
    whole = result_record(RESULT, {}, is_simulated=False, result_id="mine")
    assert whole == {**stored, "frames": frame_records(FRAMES)}
    assert "frames" not in stored


def test_a_real_result_is_json_and_its_indices_count_the_recording(line: Line, tmp_path: Path) -> None:
    write_result(
        tmp_path / "a.json",
        result_record(replay(SweepReader(line.spot), line.appearance).result, {}, is_simulated=True),
    )
    record = json.loads((tmp_path / "a.json").read_text())
    assert [frame["index"] for frame in record["frames"]] == list(range(len(list(SweepReader(line.spot)))))
    assert all(frame["s"] is None or 0 <= frame["s"] <= 1 for frame in record["frames"])


def test_a_result_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("mine")
    with pytest.raises(OutputExists):
        write_result(tmp_path / "a.json", result_record(RESULT, {}, is_simulated=True))
    assert (tmp_path / "a.json").read_text() == "mine"
