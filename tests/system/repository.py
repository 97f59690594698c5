"""What is in the repository, for the tests of its house rules."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("models", "inspector", "api")


@cache
def texts() -> dict[str, str]:
    """Every text file that git keeps, or would keep, by its path; without git, those where there should be some."""
    command = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")
    except (OSError, subprocess.CalledProcessError):
        found = [*ROOT.glob("*"), *(path for folder in (*PACKAGES, "tests") for path in (ROOT / folder).rglob("*"))]
        listed = [str(path.relative_to(ROOT)) for path in found]
    return {name: text for name in listed if name and (text := _text(ROOT / name)) is not None}


def _text(path: Path) -> str | None:
    if not path.is_file():
        return None
    try:
        return path.read_text("utf-8")
    except UnicodeDecodeError:
        return None


def modules(*folders: str) -> Iterator[tuple[str, ast.Module]]:
    """The Python files under the folders, parsed."""
    for name, text in texts().items():
        if name.endswith(".py") and name.split("/")[0] in folders:
            yield name, ast.parse(text, name)


def blocks(markdown: str) -> list[str]:
    """The `sh` blocks of a document, in order."""
    return [block.strip() for block in re.findall(r"^```sh\n(.*?)^```$", markdown, re.MULTILINE | re.DOTALL)]
