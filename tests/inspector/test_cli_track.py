"""`inspector track`: a recording frame by frame, the simulated loop, and what is wrong told in a line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.cameras.simulated.canvas import HEIGHT, WIDTH
from inspector.cameras.simulated.render import Pose
from inspector.cli import run
from inspector.following import learn_displacements
from inspector.recording import SweepWriter

Captured = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a workspace, and a recording of a part that moves under a fixed camera, covered for a while."""
    folder = tmp_path_factory.mktemp("moved")
    camera = open_camera("simulated:?size=160x120")
    assert isinstance(camera, SimulatedCamera)
    (folder / "part.workspace").write_bytes(learn_displacements(camera).to_bytes())
    with SweepWriter(folder / "moving.mcap") as writer:
        for n in range(20):
            writer.write(camera.look(Pose(WIDTH / 2 + 10 - 2 * n, HEIGHT / 2), n, covered=8 <= n < 12))
    return folder


def told(capsys: Captured, *arguments: object) -> tuple[int, str, str]:
    code = run([str(argument) for argument in arguments])
    return code, *capsys.readouterr()


def test_a_recording_is_tracked_and_every_frame_is_kept(moved: Path, tmp_path: Path, capsys: Captured) -> None:
    out = tmp_path / "tracked.jsonl"
    code, said, err = told(
        capsys, "track", moved / "moving.mcap", "--workspace", moved / "part.workspace", "--json", out
    )
    assert (code, err) == (0, "")
    lines = said.splitlines()
    assert lines[0].startswith("frame 0: part is found, x_px -")
    assert lines[1] == "frame 8: part is lost"
    assert lines[2].startswith("frame 12: part is found again, x_px ")
    assert lines[3:] == [f"{moved / 'moving.mcap'}: found in 16 of 20 frames, lost once, for 4 frames at the longest"]
    records = [json.loads(line) for line in out.read_text().splitlines()]
    assert [record["sequence"] for record in records] == list(range(20))
    assert [record["tracking"] for record in records[7:13]] == ["tracking", *["lost"] * 4, "recovered"]
    assert records[-1]["place"]["x_px"] == pytest.approx((2 * 19 - 10) / 2, abs=0.3)
    assert records[-1]["velocity"]["x_px"] == pytest.approx(30, abs=6)


def test_lines_go_to_stdout_for_programs(moved: Path, capsys: Captured) -> None:
    options = ("--workspace", moved / "part.workspace", "--json", "-", "--frames", 3)
    code, said, err = told(capsys, "track", moved / "moving.mcap", *options)
    assert code == 0
    assert [json.loads(line)["sequence"] for line in said.splitlines()] == [0, 1, 2]
    assert err.endswith("found in 3 of 3 frames, never lost\n")


def test_the_simulated_loop_says_how_it_went(capsys: Captured) -> None:
    code, said, err = told(capsys, "track", "--simulate", "path", "--frames", 40, "--cover", "20:24")
    assert (code, err) == (0, "")
    assert "frame 20: part is lost" in said
    assert "found in 36 of 40 frames, lost once, for 4 frames at the longest" in said
    assert "reaches in the mean" in said


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        ([], 2, "either --workspace with a SOURCE, or --simulate"),
        (["x.mcap", "--workspace", "w", "--simulate", "circle"], 2, "either --workspace"),
        (["--workspace", "w"], 2, "--workspace needs a SOURCE"),
        (["--simulate", "square"], 2, "'square' is not allowed; allowed is circle or path"),
        (["--simulate", "circle", "--speed", "-1"], 2, "above 0"),
        (["--simulate", "circle", "--cover", "9:3"], 2, "allowed is FROM:TO"),
        (["folder:x", "--simulate", "circle"], 1, "x"),
        (["missing.mcap", "--workspace", "missing.workspace"], 1, "missing.workspace: No such file"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(arguments: list[str], code: int, sentence: str, capsys: Captured) -> None:
    told_code, said, err = told(capsys, "track", *arguments)
    assert (told_code, said, err.count("\n")) == (code, "", 1)
    assert sentence in err


def test_a_recording_of_another_size_is_refused_and_nothing_is_written(
    moved: Path, tmp_path: Path, capsys: Captured
) -> None:
    other, out = tmp_path / "other.mcap", tmp_path / "out.jsonl"
    assert told(capsys, "record", "--camera", "simulated:?frames=2", "--out", other)[0] == 0
    code, _, err = told(capsys, "track", other, "--workspace", moved / "part.workspace", "--json", out)
    assert code == 1
    assert err.startswith("inspector: frame 0: ")
    assert list(tmp_path.iterdir()) == [other]
