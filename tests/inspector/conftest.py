"""What the tests of learning and inspecting share: golden sweeps, the appearance learnt from them, two parts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from inspector.learner import learn_recordings
from models.appearance import Appearance
from tests.inspector.line import SPOT, recorded


@dataclass(frozen=True)
class Line:
    """Files that no test writes to."""

    golden: tuple[Path, Path]
    good: Path
    spot: Path
    """A part with a spot at s = 0.5."""
    file: Path
    """The appearance."""
    appearance: Appearance


@pytest.fixture(scope="session")
def line(tmp_path_factory: pytest.TempPathFactory) -> Line:
    folder = tmp_path_factory.mktemp("line")
    golden = (
        recorded(folder / "golden-1.mcap", "unit=1&seed=11"),
        recorded(folder / "golden-2.mcap", "unit=2&seed=12&pace=0.1&place=1,-1,0.1"),
    )
    good = recorded(folder / "good.mcap", "unit=3&seed=13&pace=0.1&lost=0.05", product_id="plate", part_id="0003")
    spot = recorded(folder / "spot.mcap", SPOT)
    file = folder / "plate.appearance"
    return Line(golden, good, spot, file, learn_recordings(golden, file))
