"""The README's commands run as they stand; its first two blocks are what a newcomer and the CI call."""

from __future__ import annotations

import json
import shlex
import tomllib
from pathlib import Path

import pytest

from inspector.cli import run
from tests.system.repository import ROOT, blocks, texts

BLOCKS = blocks(texts()["README.md"])
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
