"""Learning from recordings: deterministic, whole or not at all, and every loss and every culprit named."""

from __future__ import annotations

import re
import resource
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from inspector.errors import NotARecording, OutputExists
from inspector.files import NotWritten
from inspector.learner import add_recordings, learn_recordings, load_appearance
from models.errors import AppearanceError, LearningError, PictureError, SweepsDiffer
from tests.inspector.conftest import Line
from tests.inspector.line import SPOT, cut, recorded


def test_what_is_learnt_is_on_the_disk_and_the_same_when_learnt_again(line: Line, tmp_path: Path) -> None:
    again = learn_recordings([str(path) for path in line.golden], str(tmp_path / "again"))
    assert load_appearance(line.file).id == line.appearance.id == again.id
    assert (tmp_path / "again").read_bytes() == line.file.read_bytes()
    assert line.appearance.size == (160, 120)
    assert line.appearance.places > 50


def test_the_first_recording_is_the_reference(line: Line, tmp_path: Path) -> None:
    assert learn_recordings(line.golden[::-1], tmp_path / "a").id != line.appearance.id


def test_progress_grows_to_one(line: Line, tmp_path: Path) -> None:
    told: list[float] = []
    learn_recordings(line.golden, tmp_path / "a", told.append)
    assert len(told) > 50
    assert all(a <= b for a, b in pairwise(told))
    assert told[-1] == 1.0


def test_what_exists_is_refused_before_anything_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"mine")
    with pytest.raises(OutputExists):
        learn_recordings([tmp_path / "no.mcap"], tmp_path / "a")
    with pytest.raises(NotARecording, match=r"no\.mcap"):
        learn_recordings([tmp_path / "no.mcap"], tmp_path / "b")
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a", b"mine")]


