"""The README's commands run as they stand; its first two blocks are what a newcomer and the CI call."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tomllib
from contextlib import suppress
from pathlib import Path

import pytest

from inspector.cli import run
from inspector.learner import learn_recordings
from inspector.recording import SweepReader
from inspector.replay import replay
from tests.inspector.line import SPOT, recorded
from tests.system.repository import ROOT, blocks, texts

BEFORE, AFTER = texts()["README.md"].split("\n## As a service\n")
SERVICE, PLACES = AFTER.split("\n## Where is it, which is it\n")
BLOCKS = blocks(BEFORE)
WALK = [
    line for block in BLOCKS[2:] for line in block.replace("\\\n", " ").splitlines() if line.startswith("inspector ")
]


def test_the_first_two_blocks_are_one_command_each() -> None:
    demo, tests = BLOCKS[:2]
    for block in (demo, tests):
        assert len(block.splitlines()) == 1
        assert block.startswith("python3 -m venv .venv && .venv/bin/pip install ")
    assert demo.endswith(" && .venv/bin/inspector demo")
    assert ".venv/bin/python -m pytest" in tests


def test_the_second_installs_what_the_tests_need() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert ".[test]" in BLOCKS[1]
    assert {name.split(">")[0] for name in extras["test"]} >= {"pytest", "pytest-xdist", "hypothesis", "import-linter"}


def test_the_walk_runs_as_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    commands = [shlex.split(line)[1:] for line in WALK]
    assert [command[0] for command in commands[:4]] == ["record", "record", "learn", "record"]
    for command in commands:
        code = run(command)
        out, err = capsys.readouterr()
        assert (code, err) == (0, ""), (command, out)
    verdicts = {path.name: json.loads(path.read_text())["verdict"] for path in tmp_path.glob("*.json")}
    assert set(verdicts.values()) == {"NG"}


@pytest.mark.skipif(shutil.which("curl") is None, reason="the README asks with curl")
def test_the_round_with_the_service_runs_as_it_is_written(tmp_path: Path, port: int) -> None:
    for name, options in (("golden-1", "unit=1&seed=11"), ("golden-2", "unit=2&seed=12&place=1,-1,0.1")):
        recorded(tmp_path / f"{name}.mcap", options)
    recorded(tmp_path / "part-0007.mcap", SPOT)
    script = "\n".join(blocks(SERVICE))
    assert script.count(":8000") == 1
    process = subprocess.Popen(
        ["bash", "-euo", "pipefail", "-c", script.replace(":8000", f":{port}")],
        cwd=tmp_path,
        env=_newcomer(tmp_path / "bin") | {"INSPECTOR_PORT": str(port), "INSPECTOR_SCORERS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        out, err = process.communicate(timeout=600)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 0, err
    appearance = learn_recordings([tmp_path / "golden-1.mcap", tmp_path / "golden-2.mcap"], tmp_path / "a.appearance")
    offline = replay(SweepReader(tmp_path / "part-0007.mcap"), appearance).result
    posted = json.loads((tmp_path / "part-0007-live.json").read_text())
    assert (posted["verdict"], posted["appearance_id"]) == ("NG", appearance.id)
    assert posted["digest"] == offline.digest
    assert "\nNG\n{" in out
    assert "part-0007.mcap: NG\n" in out
    assert f"  digest {offline.digest}\n" in out
    scored = [json.loads(line) for line in (tmp_path / "scores.jsonl").read_text().splitlines()]
    assert [each["index"] for each in scored] == list(range(len(offline.frames)))
    recorded_there = replay(SweepReader(tmp_path / "part-0007-scored.mcap"), appearance)
    assert (recorded_there.result.digest, recorded_there.losses) == (offline.digest, ())


def test_what_is_said_of_places_runs_as_it_is_written(tmp_path: Path) -> None:
    script = "\n".join(blocks(PLACES))
    command = ["bash", "-euo", "pipefail", "-c", script]
    subprocess.run(command, cwd=tmp_path, env=_newcomer(tmp_path / "bin"), capture_output=True, text=True, check=True)
    (located,) = json.loads((tmp_path / "places/located.json").read_text())
    assert (located["object"], located["state"]) == ("plate", "known")
    assert located["q"] == pytest.approx({"x_px": 4.2, "y_px": -7.5}, abs=0.15)


def _newcomer(folder: Path) -> dict[str, str]:
    """The environment of somebody who has the commands on the path, and asks their own computer without a proxy."""
    folder.mkdir()
    main = "from inspector.cli import main; main()"
    for name, how in (("python3", '"$@"'), ("inspector", f"-c '{main}' \"$@\"")):
        (folder / name).write_text(f"#!/bin/sh\nexec '{sys.executable}' {how}\n")
        (folder / name).chmod(0o755)
    path = {"PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return {name: value for name, value in os.environ.items() if "proxy" not in name.lower()} | path
