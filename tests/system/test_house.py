"""House rules: what every file says of itself, what no file may name, and that what is used is declared."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from dataclasses import fields
from importlib.metadata import packages_distributions
from pathlib import PurePath

import pytest

from inspector.cameras.simulated.settings import Settings
from inspector.cli import app
from models.verdict import Policy
from tests.system.repository import PACKAGES, ROOT, modules, texts

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
FOREIGN = [
    # Written so that this file does not name them itself.
    r"py" + r"pi\.org|python" + r"hosted|anaconda\.(org|com)|index" + r"-url|find" + r"-links",
    r"(?<![\w.])/(home|root|opt|work|Users|mnt)/",
    r"[A-Z]:\\\\",
]


def test_every_module_begins_with_what_it_is_for() -> None:
    silent = [name for name, tree in modules(*PACKAGES, "tests") if tree.body and not ast.get_docstring(tree)]
    assert silent == []


def test_every_public_name_of_the_packages_says_what_it_is() -> None:
    silent = [
        f"{name}: {node.name}"
        for name, tree in modules(*PACKAGES)
        for node in tree.body
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name[0] != "_" and not ast.get_docstring(node)
    ]
    assert silent == []


@pytest.mark.parametrize("pattern", FOREIGN)
def test_no_file_names_a_registry_or_a_machine(pattern: str) -> None:
    named = [f"{name}: {found[0]}" for name, text in texts().items() if (found := re.search(pattern, text))]
    assert named == []


def test_no_lock_file_holds_an_address() -> None:
    locks = [name for name in texts() if "lock" in PurePath(name).name or re.match(r"requirements.*\.txt", name)]
    assert [name for name in locks if "://" in texts()[name]] == []


def test_the_visible_top_level_is_as_agreed() -> None:
    agreed = {"pyproject.toml", *PACKAGES, "tests", "docker", "README.md", "LICENSE", "CHANGELOG.md"}
    assert {name.split("/")[0] for name in texts() if name[0] != "."} <= agreed


def test_what_the_packages_import_is_declared_and_nothing_else() -> None:
    imported = {
        module.split(".")[0]
        for _, tree in modules(*PACKAGES)
        for node in ast.walk(tree)
        for module in _imported(node)
    } - set(sys.stdlib_module_names) - set(PACKAGES)  # fmt: skip
    # A name may have several owners where more is installed than is needed: `google` is protobuf's, and others'.
    owners = {module: {_plain(owner) for owner in packages_distributions()[module]} for module in imported}
    declared = {_plain(re.split(r"[<>=\[;]", each)[0]) for each in PROJECT["dependencies"]}
    assert {module for module in imported if not owners[module] & declared} == set()
    assert declared - set[str]().union(*owners.values()) == set()


def _imported(node: ast.AST) -> list[str]:
    match node:
        case ast.Import():
            return [name.name for name in node.names]
        case ast.ImportFrom(module=str(module), level=0):
            return [module]
        case _:
            return []


def _plain(name: str) -> str:
    return name.strip().lower().replace("_", "-")


def test_every_command_is_explained_in_the_readme() -> None:
    readme = texts()["README.md"]
    for command in app.registered_commands:
        assert command.callback is not None
        assert f"`inspector {command.callback.__name__}`" in readme


def test_every_field_of_a_policy_is_explained() -> None:
    page = texts()["inspector/README.md"]
    assert [field.name for field in fields(Policy) if f"| `{field.name}` | {field.default:g} |" not in page] == []


def test_every_option_of_the_simulated_camera_is_explained() -> None:
    page = texts()["inspector/cameras/README.md"]
    assert [field.name for field in fields(Settings) if f"`{field.name}`" not in page] == []


def test_the_changelog_knows_this_version() -> None:
    assert f"## {PROJECT['version']}" in texts()["CHANGELOG.md"]