def test_a_full_disk_leaves_nothing(line: Line, tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(NotWritten, match="File too large"):
            learn_recordings(line.golden, tmp_path / "a")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []


def test_every_loss_is_told_once_with_its_recording(line: Line, tmp_path: Path) -> None:
    short, told = cut(line.golden[1], tmp_path / "short.mcap", 0.8), list[str]()
    learn_recordings([line.golden[0], short], tmp_path / "a", tell=told.append)
    assert told
    assert len(set(told)) == len(told)
    assert all(said.startswith(f"{short}: ") for said in told)


def test_nothing_is_told_of_whole_recordings(line: Line, tmp_path: Path) -> None:
    learn_recordings(line.golden, tmp_path / "a", tell=pytest.fail)


def test_a_picture_of_another_size_names_its_recording(line: Line, tmp_path: Path) -> None:
    other = recorded(tmp_path / "other.mcap", "size=96x72")
    with pytest.raises(PictureError, match=r"^\S*other\.mcap: .*96x72"):
        learn_recordings([line.golden[0], other], tmp_path / "a")


def test_a_recording_that_teaches_nothing_is_named(line: Line, tmp_path: Path) -> None:
    one = recorded(tmp_path / "one.mcap", "stop=0")
    with pytest.raises(LearningError, match=r"one\.mcap: "):
        learn_recordings([one], tmp_path / "a")
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("damage", ["missing", "foreign", "flipped", "cut", "empty"])
def test_an_appearance_that_cannot_be_trusted_is_refused_by_name(line: Line, tmp_path: Path, damage: str) -> None:
    path, data = tmp_path / "a.appearance", bytearray(line.file.read_bytes())
    data[len(data) // 2] ^= 1
    content = {"foreign": b"PNG" * 99, "flipped": bytes(data), "cut": line.file.read_bytes()[:-1], "empty": b""}
    if damage != "missing":
        path.write_bytes(content[damage])
    with pytest.raises(AppearanceError, match=r"^\S*a\.appearance: ") as caught:
        load_appearance(path)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Two more good parts, and one of another product."""
    folder = tmp_path_factory.mktemp("others")
    options = ("unit=5&seed=15&place=-1,1,-0.1", "unit=6&seed=16&gain=0.95", "part=casting&seed=17")
    one, two, stranger = (recorded(folder / f"other-{i}.mcap", each) for i, each in enumerate(options))
    return one, two, stranger


def test_a_defective_recording_among_golden_ones_is_told_by_name_and_with_its_numbers(
    line: Line, others: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    told: list[str] = []
    found = learn_recordings([*line.golden, line.spot, others[0]], tmp_path / "a", tell=told.append)
    (said,) = told
    assert re.match(rf"{line.spot}: left out: it reaches \d+\.\d times .* usually reach \d\.\d; is this part", said)
    whole = learn_recordings([*line.golden, others[0]], tmp_path / "b", tell=pytest.fail)
    assert replace(found, facts=whole.facts).id == whole.id


def test_of_recordings_that_do_not_fit_only_the_culprit_is_named(
    line: Line, others: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    with pytest.raises(LearningError) as caught:
        learn_recordings([line.golden[0], others[2], line.golden[1]], tmp_path / "a")
    assert str(caught.value).startswith(f"{others[2]}: golden sweep 2 fits the reference sweep in ")
    assert str(line.golden[0]) not in str(caught.value)
    assert str(line.golden[1]) not in str(caught.value)


def test_of_two_recordings_that_differ_both_are_named(line: Line, tmp_path: Path) -> None:
    other = recorded(tmp_path / "other.mcap", "unit=4&seed=14&defect=extra&at=0.5&strength=3&defect_size=40")
    with pytest.raises(SweepsDiffer, match=rf"^{line.golden[0]}, {other}: two golden sweeps differ"):
        learn_recordings([line.golden[0], other], tmp_path / "a")


def test_of_two_recordings_that_differ_by_less_both_are_learnt_and_told(line: Line, tmp_path: Path) -> None:
    told: list[str] = []
    (peak,) = learn_recordings([line.golden[0], line.spot], tmp_path / "a", tell=told.append).peaks
    assert told == [
        f"{line.golden[0]}, {line.spot}: they differ by {peak:.1f} times the assumed tolerance, and as much is "
        "tolerated; is one of the parts defective? A third golden sweep would tell which"
    ]


def test_recordings_are_added_to_a_new_appearance_and_the_old_one_stays(
    line: Line, others: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    before, told = line.file.read_bytes(), list[float]()
    new = add_recordings(others[:2], line.file, tmp_path / "new", told.append, tell=pytest.fail)
    assert line.file.read_bytes() == before
    assert load_appearance(tmp_path / "new").id == new.id != line.appearance.id
    assert (new.facts["sweeps"], new.facts["added_to"], len(new.peaks)) == ("4", line.appearance.id, 3)
    assert all(a <= b for a, b in pairwise(told))
    assert (len(told) > 50, told[-1]) == (True, 1.0)
    one = add_recordings(others[:1], line.file, tmp_path / "one")
    assert add_recordings(others[1:2], tmp_path / "one", tmp_path / "two").tolerance == new.tolerance != one.tolerance


@pytest.mark.parametrize(("wrong", "sentence"), [("spot", "is this part defective"), ("stranger", "same product")])
def test_a_recording_that_must_not_be_added_is_named_and_nothing_is_written(
    line: Line, others: tuple[Path, Path, Path], tmp_path: Path, wrong: str, sentence: str
) -> None:
    path = recorded(tmp_path / "spot.mcap", SPOT) if wrong == "spot" else others[2]
    with pytest.raises(LearningError, match=rf"^{path}: the sweep .*{sentence}"):
        add_recordings([others[0], path], line.file, tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_what_exists_is_refused_before_anything_is_added(line: Line, tmp_path: Path) -> None:
    with pytest.raises(OutputExists):
        add_recordings([tmp_path / "no.mcap"], tmp_path / "no.appearance", line.file)
    with pytest.raises(AppearanceError, match=r"no\.appearance: "):
        add_recordings([line.good], tmp_path / "no.appearance", tmp_path / "a")
    with pytest.raises(NotARecording, match=r"no\.mcap"):
        add_recordings([tmp_path / "no.mcap"], line.file, tmp_path / "a")
    assert list(tmp_path.iterdir()) == []
