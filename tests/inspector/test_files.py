"""Files appear whole or not at all, and never in place of another."""

from __future__ import annotations

import resource
from pathlib import Path

import pytest

from inspector.errors import OutputExists
from inspector.files import NotWritten, arriving, refuse_taken, write_new


def test_the_bytes_arrive_and_nothing_else_does(tmp_path: Path) -> None:
    write_new(tmp_path / "a", b"whole")
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a", b"whole")]


def test_what_exists_is_refused_and_stays(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"first")
    with pytest.raises(OutputExists, match="a exists already"):
        write_new(tmp_path / "a", b"second")
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a", b"first")]


def test_what_came_while_it_was_written_is_not_replaced(tmp_path: Path) -> None:
    with pytest.raises(OutputExists), arriving(tmp_path / "a") as draft:  # noqa: PT012 (raised on leaving)
        draft.write_bytes(b"second")
        (tmp_path / "a").write_bytes(b"first")
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a", b"first")]


def test_a_dangling_link_counts_as_taken(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "nowhere")
    with pytest.raises(OutputExists):
        refuse_taken(tmp_path / "a")


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(NotWritten, match=r"b/a cannot be written: there is no folder .*b; name a file"):
        write_new(tmp_path / "b" / "a", b"")


def test_an_error_in_between_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), arriving(tmp_path / "a") as draft:  # noqa: PT012 (both are needed)
        draft.write_bytes(b"half")
        (tmp_path / "nothing").read_bytes()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_told_and_leaves_nothing(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(NotWritten, match=r"a cannot be written: File too large"):
            write_new(tmp_path / "a", bytes(200_000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []
