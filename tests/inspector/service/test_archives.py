"""Archives of labelled pictures: unpacked within limits, and nothing is read from outside of them."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from inspector.labels import LabelsRefused
from inspector.service.archives import ArchiveRefused, read_archive

LABELS = b"file,object,x\na.jpg,cup,0\nsub/b.jpg,cup,1\n"


def archived(path: Path, files: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def read(tmp_path: Path, files: dict[str, bytes], max_bytes: int = 10_000, max_files: int = 10) -> list[str]:
    """The names of the pictures."""
    archive, folder = archived(tmp_path / "a.zip", files), tmp_path / "unpacked"
    labels = read_archive(archive, folder, {}, max_bytes=max_bytes, max_files=max_files)
    return [str(path.relative_to(folder)) for path, _, _ in labels.rows]


def test_pictures_and_labels_are_unpacked_wherever_they_lie(tmp_path: Path) -> None:
    assert read(tmp_path, {"labels.csv": LABELS, "a.jpg": b"a", "sub/b.jpg": b"b"}) == ["a.jpg", "sub/b.jpg"]


def test_labels_may_lie_in_a_folder_and_name_what_is_beside_them(tmp_path: Path) -> None:
    files = {"set/labels.csv": LABELS, "set/a.jpg": b"a", "set/sub/b.jpg": b"b", "__MACOSX/set/._labels.csv": b""}
    assert read(tmp_path, files) == ["set/a.jpg", "set/sub/b.jpg"]


@pytest.mark.parametrize("name", ["../a.jpg", "/etc/a.jpg", "sub/../../a.jpg", "c:a.jpg", "sub\\..\\a.jpg"])
def test_names_that_lead_elsewhere_are_refused_and_nothing_is_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(ArchiveRefused, match="a file in it is called"):
        read(tmp_path, {"labels.csv": LABELS, name: b"x"})
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


@pytest.mark.parametrize("named", ["/etc/hostname", "../a.zip", "c.jpg"])
def test_labels_that_name_what_is_not_in_the_archive_are_refused(tmp_path: Path, named: str) -> None:
    with pytest.raises(ArchiveRefused, match="which is not in the archive"):
        read(tmp_path, {"labels.csv": LABELS.replace(b"a.jpg", named.encode()), "a.jpg": b"a", "sub/b.jpg": b"b"})


def test_what_unpacks_to_more_than_allowed_is_refused_before_it_is(tmp_path: Path) -> None:
    with pytest.raises(ArchiveRefused, match="2 files of 1000042 bytes unpacked; allowed are 10 of 10000"):
        read(tmp_path, {"labels.csv": LABELS, "a.jpg": bytes(1_000_000)})
    with pytest.raises(ArchiveRefused, match="12 files"):
        read(tmp_path, {"labels.csv": LABELS, **{f"{k}.jpg": b"" for k in range(11)}})
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


def test_what_is_no_archive_or_damaged_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text").write_bytes(b"PK\x03\x04 and nothing like it")
    with pytest.raises(ArchiveRefused, match="allowed is a ZIP archive of pictures with one CSV file"):
        read_archive(tmp_path / "text", tmp_path / "out", {}, max_bytes=9, max_files=9)
    path = archived(tmp_path / "a.zip", {"labels.csv": LABELS * 50})
    damaged = bytearray(path.read_bytes())
    damaged[45] ^= 0xFF
    path.write_bytes(damaged)
    with pytest.raises((ArchiveRefused, LabelsRefused)):
        read_archive(path, tmp_path / "out", {}, max_bytes=9999, max_files=9)


def test_labels_that_cannot_be_read_are_said(tmp_path: Path) -> None:
    with pytest.raises(LabelsRefused, match="needed are file, object"):
        read(tmp_path, {"labels.csv": b"file,thing\n", "a.jpg": b""})
