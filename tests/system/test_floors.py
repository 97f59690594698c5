"""The floors hold: imports run down only, and each foreign library is known to one room."""

from __future__ import annotations

import tomllib

import pytest
from importlinter.cli import lint_imports

from tests.system.repository import ROOT


def test_every_contract_of_the_house_is_kept(capsys: pytest.CaptureFixture[str]) -> None:
    assert lint_imports(config_filename=str(ROOT / "pyproject.toml"), cache_dir=None, no_cache=True) == 0
    assert "0 broken" in capsys.readouterr().out


def test_a_broken_contract_would_be_seen(
    capsys: pytest.CaptureFixture[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    upside_down = tmp_path_factory.mktemp("floors") / "importlinter.toml"
    text = (ROOT / "pyproject.toml").read_text()
    rules = tomllib.loads(text)["tool"]["importlinter"]
    assert rules["contracts"][0]["layers"] == ["api", "inspector", "models"]
    upside_down.write_text(text.replace('["api", "inspector", "models"]', '["api", "models", "inspector"]'))
    assert lint_imports(config_filename=str(upside_down), no_cache=True) == 1
    assert "1 broken" in capsys.readouterr().out
