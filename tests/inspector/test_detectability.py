"""`inspector detectability`: a small part in words, as data, as a picture; what is wrong is told in a line."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from inspector.cameras import open_camera
from inspector.cli import run
from inspector.detectability_chart import picture
from inspector.detectability_report import detectability_record, sentences
from inspector.learner import learn_recordings, load_appearance
from inspector.prober import probe_recordings
from inspector.recorder import record
from models.defects import Kind
from models.detectability import Detectability
from models.sites import sites, way
from tests.models.test_detectability import made

Captured = pytest.CaptureFixture[str]
TINY = "simulated:?size=96x72&path=line&frames=24"


@pytest.fixture(scope="module")
def golden(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tiny") / "golden.mcap"
    with open_camera(f"{TINY}&unit=1&seed=1") as camera:
        record(camera, path, lossless=True)
    return path


@pytest.fixture(scope="module")
def learnt(golden: Path) -> Path:
    learn_recordings([golden], golden.parent / "tiny.appearance")
    return golden.parent / "tiny.appearance"


def test_the_walk_from_an_appearance_to_a_map(learnt: Path, golden: Path, tmp_path: Path, capsys: Captured) -> None:
    data, image = tmp_path / "map.json", tmp_path / "map.png"
    chosen = ("--kind", "spot", "--kind", "added", "--contrast", "100", "--golden", golden)
    code = run([str(each) for each in ("detectability", learnt, "--json", data, "--png", image, *chosen)])
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == f"{learnt}: smallest defects that are caught, put into one golden recording"
    assert out.splitlines()[1].startswith("  spot, 100 grey levels: ")
    told = json.loads(data.read_text())
    assert told["appearance_id"] == load_appearance(learnt).id
    assert (told["kinds"], told["contrasts"], told["recordings"]) == (["spot", "added material"], [100.0], 1)
    sizes = [site["smallest"][0][0] for site in told["sites"] if not site["rim"]]
    assert len(sizes) > 10
    assert np.mean([size != "none" and size <= 9 for size in sizes]) > 0.8
    assert len(told["along"]) == len(told["over_picture"]) == 2
    shown = cv2.imread(str(image))
    assert shown is not None
    assert shown.shape[1] == 1400


def by_hand(learnt: Path, smallest: float) -> Detectability:
    """A map that nothing was tried for: every spot needs the same size."""
    appearance = load_appearance(learnt)
    spacing = appearance.size[0] / 7
    found = sites(appearance, spacing)
    sizes = np.full((1, 1, len(found)), smallest)
    at, local = way(appearance), np.zeros(len(found))
    return Detectability(
        found, appearance.s, at, appearance.size, (Kind.SPOT,), (60.0,), (2.0, 9.0), sizes, local, spacing, 1.0, 0, 0.0
    )


def test_what_is_blind_is_named_and_hatched(learnt: Path) -> None:
    seen, blind = by_hand(learnt, 2.0), by_hand(learnt, np.inf)
    assert list(sentences(seen)) == [f"spot, 60 grey levels: 2 px usual, 2 px at the worst place ({where(seen)})"]
    assert list(sentences(blind))[1:] == ["between s = 0.00 and 1.00 no spot of 60 grey levels is caught, up to 9 px"]
    pictures = [picture(each, load_appearance(learnt), "tiny") for each in (seen, blind)]
    hatching = [(each == (190, 190, 190)).all(axis=2).sum() for each in pictures]
    assert hatching[1] > hatching[0] + 20_000
    weak = detectability_record(blind, "sha256:0")["weak"]
    assert weak == [{"s_start": 0.0, "s_end": 1.0, "kind": "spot", "contrast": 60.0, "size": "none"}]


def where(found: Detectability) -> str:
    """The first of the sites that are not at the rim."""
    first = int(np.flatnonzero(found.inner)[0])
    site = found.sites[first]
    return f"s {found.s_of[first]:.3f}, x {site.x:.0f}, y {site.y:.0f}"


def test_a_stretch_that_is_weak_is_named() -> None:
    said = list(sentences(made()))
    assert "no spot of 30 grey levels below 18" not in " ".join(said)
    assert "between s = 0.60 and 0.65 no spot of 60 grey levels below 9 px is caught" in said
    assert "added material, 30 grey levels: nowhere an edge that strong" in said


REFUSED = {
    "no kind": (["{file}", "--kind", "bogus"], 2, "known are spot, line, added, missing"),
    "no contrast": (["{file}", "--contrast", "0"], 2, "allowed are 1 to 255"),
    "no appearance": (["{golden}"], 1, "golden.mcap: not an appearance"),
    "no recording": (["{file}", "--golden", "{file}"], 1, "no MCAP"),
    "another camera": (["{file}", "--golden", "{other}"], 1, "learnt from 96x72"),
    "a picture in the way": (["{file}", "--png", "{golden}"], 1, "exists already"),
    "data in the way": (["{file}", "--json", "{golden}"], 1, "exists already"),
    "no policy": (["{file}", "--policy", "{golden}"], 1, "golden.mcap"),
}


@pytest.mark.parametrize("wrong", REFUSED)
def test_what_is_wrong_is_told_in_a_line(
    learnt: Path, golden: Path, tmp_path: Path, capsys: Captured, wrong: str
) -> None:
    arguments, expected, said = REFUSED[wrong]
    other = tmp_path / "other.mcap"
    with open_camera("simulated:?size=64x48&path=line&frames=3") as camera:
        record(camera, other, lossless=True)
    known = {"file": learnt, "golden": golden, "other": other}
    code = run(["detectability", *(argument.format(**known) for argument in arguments)])
    out, err = capsys.readouterr()
    assert (code, out, err.count("\n")) == (expected, "", 1)
    assert said in err


def test_a_cut_recording_is_a_warning(learnt: Path, golden: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(golden.read_bytes()[: int(0.9 * golden.stat().st_size)])
    told: list[str] = []
    probe_recordings(load_appearance(learnt), [cut], kinds=[Kind.SPOT], contrasts=[250.0], tell=told.append)
    assert told
    assert all(each.startswith(f"{cut}: ") for each in told)
