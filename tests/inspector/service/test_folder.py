"""The data folder: one service at a time, no path from a client, nothing half received."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.service.folder import DataFolder, FolderInUse, FolderRefused, NoFileId, new_id


def test_a_second_service_is_refused_until_the_first_lets_go(tmp_path: Path) -> None:
    first = DataFolder(tmp_path / "data")
    with pytest.raises(FolderInUse, match="another service works on this folder"):
        DataFolder(tmp_path / "data")
    first.close()
    first.close()
    DataFolder(tmp_path / "data").close()


def test_a_service_that_was_killed_does_not_hold_the_folder(tmp_path: Path) -> None:
    code = (
        "import sys; from inspector.service.folder import *; folder = DataFolder(Path(sys.argv[1])); input('mine\\n')"
    )
    command = [sys.executable, "-uc", code, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"mine\n"
        with pytest.raises(FolderInUse):
            DataFolder(tmp_path)
        holder.kill()
        holder.wait()
    DataFolder(tmp_path).close()


def test_what_was_being_received_is_gone_at_the_next_start_and_the_rest_stays(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path)
    kept = tmp_path / "sweeps" / f"{new_id()}.mcap"
    folder.incoming().write_bytes(b"half")
    kept.write_bytes(b"whole")
    folder.close()
    again = DataFolder(tmp_path)
    assert list((tmp_path / "incoming").iterdir()) == []
    assert kept.read_bytes() == b"whole"
    again.close()


def test_a_folder_that_cannot_be_made_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(FolderRefused, match=r"allowed is a folder that this program may write to"):
        DataFolder(tmp_path / "file")


def test_a_folder_that_is_gone_is_told(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path)
    folder.check_writable()
    (tmp_path / "incoming").rmdir()
    with pytest.raises(FolderRefused):
        folder.check_writable()
    folder.close()


@given(st.text() | st.sampled_from(["..", "../x", "a/b", "sha256:" + "../" * 21 + "x", "A" * 32, "0" * 32 + "\n"]))
def test_no_path_is_made_from_what_this_program_does_not_make(id: str) -> None:
    for checked in (DataFolder.checked, DataFolder.hash_of):
        with pytest.raises(NoFileId):
            checked(id)


def test_sentences_for_strangers_do_not_tell_where_the_folder_is(tmp_path: Path) -> None:
    folder = DataFolder(tmp_path)
    said = folder.hidden(f"{tmp_path / 'sweeps' / 'a.mcap'} is gone from {tmp_path}")
    assert said == f"sweeps{os.sep}a.mcap is gone from the data folder"
    folder.close()
