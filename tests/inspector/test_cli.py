"""The command line: results on stdout, the rest on stderr, exit codes, one-line errors, nothing lost."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inspector import cameras
from inspector.batch import tasks as batch_tasks
from inspector.cameras import open_camera
from inspector.cameras.base import AbstractCamera, Clock
from inspector.cli import app, run
from inspector.cli.demo import free_name
from inspector.learner import load_appearance
from inspector.objects import Objects, beneath
from inspector.pictures import encode_png
from inspector.recording import SweepReader, count_frames
from models.frame import Frame
from tests.buckets import Buckets
from tests.inspector.conftest import Line
from tests.inspector.line import SPOT, cut, recorded, url

Captured = pytest.CaptureFixture[str]
COMMANDS = (
    *("record", "learn", "replay", "batch", "evaluate", "detectability", "demo", "serve", "push", "locate"),
    "track",
)


def told(capsys: Captured, *arguments: object) -> tuple[int, str, str]:
    """Exit code, stdout, stderr."""
    code = run([str(argument) for argument in arguments])
    return code, *capsys.readouterr()


def test_the_whole_walk_from_camera_to_verdict(tmp_path: Path, capsys: Captured) -> None:
    golden, part, learnt = tmp_path / "golden.mcap", tmp_path / "part.mcap", tmp_path / "plate.appearance"
    code, out, err = told(capsys, "record", "--camera", url("unit=1"), "--out", golden, "--product", "plate")
    assert (code, err) == (0, "")
    assert re.fullmatch(rf"\S*golden\.mcap: {count_frames(golden)} frames, \d\.\d s, \d\.\d MB\n", out)
    assert told(capsys, "record", "--camera", url(SPOT), "--out", part, "--part", "7", "--product", "plate")[0] == 0
    code, out, err = told(capsys, "learn", golden, "--out", learnt)
    assert (code, err) == (0, "")
    appearance_id = out.splitlines()[-1]
    result, scored, strips = tmp_path / "r.json", tmp_path / "s.mcap", tmp_path / "strips"
    options = ("--json", result, "--mcap", scored, "--filmstrip", strips)
    code, out, err = told(capsys, "replay", part, "--appearance", learnt, *options)
    assert (code, err) == (0, "")
    record = json.loads(result.read_text())
    assert out.splitlines()[0] == f"{part}: NG"
    assert record["digest"] in out
    assert (record["product_id"], record["part_id"], record["verdict"]) == ("plate", "7", "NG")
    assert (record["appearance_id"], record["is_simulated"]) == (appearance_id, True)
    assert count_frames(scored) == len(record["frames"]) == count_frames(part)
    assert len(list(strips.iterdir())) == len(record["deviations"]) > 0


def test_fail_on_ng_is_3_for_a_bad_part_and_0_for_a_good_one(line: Line, capsys: Captured) -> None:
    for path, code in ((line.good, 0), (line.spot, 3)):
        assert told(capsys, "replay", path, "--appearance", line.file, "--fail-on-ng")[0] == code
        assert told(capsys, "replay", path, "--appearance", line.file)[0] == 0


def test_a_policy_changes_the_verdict_without_learning_again(line: Line, tmp_path: Path, capsys: Captured) -> None:
    (tmp_path / "p.json").write_text('{"sensitivity": 0.01}')
    _, out, _ = told(capsys, "replay", line.spot, "--appearance", line.file, "--policy", tmp_path / "p.json")
    assert out.splitlines()[0].endswith(": OK")


def test_the_false_reject_target_is_asked_for_over_the_policy_file_and_moves_every_score(
    line: Line, tmp_path: Path, capsys: Captured
) -> None:
    (tmp_path / "p.json").write_text('{"false_rejects": 0.001, "review_margin": 0.0}')
    records: list[dict[str, Any]] = []
    for name, options in (("policy", ()), ("over", ("--false-rejects", 0.05))):
        out = tmp_path / f"{name}.json"
        told(
            capsys,
            "replay",
            line.spot,
            "--appearance",
            line.file,
            "--policy",
            tmp_path / "p.json",
            "--json",
            out,
            *options,
        )
        records.append(json.loads(out.read_text()))
    strict, loose = (record["promise"] for record in records)
    assert (strict["target"], loose["target"]) == (0.001, 0.05)
    assert strict["factor"] > 1.3 * loose["factor"]
    highest = [max(frame["score"] for frame in record["frames"]) for record in records]
    assert highest[1] == pytest.approx(highest[0] * strict["factor"] / loose["factor"], rel=1e-3)
    assert records[0]["digest"] != records[1]["digest"]


def test_learning_says_what_the_golden_sweeps_can_promise(line: Line, tmp_path: Path, capsys: Captured) -> None:
    _, out, _ = told(capsys, "learn", line.golden[0], "--out", tmp_path / "a")
    assert out.splitlines()[1].startswith(
        "  one golden sweep: limit at 1.00 of the assumed tolerance; 2 % false rejects"
    )


def test_a_mask_is_read_and_kept(line: Line, tmp_path: Path, capsys: Captured) -> None:
    mask = np.zeros((120, 160), np.uint8)
    mask[:30, 40:] = 255
    (tmp_path / "mask.png").write_bytes(encode_png(mask).data)
    code, _, err = told(capsys, "learn", line.golden[0], "--ignore", tmp_path / "mask.png", "--out", tmp_path / "a")
    assert (code, err) == (0, "")
    ignore = load_appearance(tmp_path / "a").preparation.ignore
    assert ignore is not None
    np.testing.assert_array_equal(ignore, mask > 0)
    (tmp_path / "small.png").write_bytes(encode_png(mask[::2, ::2]).data)
    code, out, err = told(capsys, "learn", line.golden[0], "--ignore", tmp_path / "small.png", "--out", tmp_path / "b")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "the don't-care mask is 80x60, the picture 160x120" in err
    assert not (tmp_path / "b").exists()


def test_a_good_part_is_added_to_what_was_learnt(line: Line, tmp_path: Path, capsys: Captured) -> None:
    new = tmp_path / "new.appearance"
    code, out, err = told(capsys, "learn", "--add", line.good, "--to", line.file, "--out", new)
    assert (code, err) == (0, "")
    assert re.match(rf"{new}: \d+ places of 160x120 pixels, from 3 golden sweeps\n  3 golden sweeps: limit at", out)
    assert out.splitlines()[-1] != line.appearance.id
    assert told(capsys, "replay", line.spot, "--appearance", new, "--fail-on-ng")[0] == 3


def test_a_defective_sweep_among_golden_ones_is_a_warning(line: Line, tmp_path: Path, capsys: Captured) -> None:
    code, out, err = told(capsys, "learn", *line.golden, line.spot, line.good, "--out", tmp_path / "a")
    assert (code, "from 3 golden sweeps" in out, err.count("\n")) == (0, True, 1)
    assert err.startswith(f"inspector: warning: {line.spot}: left out: it reaches ")


def test_losses_are_warnings_and_the_results_stay_on_stdout(line: Line, tmp_path: Path, capsys: Captured) -> None:
    short = cut(line.golden[1], tmp_path / "short.mcap", 0.8)
    code, out, err = told(capsys, "learn", line.golden[0], short, "--out", tmp_path / "a")
    assert (code, err.startswith(f"inspector: warning: {short}: ")) == (0, True)
    code, out, err = told(capsys, "replay", short, "--appearance", line.file)
    assert (code, err.startswith(f"inspector: warning: {short}: ")) == (0, True)
    assert out.startswith(f"{short}: INCOMPLETE\n")


REFUSED = {
    "no command": (["bogus"], 2, "'bogus'"),
    "no camera named": (["record", "--out", "{tmp}/a"], 2, "'--camera'"),
    "no frames": (["record", "--camera", "{url}", "--out", "{tmp}/a", "--frames", "0"], 2, "'0' is not allowed"),
    "no duration": (["record", "--camera", "{url}", "--out", "{tmp}/a", "--seconds", "-1"], 2, "'-1' is not allowed"),
    "no target": (
        ["replay", "{good}", "--appearance", "{file}", "--false-rejects", "0.6"],
        2,
        "0.6' is not allowed; allowed is a share of the good parts from 0.0001 to 0.5",
    ),
    "no option": (["replay", "{good}", "--appearance", "{file}", "--bogus"], 2, "--bogus"),
    "a camera": (["record", "--camera", "bogus:", "--out", "{tmp}/a"], 1, "known are simulated, folder, opencv"),
    "a folder": (["record", "--camera", "{url}", "--out", "{tmp}/no/a"], 1, "/no/a cannot be written"),
    "a file to record": (["record", "--camera", "{url}", "--out", "{good}"], 1, "exists already"),
    "a recording": (["learn", "{tmp}/no.mcap", "--out", "{tmp}/a"], 1, "no.mcap: No such file"),
    "a file to learn": (["learn", "{good}", "--out", "{file}"], 1, "exists already"),
    "a file to add to": (["learn", "--add", "{good}", "--to", "{tmp}/no", "--out", "{tmp}/a"], 1, "/no: No such file"),
    "a file added to": (["learn", "--add", "{good}", "--to", "{file}", "--out", "{file}"], 1, "exists already"),
    "nothing to add to": (["learn", "--add", "{good}", "--out", "{tmp}/a"], 2, "--add and --to belong together"),
    "nothing to add": (["learn", "{good}", "--to", "{file}", "--out", "{tmp}/a"], 2, "--add and --to belong together"),
    "a mask": (["learn", "{good}", "--ignore", "{tmp}/no.png", "--out", "{tmp}/a"], 1, "no.png: No such file"),
    "no mask": (["learn", "{good}", "--ignore", "{good}", "--out", "{tmp}/a"], 1, "good.mcap: nameless picture"),
    "a mask to add": (
        ["learn", "--add", "{good}", "--to", "{file}", "--ignore", "{good}", "--out", "{tmp}/a"],
        2,
        "--ignore goes not with --add",
    ),
    "workers to add": (
        ["learn", "--add", "{good}", "--to", "{file}", "--executor", "processes", "--out", "{tmp}/a"],
        2,
        "--executor processes goes not with --add",
    ),
    "an executor": (["learn", "{good}", "--executor", "bogus", "--out", "{tmp}/a"], 1, "'bogus' is no executor"),
    "an appearance": (["replay", "{good}", "--appearance", "{good}"], 1, "good.mcap: not an appearance"),
    "a sweep": (["replay", "{file}", "--appearance", "{file}"], 1, "no MCAP"),
    "a topic": (["replay", "{good}", "--appearance", "{file}", "--topic", "/x"], 1, "allowed is /camera/image"),
    "a result": (["replay", "{good}", "--appearance", "{file}", "--json", "{file}"], 1, "exists already"),
    "a scored file": (["replay", "{good}", "--appearance", "{file}", "--mcap", "{file}"], 1, "exists already"),
    "a policy": (["replay", "{good}", "--appearance", "{file}", "--policy", "{tmp}/no.json"], 1, "no.json: No such"),
    "a demo": (["demo", "--data", "{tmp}"], 1, "exists already"),
    "a part": (["demo", "--part", "bogus", "--data", "{tmp}/a"], 1, "part='bogus' is not allowed"),
}


@pytest.mark.parametrize("wrong", REFUSED)
def test_what_is_wrong_is_told_in_a_line_and_nothing_is_written(
    line: Line, tmp_path: Path, capsys: Captured, wrong: str
) -> None:
    arguments, expected, said = REFUSED[wrong]
    known = {"tmp": tmp_path, "url": url(""), "good": line.good, "file": line.file}
    code, out, err = told(capsys, *(argument.format(**known) for argument in arguments))
    assert (code, out, err.count("\n")) == (expected, "", 1)
    assert err.startswith("inspector: ")
    assert said in err
    assert list(tmp_path.iterdir()) == []


def test_a_strip_in_the_way_is_told_before_the_work(line: Line, tmp_path: Path, capsys: Captured) -> None:
    (tmp_path / "spot-1.png").touch()
    options = ("--filmstrip", tmp_path, "--json", tmp_path / "r.json")
    code, out, err = told(capsys, "replay", line.spot, "--appearance", line.file, *options)
    assert (code, out) == (1, "")
    assert "spot-1.png exists already" in err
    assert not (tmp_path / "r.json").exists()


class Interrupting(AbstractCamera):
    """A camera without an end, at whose sixth frame somebody presses Ctrl-C `place` times."""

    def __init__(self, times: int) -> None:
        self._times = times

    @classmethod
    def open(cls, place: str, query: dict[str, str], clock: Clock) -> Interrupting:
        return cls(int(place))

    def frames(self) -> Iterator[Frame]:
        with open_camera(url("frames=500")) as camera:
            for frame in camera.frames():
                if frame.sequence == 5:
                    for _ in range(self._times):
                        signal.raise_signal(signal.SIGINT)
                yield frame

    def describe(self) -> dict[str, str]:
        return {}

    def close(self) -> None:
        pass


@pytest.mark.parametrize(("times", "code"), [(1, 0), (2, 130)])
def test_an_interrupt_ends_the_recording_and_closes_it_properly(
    tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch, times: int, code: int
) -> None:
    monkeypatch.setitem(cameras.CAMERAS, "interrupting", f"{__name__}:Interrupting")
    before = signal.getsignal(signal.SIGINT)
    assert told(capsys, "record", "--camera", f"interrupting:{times}", "--out", tmp_path / "a.mcap")[0] == code
    assert signal.getsignal(signal.SIGINT) is before
    reader = SweepReader(tmp_path / "a.mcap")
    assert len(list(reader)) == count_frames(tmp_path / "a.mcap") == 5
    assert reader.losses == ()


def test_another_part_is_named_where_it_is_known(line: Line, tmp_path: Path, capsys: Captured) -> None:
    golden, part = (recorded(tmp_path / f"{unit}.mcap", f"part=casting&unit={unit}&seed={unit}") for unit in (1, 3))
    assert told(capsys, "learn", golden, "--out", tmp_path / "lid.appearance")[0] == 0
    options = ["replay", part, "--appearance", line.file]
    for other, said in (
        ([], "another part, the wrong way round"),
        (["--other", tmp_path / "lid.appearance"], "another part: lid fits better"),
        (["--other", f"cover={tmp_path / 'lid.appearance'}"], "another part: cover fits better"),
    ):
        _, out, _ = told(capsys, *options, *other)
        assert "INVALID" in out
        assert said in out
    twice = ["--other", tmp_path / "lid.appearance"] * 2
    code, _, err = told(capsys, *options, *twice)
    assert (code, "'lid' names two parts" in err) == (2, True)
    code, _, err = told(capsys, *options, "--other", tmp_path / "no.appearance")
    assert (code, "no.appearance: No such file" in err) == (1, True)


def test_an_interrupt_elsewhere_is_130_and_leaves_nothing(
    line: Line, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("inspector.replay.conclude", interrupted)
    code, out, err = told(
        capsys, "replay", line.good, "--appearance", line.file, "--mcap", tmp_path / "a", "--json", tmp_path / "b"
    )
    assert (code, out, err) == (130, "", "")
    assert list(tmp_path.iterdir()) == []


def test_a_batch_names_what_it_cannot_read_and_goes_on_where_it_was(
    line: Line, tmp_path: Path, capsys: Captured
) -> None:
    folder = tmp_path / "parts"
    folder.mkdir()
    (folder / "good.mcap").write_bytes(line.good.read_bytes())
    (folder / "none.mcap").write_bytes(b"no recording")
    asked = ("batch", folder, "--appearance", line.file, "--out", tmp_path / "out", "--executor", "serial")
    code, out, err = told(capsys, *asked)
    assert (code, out.splitlines()[0]) == (1, "1 recording inspected: 1 OK; 1 could not be")
    assert err.startswith("inspector: warning: none: ")
    (folder / "none.mcap").unlink()
    code, out, err = told(capsys, *asked)
    assert (code, out.splitlines()[0], err) == (0, "1 recording inspected, 1 of them before: 1 OK", "")
    assert told(capsys, *asked, "--fail-on-ng")[0] == 0
    (folder / "spot.mcap").write_bytes(line.spot.read_bytes())
    assert told(capsys, *asked, "--fail-on-ng")[0] == 3
    assert told(capsys, *asked)[0] == 0


def test_an_interrupted_batch_says_how_far_it_came_and_goes_on(
    line: Line, tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ("batch", line.good, line.spot, "--appearance", line.file, "--out", tmp_path, "--executor", "serial")
    replayed, calls = batch_tasks.replay, list[int]()

    def interrupted(*arguments: Any) -> Any:
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return replayed(*arguments)

    monkeypatch.setattr(batch_tasks, "replay", interrupted)
    code, out, err = told(capsys, *asked)
    assert (code, out) == (130, "")
    assert err == (
        "inspector: warning: interrupted: 1 of 2 recordings are inspected; the same command goes on with the rest\n"
    )
    assert told(capsys, *asked)[1].startswith("2 recordings inspected, 1 of them before: 1 OK, 1 NG\n")


def test_recordings_are_learnt_and_inspected_by_url(
    line: Line, tmp_path: Path, capsys: Captured, buckets: Buckets
) -> None:
    bucket = buckets.new()
    for path in (*line.golden, line.good, line.spot):
        Objects(bucket).put_new(f"parts/{path.name}", path)
    golden = [beneath(bucket, f"parts/{path.name}") for path in line.golden]
    new, out = tmp_path / "a", tmp_path / "out"
    assert told(capsys, "learn", *golden, "--out", new)[1].splitlines()[-1] == line.appearance.id
    Objects(bucket).put_new("line.appearance", new)
    spot, learnt = beneath(bucket, "parts/spot.mcap"), beneath(bucket, "line.appearance")
    code, said, err = told(capsys, "replay", spot, "--appearance", learnt, "--fail-on-ng")
    assert (code, err) == (3, "")
    assert said.startswith(f"{bucket.partition('?')[0]}/parts/spot.mcap: NG\n")
    asked = ("batch", beneath(bucket, "parts"), "--appearance", learnt, "--out", out, "--executor", "serial")
    assert told(capsys, *asked)[1].startswith("4 recordings inspected: 3 OK, 1 NG\n")
    assert sorted(path.stem for path in (out / "results").iterdir()) == ["golden-1", "golden-2", "good", "spot"]
    code, said, err = told(capsys, "batch", beneath(bucket, "nothing"), "--appearance", learnt, "--out", out)
    assert (code, said, err.count("\n")) == (1, "", 1)
    assert "nothing; allowed are MCAP files" in err


@pytest.mark.parametrize("command", [*COMMANDS, "workspace learn"])
def test_every_command_has_help_with_an_example(command: str, capsys: Captured) -> None:
    code, out, err = told(capsys, *command.split(), "--help")
    assert (code, err) == (0, "")
    assert f"Example: inspector {command}" in out


def test_every_command_is_listed_and_tested(capsys: Captured) -> None:
    assert tuple(command.callback.__name__ for command in app.registered_commands if command.callback) == COMMANDS
    code, out, err = told(capsys)
    assert (code, out) == (2, "")
    assert all(f"  {command} " in err for command in COMMANDS)


def test_help_does_not_wait_for_numbers_and_pictures() -> None:
    script = "import sys, inspector.cli; print(sorted({'numpy', 'cv2', 'pydantic', 'rich'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_the_installed_command_tells_its_version_and_fails_without_a_traceback(tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("inspector")
    version = subprocess.run([command, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.count(".") == 2
    wrong = subprocess.run(
        [command, "learn", tmp_path, "--out", tmp_path / "a"], capture_output=True, text=True, check=False
    )
    assert (wrong.returncode, wrong.stdout, wrong.stderr.count("\n")) == (1, "", 1)


def test_a_demo_can_be_run_again_and_again(tmp_path: Path) -> None:
    names = []
    for _ in range(3):
        path = free_name(tmp_path / "demo")
        path.mkdir()
        names.append(path.name)
    assert names == ["demo", "demo-2", "demo-3"]
