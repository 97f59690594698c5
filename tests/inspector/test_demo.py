"""The demo judges itself by the simulated camera's truth, and says so when it was wrong."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest

from inspector.cameras.simulated.render import Pose
from inspector.cameras.simulated.truth import DefectTruth, FrameTruth
from inspector.cli import run
from inspector.demo import DEFECTS, Demo, Row, Sample, lies_on_defect, planted_at, run_demo, samples
from inspector.demo_line import run_line
from models.verdict import Deviation, Judgement, Region, Result
from tests.system.serving import serve

SHORT = "&size=160x120&path=line&frames=60"
PARTS = (
    Sample("good", "pace=0.1&place=1,1,0.1"),
    Sample("spot", "defect=spot&at=0.5", "spot"),
    # What is told to be there is not: the demo must notice.
    Sample("lie", "", "spot"),
)


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Demo:
    return run_demo(tmp_path_factory.mktemp("demo") / "a", options=SHORT, parts=PARTS)


def test_verdicts_are_right_where_they_are_and_wrong_where_they_are_not(demo: Demo) -> None:
    assert [(row.result.verdict, row.right) for row in demo.rows] == [
        (Judgement.OK, True),
        (Judgement.NG, True),
        (Judgement.OK, False),
    ]
    assert not demo.right
    assert demo.same_digest


def test_the_place_comes_from_the_truth(demo: Demo) -> None:
    good, spot, lie = demo.rows
    assert (good.planted, lie.planted) == (None, None)
    assert spot.planted == pytest.approx(0.5, abs=0.02)
    assert any(d.s_start < spot.planted < d.s_end for d in spot.found)


def test_everything_is_left_in_the_folder(demo: Demo) -> None:
    names = ["01-good", "02-spot", "03-spot"]
    recordings = sorted(path.stem for path in (demo.folder / "recordings").iterdir())
    assert recordings == [*names, "golden-1", "golden-2"]
    for name, row in zip(names, demo.rows, strict=True):
        record = json.loads((demo.folder / "results" / f"{name}.json").read_text())
        assert (record["verdict"], record["digest"], record["part_id"]) == (row.result.verdict, row.result.digest, name)
    assert (demo.folder / "plate.appearance").is_file()
    strips = [path.name for path in (demo.folder / "filmstrips").iterdir()]
    assert len(strips) == len(demo.rows[1].result.deviations)


def test_the_command_shows_what_came_out_and_fails_when_it_was_wrong(
    demo: Demo, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    right = Demo(demo.folder, demo.rows[:2], True)
    for shown, code, words in ((demo, 1, "2 of 3 parts"), (right, 0, "2 of 2 parts")):
        monkeypatch.setattr("inspector.demo.run_demo", lambda *_, shown=shown, **__: shown)
        assert run(["demo", "--data", str(demo.folder / "new")]) == code
        out = capsys.readouterr().out
        assert words in out
        assert ("WRONG" in out) == (code == 1)


def test_every_kind_of_defect_is_planted_once_and_some_parts_are_good() -> None:
    planted = [sample.defect for sample in samples()]
    assert planted.count(None) >= 3
    assert [kind for kind in planted if kind] == list(DEFECTS)


def row(verdict: Judgement, defect: str | None, *on_it: bool) -> Row:
    deviation = Deviation(0.1, 0.2, 0, 1, "appearance", "dark", 2.0, 0)
    result = Result(verdict, (), 1.0, 1, 0, (deviation,) * len(on_it), "", "")
    return Row("1", Sample("a", "", defect), result, None, on_it)


def test_ng_elsewhere_is_not_right_nor_is_review_of_a_good_part() -> None:
    assert row(Judgement.NG, "spot", False, True).right
    assert row(Judgement.OK, None).right
    wrong = (
        row(Judgement.NG, "spot", False),
        row(Judgement.OK, "spot"),
        row(Judgement.REVIEW, None),
        row(Judgement.NG, None, False),
    )
    assert not any(each.right for each in wrong)


def seen(s: float, *boxes: tuple[float, float, float, float]) -> FrameTruth:
    return FrameTruth(0, s, s, Pose(0, 0, 0), tuple(DefectTruth(0, "spot", box, True) for box in boxes))


def test_a_defect_is_where_it_is_nearest_to_the_middle() -> None:
    truth = [seen(0.1, (0, 0, 10, 10)), seen(0.2, (70, 50, 80, 60)), seen(0.3, (100, 50, 110, 60)), seen(0.4)]
    assert planted_at(truth, (160, 120)) == 0.2
    assert planted_at([seen(0.4)], (160, 120)) is None


@pytest.mark.parametrize(("x", "on_it"), [(10, False), (40, True), (55, True), (80, False)])
def test_a_deviation_lies_on_a_defect_whose_box_its_region_touches(x: int, on_it: bool) -> None:
    deviation = Deviation(0, 1, 0, 2, "appearance", "dark", 2.0, 1, (Region(x, 20, 10, 10, 2.0, "dark"),))
    assert lies_on_defect(deviation, [seen(0.0), seen(0.5, (50, 25, 60, 35))]) is on_it


def test_the_line_teaches_a_service_and_its_verdicts_are_the_demos(demo: Demo, tmp_path: Path) -> None:
    told: dict[str, str] = {}
    with serve(tmp_path / "data") as served:
        run_line(served.url, demo.folder, "plate", threading.Event(), which=iter, on_verdict=told.__setitem__)
    assert told == {row.name: row.result.verdict.value for row in demo.rows}
