"""Files of services: published whole and once, had by all, fetched once, and waiting where they cannot be published."""

from __future__ import annotations

import asyncio
import hashlib
import os
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

from inspector.errors import OutputExists
from inspector.files import NotWritten
from inspector.locations import open_location
from inspector.objects import NoSuchObject, ObjectError, Objects, ObjectTaken, beneath
from inspector.recording import SweepReader, SweepWriter
from inspector.service import publishing
from inspector.service.files import FileDamaged, Files
from inspector.service.folder import DataFolder, NoFileId, new_id
from inspector.service.mending import Mending
from inspector.service.metrics import Metrics
from inspector.service.publishing import Publishing
from inspector.service.service import Service
from inspector.settings import Settings
from inspector.stores import AbstractStore, open_store
from inspector.stores.records import StoredAppearance
from models.frame import Frame
from tests.buckets import Buckets
from tests.inspector.recordings import frame, same
from tests.patience import until

A = "0123456789abcdef" * 2
WEEK_NS = 7 * 86_400_000_000_000


@pytest.fixture
def node(tmp_path: Path) -> Iterator[Callable[[str], DataFolder]]:
    """Data folders of services, by name."""
    made: list[DataFolder] = []

    def folder(name: str) -> DataFolder:
        made.append(DataFolder(tmp_path / name))
        return made[-1]

    yield folder
    for each in made:
        each.close()


@pytest.fixture(params=["data folder", "folder", "bucket"])
def files(request: pytest.FixtureRequest, tmp_path: Path, node: Callable[[str], DataFolder]) -> Files:
    match request.param:
        case "data folder":
            return Files(node("a"))
        case "folder":
            return Files(node("a"), (tmp_path / "shared files").as_uri())
        case _:
            return Files(node("a"), beneath(request.getfixturevalue("buckets").new(), "line 1"))


def draft(files: Files, data: bytes) -> Path:
    path = files.incoming()
    path.write_bytes(data)
    return path


def test_what_is_published_is_read_by_its_place_in_any_process(files: Files) -> None:
    for kind, id in (("sweep", A), ("inspection", A), ("part", f"{A}.2")):
        made = draft(files, kind.encode())
        assert files.size(kind, id) is None
        files.publish(made, kind, id)
        assert not made.exists()
        assert files.size(kind, id) == len(kind)
        with open_location(files.place(kind, id)) as file:
            assert file.read() == kind.encode()
        files.remove(kind, id)
        files.remove(kind, id)
        assert files.size(kind, id) is None


def test_a_learnt_file_is_on_this_computer_by_its_hash(files: Files) -> None:
    for kind in ("appearance", "workspace"):
        id = f"sha256:{hashlib.sha256(b'learnt').hexdigest()}"
        files.publish(draft(files, b"learnt"), kind, id)
        # Learnt once more, to the same bytes.
        files.publish(draft(files, b"learnt"), kind, id)
        assert files.local(kind, id).read_bytes() == b"learnt"
        assert files.incoming().parent.exists()
        assert not any(files.incoming().parent.iterdir())


@pytest.mark.parametrize("id", ["..", f"{A}/", A.upper(), f"sha256:{A}", "", f"{A}.", f"{A}.-1"])
def test_no_place_is_made_from_what_this_program_does_not_make(files: Files, id: str) -> None:
    for kind in ("sweep", "inspection", "part", "appearance", "workspace"):
        with pytest.raises(NoFileId):
            files.place(kind, id)
    for place in (files.tape, files.whole):
        with pytest.raises(NoFileId):
            place(id)


def test_nothing_is_written_over_where_services_share_files(
    tmp_path: Path, buckets: Buckets, node: Callable[[str], DataFolder]
) -> None:
    for name, url, taken in (
        ("a", (tmp_path / "shared").as_uri(), OutputExists),
        ("b", buckets.new(), ObjectTaken),
    ):
        files = Files(node(name), url)
        files.publish(draft(files, b"first"), "sweep", A)
        other = draft(files, b"other one")
        with pytest.raises(taken):
            files.publish(other, "sweep", A)
        assert other.read_bytes() == b"other one"
        with open_location(files.place("sweep", A)) as file:
            assert file.read() == b"first"
        # Once more: the answer to the first time was lost.
        files.publish(draft(files, b"first"), "sweep", A)


