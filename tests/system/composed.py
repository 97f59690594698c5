"""docker/compose.cluster.yaml for tests that start its services as processes: read, not repeated."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from tests.system.repository import ROOT

FILE = ROOT / "docker/compose.cluster.yaml"
GIVEN = {"POSTGRES_PASSWORD": "hunter2", "S3_SECRET": "hunter2-of-s3"}
"""By who starts it."""


@cache
def services() -> dict[str, dict[str, Any]]:
    """All of them, as they are written."""
    return yaml.safe_load(FILE.read_text())["services"]


def environment(service: str, here: Mapping[str, str]) -> dict[str, str]:
    """What the service finds in its environment, `here` instead of the names and ports that containers have."""
    found: dict[str, str] = services()[service]["environment"]
    return {name: _moved(value, here) for name, value in found.items()}


def mounted(service: str, place: str) -> Path:
    """The file of the repository that the service sees there."""
    (source,) = (each.split(":")[0] for each in services()[service]["volumes"] if f":{place}" in each)
    return FILE.parent / source


def _moved(text: str, here: Mapping[str, str]) -> str:
    text = re.sub(r"\$\{(\w+)[^}]*\}", lambda found: GIVEN[found[1]], text)
    for there, now in here.items():
        text = text.replace(there, now)
    return text
