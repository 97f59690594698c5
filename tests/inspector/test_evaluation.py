"""`inspector evaluate`: a small real set, learnt, inspected, counted, compared and shown, from the command line on."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import dataclass
from datetime import timedelta
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import obstore
import pytest

from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.cli import run
from inspector.objects import Objects, beneath
from inspector.recorder import record
from inspector.recording import SweepReader
from inspector.replay import replay
from models.verdict import Judgement
from tests.buckets import Buckets
from tests.inspector.conftest import Line
from tests.inspector.line import SPOT, recorded, url

Captured = pytest.CaptureFixture[str]
NOMINAL = 60
GOOD = "unit=3&seed=13&pace=0.1&lost=0.05"
BAD = {"bad-spot": SPOT, "bad-<i>&": "unit=5&seed=15&defect=spot&at=0.3"}
"""A name that a page must not take for its own language."""


def with_truth(path: Path, options: str) -> Path:
    """A recording, and beside it what it shows."""
    with open_camera(url(options)) as camera:
        assert isinstance(camera, SimulatedCamera)
        record(camera, path, lossless=True, product_id="plate", part_id=path.stem)
        frames = [
            {
                "index": index,
                "s": frame.s,
                "commanded": frame.commanded * (NOMINAL - 1),
                "defects": [
                    {"id": d.index, "box": list(d.box), "type": d.kind, "inside": d.inside} for d in frame.defects
                ],
            }
            for index, frame in enumerate(camera.truth())
        ]
    truth = {"nominal_frames": NOMINAL, "part": path.stem.split("-")[0], "frames": frames}
    path.with_suffix(".truth.json").write_text(json.dumps(truth))
    return path


@dataclass(frozen=True)
class Evaluated:
    """A set with truth, evaluated once by the command line; no test writes to it."""

    folder: Path
    out: str
    record: dict[str, Any]
    page: str


@pytest.fixture(scope="module")
def evaluated(line: Line, tmp_path_factory: pytest.TempPathFactory) -> Evaluated:
    folder, outside = tmp_path_factory.mktemp("plates"), tmp_path_factory.mktemp("out")
    for path in line.golden:
        shutil.copy(path, folder)
    with_truth(folder / "good-1.mcap", GOOD)
    recorded(folder / "good-2.mcap", "unit=5&seed=19&stop=0.6")
    for name, options in BAD.items():
        with_truth(folder / f"{name}.mcap", options)
    with pytest.MonkeyPatch.context() as patch:
        said: list[str] = []
        patch.setattr("builtins.print", lambda *lines, file=None: said.extend(map(str, lines)))
        options = ("--json", outside / "e.json", "--html", outside / "e.html")
        assert run(["evaluate", str(folder), *map(str, options)]) == 0
    out = "\n".join(said)
    return Evaluated(folder, out, json.loads((outside / "e.json").read_text()), (outside / "e.html").read_text())


def told(capsys: Captured, *arguments: object) -> tuple[int, str, str]:
    """Exit code, stdout, stderr of `inspector evaluate`."""
    code = run(["evaluate", *map(str, arguments)])
    return code, *capsys.readouterr()


def a_set(folder: Path, line: Line, **parts: Path) -> Path:
    """A folder with recordings by name, and nothing to learn from."""
    folder.mkdir()
    for name, path in parts.items():
        shutil.copy(path, folder / f"{name}.mcap")
    return folder


def test_several_processes_count_the_same(evaluated: Evaluated, tmp_path: Path) -> None:
    command = ["evaluate", str(evaluated.folder), "--json", str(tmp_path / "e.json"), "--executor", "processes:2"]
    assert run(command) == 0
    record = json.loads((tmp_path / "e.json").read_text())
    assert record.pop("made") != (before := dict(evaluated.record)).pop("made")
    assert record == before


def test_a_set_in_a_bucket_is_evaluated_as_one_on_the_disk(
    evaluated: Evaluated, tmp_path: Path, buckets: Buckets
) -> None:
    bucket = buckets.new()
    url = beneath(bucket, f"line 1/{evaluated.folder.name}")
    for path in evaluated.folder.iterdir():
        Objects(url).put_new(path.name, path)
    # A set of its own.
    Objects(url).put_new("deeper/bad-9.mcap", evaluated.folder / "bad-spot.mcap")
    assert run(["evaluate", url, "--json", str(tmp_path / "e.json"), "--html", str(tmp_path / "e.html")]) == 0
    record = json.loads((tmp_path / "e.json").read_text())
    assert record.pop("made") != (before := dict(evaluated.record)).pop("made")
    assert record == before
    assert re.sub(r"\d{4}-\d\d-\d\d[^<]*", "", (tmp_path / "e.html").read_text()) == re.sub(
        r"\d{4}-\d\d-\d\d[^<]*", "", evaluated.page
    )


def test_recordings_are_named_one_by_one_and_by_url_and_their_truths_are_beside_them(
    evaluated: Evaluated, line: Line, tmp_path: Path, capsys: Captured, buckets: Buckets
) -> None:
    bucket, put = buckets.new(), ("bad-spot.mcap", "bad-spot.truth.json", "good-2.mcap")
    for name in put:
        Objects(bucket).put_new(name, evaluated.folder / name)
    Objects(bucket).put_new("plate.appearance", line.file)
    signed = obstore.sign(Objects(bucket)._store, "GET", "good-2.mcap", timedelta(minutes=5))
    places = (evaluated.folder / "good-1.mcap", beneath(bucket, "bad-spot.mcap"), signed)
    options = ("--appearance", beneath(bucket, "plate.appearance"), "--json", tmp_path / "e.json")
    assert told(capsys, *places, *options, "--executor", "processes:2")[0] == 0
    record = json.loads((tmp_path / "e.json").read_text())
    assert (record["folder"], record["counts"]) == (
        "good-1.mcap and 2 more", {"good": 2, "bad": 1, "failed": 0, "with_truth": 2}
    )  # fmt: skip
    before = {part["name"]: part for part in evaluated.record["parts"]}
    assert [part["name"] for part in record["parts"]] == ["good-1", "good-2", "bad-spot"]
    assert all(part == before[part["name"]] for part in record["parts"])


def test_several_folders_are_one_set_whose_parts_have_their_names(line: Line, tmp_path: Path, capsys: Captured) -> None:
    folders = [a_set(tmp_path / name, line, good=line.good) for name in ("monday", "tuesday")]
    options = ("--appearance", line.file, "--json", tmp_path / "e.json")
    assert told(capsys, *folders, *options)[0] == 0
    found = json.loads((tmp_path / "e.json").read_text())
    assert found["folder"] == "monday and 1 more"
    assert [part["name"] for part in found["parts"]] == ["monday/good", "tuesday/good"]


def test_a_place_that_is_no_part_of_a_set_is_refused(line: Line, tmp_path: Path, capsys: Captured) -> None:
    folder = a_set(tmp_path / "set", line, good=line.good, other=line.good)
    for places, said in (
        ((folder / "good.mcap", folder / "good.mcap"), "two parts would be 'good'; name each part once"),
        ((folder / "other.mcap",), "its name does not tell what it is; allowed are golden*.mcap, good*.mcap and bad*"),
        ((folder / "good-9.mcap",), "no such folder or recording; allowed are folders with golden*.mcap"),
        (("s3://bucket/good.mcap?key=secret",), "'key' is not known"),
    ):
        code, out, err = told(capsys, *places, "--appearance", line.file)
        assert (code, out, err.count("\n")) == (1, "", 1)
        assert said in err


def test_what_was_evaluated_is_said(evaluated: Evaluated, line: Line) -> None:
    found = evaluated.record
    assert (found["kind"], found["folder"], found["golden"]) == (
        "evaluation", evaluated.folder.name, ["golden-1.mcap", "golden-2.mcap"]
    )  # fmt: skip
    assert found["appearance_id"] == line.appearance.id
    assert found["counts"] == {"good": 2, "bad": 2, "failed": 0, "with_truth": 3}
    assert found["policy"]["sensitivity"] == 1.0
    assert set(found["libraries"]) >= {"sweep-inspector", "numpy", "opencv"}
    assert found["baseline"] is None


def test_every_part_is_judged_as_a_replay_judges_it(evaluated: Evaluated, line: Line) -> None:
    for part in evaluated.record["parts"]:
        result = replay(SweepReader(evaluated.folder / f"{part['name']}.mcap"), line.appearance).result
        assert (part["digest"], part["verdict"], part["frames"]) == (result.digest, result.verdict, len(result.frames))
        assert part["score"] == pytest.approx(max(frame.score for frame in result.frames), abs=1e-6)


def test_the_figures_are_right(evaluated: Evaluated) -> None:
    figures, confusion = evaluated.record["figures"], evaluated.record["confusion"]
    assert {verdict: each for verdict, each in confusion.items() if any(each.values())} == {
        "OK": {"good": 1, "bad": 0},
        "NG": {"good": 0, "bad": 2},
        "INCOMPLETE": {"good": 1, "bad": 0},
    }
    assert set(confusion) == {verdict.value for verdict in Judgement}
    rejects = figures["false_rejects"]
    assert (rejects["count"], rejects["of"], rejects["share"]) == (1, 2, 0.5)
    assert rejects["interval"] == pytest.approx([1 - 0.975**0.5, 0.975**0.5])
    assert figures["escapes"]["interval"] == pytest.approx([0.0, 1 - 0.025**0.5])
    assert figures["part_auroc"] == 1.0
    assert figures["frame_auroc"] > 0.95
    assert (figures["defects_found"]["count"], figures["defects_found"]["of"]) == (2, 2)
    assert figures["position_within_one_frame"]["share"] > 0.95
    assert figures["frames_missing"] == 0
    worst = evaluated.record["worst"]
    assert (worst["good"], sorted(worst["bad"])) == (["good-2", "good-1"], sorted(BAD))


def test_the_terminal_is_told_the_same(evaluated: Evaluated) -> None:
    assert re.search(r"OK +1 +0\n", evaluated.out)
    assert re.search(r"NG +0 +2\n", evaluated.out)
    assert re.search(r"INCOMPLETE +1 +0\n", evaluated.out)
    assert "1 of 2, 50.0 %   (95 %: 1.3 to 98.7 %)" in evaluated.out
    assert "lowest of the bad parts: bad-" in evaluated.out


def test_without_a_truth_what_it_tells_is_null_and_never_nothing(line: Line, tmp_path: Path, capsys: Captured) -> None:
    folder = a_set(tmp_path / "set", line, good=line.good, bad=line.spot)
    options = ("--appearance", line.file, "--json", tmp_path / "e.json", "--html", tmp_path / "e.html")
    code, out, err = told(capsys, folder, *options, "--false-rejects", 0.05)
    assert (code, err) == (0, "")
    assert "Frame AUROC" not in out
    found = json.loads((tmp_path / "e.json").read_text())
    unknown = ("frame_auroc", "defects_found", "clean_frames_flagged", "position_within_one_frame", "frames_missing")
    assert [found["figures"][name] for name in unknown] == [None] * 5
    assert found["figures"]["frames_not_scored"]["of"] > 100
    assert [part["truth"] for part in found["parts"]] == [None, None]
    assert (found["golden"], found["counts"]["with_truth"]) == ([], 0)
    assert found["policy"]["false_rejects"] == found["promise"]["target"] == 0.05
    assert "not known" in (tmp_path / "e.html").read_text()


def test_another_policy_is_compared_part_by_part(line: Line, tmp_path: Path, capsys: Captured) -> None:
    folder = a_set(tmp_path / "set", line, good=line.good, bad=line.spot)
    (tmp_path / "blind.json").write_text('{"sensitivity": 0.01}')
    options = ("--appearance", line.file, "--baseline", tmp_path / "blind.json", "--json", tmp_path / "e.json")
    code, out, _ = told(capsys, folder, *options, "--html", tmp_path / "e.html")
    assert code == 0
    found = json.loads((tmp_path / "e.json").read_text())["baseline"]
    assert found["changed"] == [{"name": "bad", "label": "bad", "before": "OK", "now": "NG", "turn": "better"}]
    escapes = found["differences"]["escapes"]
    assert (escapes["before"], escapes["now"], escapes["turn"], escapes["may_be_chance"]) == (1.0, 0.0, "better", True)
    assert found["differences"]["frame_auroc"]["turn"] is None
    assert (found["policy"]["sensitivity"], found["appearance_id"]) == (0.01, line.appearance.id)
    assert "better, but inside the confidence interval: may be chance" in out
    assert "bad: OK -> NG  better" in out
    assert "Against the baseline" in (tmp_path / "e.html").read_text()


def test_an_earlier_evaluation_is_a_baseline_and_a_recording_that_was_replaced_since_is_named(
    evaluated: Evaluated, line: Line, tmp_path: Path, capsys: Captured
) -> None:
    earlier = json.loads(json.dumps(evaluated.record))
    next(part for part in earlier["parts"] if part["name"] == "good-1")["recording"] = "sha256:other"
    (tmp_path / "earlier.json").write_text(json.dumps(earlier))
    options = ("--appearance", line.file, "--baseline", tmp_path / "earlier.json", "--json", tmp_path / "e.json")
    assert told(capsys, evaluated.folder, *options)[0] == 0
    found = json.loads((tmp_path / "e.json").read_text())["baseline"]
    assert (found["parts"], found["changed"], found["only_now"], found["only_before"]) == (4, [], [], [])
    assert found["other_recordings"] == ["good-1"]
    assert {each["turn"] for each in found["differences"].values()} == {"same"}


def test_an_appearance_is_a_baseline_too(line: Line, tmp_path: Path, capsys: Captured) -> None:
    folder = a_set(tmp_path / "set", line, good=line.good)
    code, out, _ = told(capsys, folder, "--appearance", line.file, "--baseline", line.file)
    assert code == 0
    assert "against plate.appearance (another appearance, the same policy), 1 parts:" in out
    assert "no part changed its verdict" in out


def test_a_recording_that_cannot_be_read_is_named_and_the_rest_goes_on(
    line: Line, tmp_path: Path, capsys: Captured
) -> None:
    folder = a_set(tmp_path / "set", line, good=line.good)
    (folder / "bad-1.mcap").write_text("no recording")
    options = ("--json", tmp_path / "e.json", "--html", tmp_path / "e.html", "--appearance", line.file)
    code, out, err = told(capsys, folder, *options)
    assert code == 1
    assert err.startswith("inspector: warning: bad-1 was not inspected: ")
    assert err.count("\n") == 1
    assert "not inspected, not counted: bad-1" in out
    found = json.loads((tmp_path / "e.json").read_text())
    assert [(each["name"], each["label"]) for each in found["failed"]] == [("bad-1", "bad")]
    assert (found["counts"]["good"], found["figures"]["escapes"]["share"]) == (1, None)
    assert "One recording could not be inspected" in (tmp_path / "e.html").read_text()


TRUTH = {"nominal_frames": 60, "frames": [{"index": 0, "s": 0.0, "commanded": 0.0, "defects": []}]}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "no truth: invalid JSON"),
        ("[]", "no truth: "),
        (json.dumps({"frames": []}), "nominal_frames is missing; a truth holds nominal_frames"),
        (json.dumps(TRUTH | {"nominal_frames": 1}), "nominal_frames is 1; it should be greater than or equal to 2"),
        (json.dumps(TRUTH).replace('"s": 0.0', '"s": NaN'), "frames.0.s is nan; it should be a finite number"),
        (json.dumps(TRUTH).replace("[]", '[{"id": 1, "box": [1, 2, 3], "inside": true}]'), "frames.0.defects.0.box.3"),
        (json.dumps(TRUTH | {"frames": 2 * TRUTH["frames"]}), "two frames have the same index"),
    ],
)
def test_a_bad_truth_is_told_in_a_line_before_the_work(
    line: Line, tmp_path: Path, capsys: Captured, content: str, said: str
) -> None:
    folder = a_set(tmp_path / "set", line, good=line.good)
    (folder / "good.truth.json").write_text(content)
    code, out, err = told(capsys, folder, "--appearance", line.file, "--json", tmp_path / "e.json")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert err.startswith(f"inspector: {folder / 'good.truth.json'}: {said}")
    assert not (tmp_path / "e.json").exists()


@pytest.mark.parametrize(
    ("options", "told_as"),
    [
        ((), (1, "no golden*.mcap to learn from; add one, or name what was learnt with --appearance")),
        (
            ("--appearance", "{file}", "--baseline", "{good}"),
            (1, "no baseline; allowed is an appearance, a policy, or"),
        ),
        (("--appearance", "{file}", "--baseline", "{tmp}/no"), (1, "no: No such file")),
        (("--appearance", "{file}", "--baseline", "{tmp}/other.json"), (1, "kind: it should be 'evaluation'")),
        (("--appearance", "{file}", "--baseline", "{tmp}/wrong.json"), (1, "coverage is 2; it should be less than")),
        (("--appearance", "{file}", "--json", "{tmp}/other.json"), (1, "other.json exists already")),
        (("--appearance", "{file}", "--html", "{tmp}/no/a.html"), (1, "there is no folder")),
        (("--appearance", "{file}", "--html", "{tmp}/a", "--json", "{tmp}/a"), (2, "allowed are two files")),
        (("--bogus",), (2, "--bogus")),
    ],
)
def test_what_is_wrong_is_told_in_a_line_before_the_work(
    line: Line, tmp_path: Path, capsys: Captured, options: tuple[str, ...], told_as: tuple[int, str]
) -> None:
    folder = a_set(tmp_path / "set", line, good=line.good)
    (tmp_path / "other.json").write_text('{"kind": "other", "version": 1}')
    (tmp_path / "wrong.json").write_text('{"coverage": 2}')
    before = sorted(tmp_path.rglob("*"))
    code, out, err = told(capsys, folder, *(o.format(file=line.file, good=line.good, tmp=tmp_path) for o in options))
    assert (code, out, err.count("\n")) == (told_as[0], "", 1)
    assert told_as[1] in err
    assert sorted(tmp_path.rglob("*")) == before


def test_a_folder_with_nothing_to_evaluate_is_refused(line: Line, tmp_path: Path, capsys: Captured) -> None:
    shutil.copy(line.golden[0], tmp_path / "golden.mcap")
    assert "neither good*.mcap nor bad*.mcap" in told(capsys, tmp_path)[2]
    assert "no such folder" in told(capsys, tmp_path / "no")[2]


class Reader(HTMLParser):
    """Checks that every element is closed where it should be, and keeps what the page refers to."""

    EMPTY = ("meta", "link", "img", "line", "circle", "path", "rect")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.names: set[str] = set()
        self.referred: list[str] = []
        self.told = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.add(tag)
        self.referred += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]
        assert not [name for name, _ in attrs if name.startswith("on")]
        if tag not in ("meta", "link", "img"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.told += data


def test_the_page_is_whole_and_asks_for_nothing_outside_of_it(evaluated: Evaluated) -> None:
    reader = Reader()
    reader.feed(evaluated.page)
    reader.close()
    assert reader.open == []
    assert reader.names >= {"html", "title", "main", "table", "svg", "img", "figure"}
    assert reader.names & {"script", "iframe", "object", "embed", "base", "i"} == set()
    assert all(each.startswith("data:") for each in reader.referred)
    assert re.findall(r"https?:|url\(|@import", evaluated.page) == []
    assert evaluated.page.count("data:image/jpeg;base64,") == 4
    for said in ("bad-<i>&", evaluated.record["appearance_id"], "golden-1.mcap, golden-2.mcap", "sensitivity"):
        assert said in reader.told