def test_what_one_service_learnt_another_has_and_fetches_it_once(
    buckets: Buckets, node: Callable[[str], DataFolder]
) -> None:
    url, id = buckets.new(), f"sha256:{hashlib.sha256(b'learnt').hexdigest()}"
    one, other = (Files(node(name), url) for name in "ab")
    one.publish(draft(one, b"learnt"), "appearance", id)
    assert other.local_appearance(id).read_bytes() == b"learnt"
    Objects(url).remove(f"appearances/{id[7:]}.appearance")
    assert one.local_appearance(id).read_bytes() == other.local_appearance(id).read_bytes() == b"learnt"
    with pytest.raises(NoSuchObject):
        Files(node("c"), url).local_appearance(id)


def test_copies_that_nobody_asked_for_in_a_week_go_and_are_fetched_again(
    buckets: Buckets, node: Callable[[str], DataFolder], store: AbstractStore
) -> None:
    url, folder, learnt = buckets.new(), node("a"), [f"learnt {n}".encode() for n in range(4)]
    ids = [f"sha256:{hashlib.sha256(each).hexdigest()}" for each in learnt]
    paths = [folder.path / "appearances" / f"{id[7:]}.appearance" for id in ids]
    station = Station(store, Files(folder, url))
    for id, each in zip(ids[:3], learnt, strict=False):
        station.files.publish(draft(station.files, each), "appearance", id)
    # Of a time without the bucket.
    paths[3].write_bytes(learnt[3])
    now_ns = time.time_ns()
    for path in paths:
        os.utime(path, ns=(0, now_ns - WEEK_NS))
    assert station.files.local_appearance(ids[0]) == paths[0]
    os.utime(paths[1], ns=(0, now_ns - WEEK_NS // 2))
    station.mending.mend(now_ns, 30)
    assert [path.exists() for path in paths] == [True, True, False, True]
    assert [station.files.local_appearance(id).read_bytes() for id in ids] == learnt


def test_learnt_files_that_are_no_copies_stay(tmp_path: Path, node: Callable[[str], DataFolder]) -> None:
    id = f"sha256:{hashlib.sha256(b'learnt').hexdigest()}"
    for files in (Files(node("a")), Files(node("b"), (tmp_path / "shared").as_uri())):
        files.publish(draft(files, b"learnt"), "appearance", id)
        os.utime(files.local_appearance(id), ns=(0, 0))
        files.drop_copies(time.time_ns())
        assert files.local_appearance(id).read_bytes() == b"learnt"


def test_a_learnt_file_that_is_not_what_its_name_says_is_not_used(
    buckets: Buckets, node: Callable[[str], DataFolder], tmp_path: Path
) -> None:
    url, id = buckets.new(), f"sha256:{hashlib.sha256(b'learnt').hexdigest()}"
    (tmp_path / "wrong").write_bytes(b"learnd")
    Objects(url).put_new(f"appearances/{id[7:]}.appearance", tmp_path / "wrong")
    files = Files(node("a"), url)
    with pytest.raises(FileDamaged, match=r"^s3://bucket-\d+/appearances/.*: what is in it is not what its name says"):
        files.local_appearance(id)
    assert not any(files.incoming().parent.iterdir())


def test_a_service_does_not_start_where_its_files_cannot_be(tmp_path: Path, buckets: Buckets) -> None:
    for url, said in (
        (f"s3://no-such-bucket/a?endpoint={buckets.endpoint}", "there is no such bucket"),
        ("s3://bucket-0?endpoint=http://127.0.0.1:1", "it does not answer"),
        ("gopher://bucket", "gopher scheme is not known"),
    ):
        service = Service(Settings(data=tmp_path / "data", files=url, scorers=1))
        with pytest.raises(ObjectError, match=said):
            asyncio.run(service.start())
        assert not service.started
        # Nothing holds the folder.
        DataFolder(tmp_path / "data").close()


class Station:
    """A store with inspections, and what one node publishes."""

    def __init__(self, store: AbstractStore, files: Files) -> None:
        self.store, self.files, self.metrics = store, files, Metrics()
        self.publishing = Publishing(store, files, self.metrics)
        self.mending = Mending(store, files, self.publishing)
        store.ensure_product("plate", 0)
        store.add_appearance(StoredAppearance("a", "plate", 0, (), {}, (), 0))

    def begin(self, take: int = 0) -> tuple[str, Path]:
        """An inspection of which something was recorded here."""
        id = new_id()
        self.store.begin_inspection(id, "plate", part_id=None, recipe_id=None, appearance_id="a", policy={}, begun_ns=0)
        path = self.files.tape(id, take)
        path.write_bytes(b"recorded")
        return id, path

    def end(self, id: str) -> None:
        self.store.conclude_inspection(id, "completed", verdict="OK", ended_ns=1, result=None, scores=None)

    def state(self, id: str) -> tuple[str, int, str | None]:
        stored = self.store.inspection(id)
        return stored.recording, stored.recording_bytes, stored.recording_note

    def when_kept(self, id: str) -> tuple[str, int, str | None]:
        """As it is when it is kept."""
        until(lambda: self.state(id)[0] == "kept")
        return self.state(id)


@pytest.fixture
def store() -> Iterator[AbstractStore]:
    with open_store("memory:") as opened:
        yield opened


def test_a_closed_recording_is_kept(files: Files, store: AbstractStore) -> None:
    station = Station(store, files)
    station.publishing.start()
    id, path = station.begin()
    station.end(id)
    told = station.publishing.keep(id, path, "a note")
    assert told.recording == ("being written" if files.common else "kept")
    assert station.when_kept(id) == ("kept", 8, "a note")
    with open_location(files.place("inspection", id)) as file:
        assert file.read() == b"recorded"
    assert files.left() == ()
    nothing, path = station.begin()
    path.write_bytes(b"")
    assert station.publishing.keep(nothing, path, None).recording == "none"
    station.publishing.close()


def test_in_the_data_folder_a_recording_is_written_where_it_stays(
    store: AbstractStore, node: Callable[[str], DataFolder]
) -> None:
    folder = node("a")
    station = Station(store, Files(folder))
    id, path = station.begin()
    before = path.stat()
    assert station.publishing.keep(id, path, None).recording == "kept"
    assert str(path) == station.files.place("inspection", id)
    assert (path.stat().st_ino, path.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)


def test_what_cannot_be_published_waits_is_told_and_goes_when_it_can(
    store: AbstractStore, buckets: Buckets, node: Callable[[str], DataFolder], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publishing, "_FIRST_WAIT", 0.01)
    bucket = f"late-{new_id()}"
    station = Station(store, Files(node("a"), f"s3://{bucket}?endpoint={buckets.endpoint}"))
    station.publishing.start()
    made = [station.begin() for _ in range(3)]
    for id, path in made:
        station.end(id)
        station.publishing.keep(id, path, None)
    until(lambda: station.publishing.trouble is not None)
    assert station.publishing.trouble is not None
    assert station.publishing.trouble.endswith("there is no such bucket; make it, or name another")
    assert [station.state(id)[0] for id, _ in made] == ["being written"] * 3
    assert station.metrics.exposition().count(b"inspector_recordings_unpublished 3.0") == 1
    assert sorted(left for left, _, _ in station.files.left()) == sorted(id for id, _ in made)
    buckets.make(bucket)
    assert [station.when_kept(id)[:2] for id, _ in made] == [("kept", 8)] * 3
    assert station.files.left() == ()
    station.publishing.close()
    assert station.publishing.trouble is None


def test_the_next_start_takes_up_what_was_left(
    store: AbstractStore, buckets: Buckets, node: Callable[[str], DataFolder]
) -> None:
    url, folder = buckets.new(), node("a")
    before = Station(store, Files(folder, url))
    whole, path = before.begin()
    before.end(whole)
    # Killed before its thread came to it.
    before.publishing.keep(whole, path, "a note")
    running, _ = before.begin(1)
    after = Station(store, Files(folder, url))
    after.publishing.start()
    assert after.when_kept(whole) == ("kept", 8, "a note")
    assert after.files.size("part", f"{running}.1") == 8
    assert after.files.left() == ()
    after.publishing.close()


def taken(path: Path, those: Iterable[Frame], *, closed: bool = True) -> None:
    """What one service recorded of an inspection; one that was killed did not close it."""
    path.unlink(missing_ok=True)
    with SweepWriter(path) as writer:
        for each in those:
            writer.write(each)
        writer.flush()
        flushed = path.read_bytes()
    if not closed:
        path.write_bytes(flushed)


LATER = 721_000_000_000
"""When nobody is busy any more with what ended a nanosecond after the beginning of time."""


def test_a_recording_whose_end_was_cut_off_is_put_together_of_its_parts(files: Files, store: AbstractStore) -> None:
    station = Station(store, files)
    station.publishing.start()
    id, _ = station.begin(1)
    taken(files.tape(id, 1), [frame(n) for n in range(4, 9)], closed=False)
    first = files.incoming()
    # The service that was killed had recorded more than it had saved.
    taken(first, [frame(n) for n in range(6)])
    files.publish(first, "part", f"{id}.0")
    store.take_inspection(id, "the second one")
    store.conclude_inspection(
        id, "completed", verdict="OK", ended_ns=1, result=None, scores=None, node="the second one"
    )
    station.mending.mend(LATER - 1_000_000_000, 30)
    assert station.state(id)[0] == "being written"
    station.mending.mend(LATER, 30)
    kept, _, note = station.when_kept(id)
    assert (kept, note) == ("kept", "put together after a crash: frames may be missing")
    there = list(SweepReader(files.place("inspection", id)))
    assert [each.sequence for each in there] == list(range(9))
    assert all(same(each, each.sequence) for each in there)
    assert files.left() == ()
    assert [files.size("part", f"{id}.{take}") for take in range(2)] == [None, None]
    station.mending.mend(LATER, 30)
    assert station.state(id)[0] == "kept"
    station.publishing.close()


def test_a_recording_that_is_in_its_place_is_kept_even_if_nobody_said_so(files: Files, store: AbstractStore) -> None:
    station = Station(store, files)
    id, path = station.begin()
    station.end(id)
    store.set_recording(id, "being written", 8, "a note")
    files.publish(path, "inspection", id)
    station.mending.mend(LATER, 30)
    assert station.state(id) == ("kept", 8, "a note")


def test_what_was_left_of_an_inspection_that_others_gave_up_is_its_recording(
    files: Files, store: AbstractStore
) -> None:
    station = Station(store, files)
    station.publishing.start()
    id, _ = station.begin(1)
    taken(files.tape(id, 1), [frame(n) for n in range(5)], closed=False)
    station.end(id)
    store.set_recording(id, "none")
    station.mending.mend(LATER, 30)
    assert station.when_kept(id)[0] == "kept"
    assert len(list(SweepReader(files.place("inspection", id)))) == 5
    station.publishing.close()


def test_what_could_not_be_joined_stays_as_long_as_the_recording(files: Files, store: AbstractStore) -> None:
    station = Station(store, files)
    running, _ = station.begin(1)
    id, path = station.begin(1)
    station.end(id)
    store.set_recording(id, "kept", 8)
    station.mending.mend(LATER, 30)
    assert path.exists()
    store.set_recording(id, "removed")
    station.mending.mend(LATER, 30)
    assert not path.exists()
    assert files.tape(running, 1).exists()


def test_a_full_or_missing_folder_is_told(tmp_path: Path, node: Callable[[str], DataFolder]) -> None:
    files = Files(node("a"), (tmp_path / "shared").as_uri())
    made = draft(files, b"1")
    (tmp_path / "shared" / "sweeps").rmdir()
    with pytest.raises(NotWritten):
        files.publish(made, "sweep", A)
    assert made.read_bytes() == b"1"


def test_sentences_for_strangers_do_not_tell_where_folders_are(
    tmp_path: Path, node: Callable[[str], DataFolder]
) -> None:
    shared = tmp_path / "shared"
    files = Files(node("a"), shared.as_uri())
    said = files.hidden(f"{files.place('sweep', A)} is gone from {shared} and {files.tape(A)}")
    assert said == f"sweeps/{A}.mcap is gone from the folder of files and tapes/{A}.0.mcap"
