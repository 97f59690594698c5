"""Which recordings stay."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.service import retention
from inspector.service.files import Files, Kind
from inspector.service.folder import DataFolder, new_id
from inspector.service.retention import DAY_NS, Retention, crowded_out, due, over, remove_scores, tidy
from inspector.service.service import Service
from inspector.settings import Settings
from inspector.stores import AbstractStore, open_store
from inspector.stores.records import StoredAppearance, StoredRecording
from tests.buckets import Buckets
from tests.patience import SECONDS

NOW = 1_000 * DAY_NS
OK = StoredRecording("i", 1, "plate", "completed", "OK", "live", NOW, 1, 100)
NG = replace(OK, verdict="NG", ok_number=None)
ABORTED = replace(NG, state="aborted", verdict=None)


def test_of_ok_parts_the_first_stays_and_then_one_in_so_many() -> None:
    rules = Retention(ok_one_in=3)
    stays = [number for number in range(1, 11) if due(replace(OK, ok_number=number), rules, NOW) is None]
    assert stays == [1, 4, 7, 10]
    assert all(due(replace(OK, ok_number=number), Retention(), NOW) is None for number in range(1, 11))


@pytest.mark.parametrize("recording", [NG, ABORTED, replace(NG, verdict="REVIEW"), replace(NG, verdict="INVALID")])
def test_what_is_not_ok_stays_as_long_as_its_days(recording: StoredRecording) -> None:
    rules = Retention(ok_one_in=1000, days=2.5)
    assert due(recording, rules, NOW + round(2.5 * DAY_NS)) is None
    assert due(recording, rules, NOW + round(2.5 * DAY_NS) + 1) == "it ended more than 2.5 days before"


@given(recorded=st.integers(0, 10**15), free=st.integers(0, 10**15), share=st.floats(0.01, 1))
def test_what_is_over_the_share_is_exactly_too_much(recorded: int, free: int, share: float) -> None:
    too_much = over(recorded, free, share)
    assert 0 <= too_much <= recorded
    assert recorded - too_much <= share * (recorded + free)
    if too_much:
        assert recorded - too_much >= share * (recorded + free) - 1


def test_what_others_keep_on_the_disk_costs_room_but_never_all_recordings() -> None:
    assert over(100, 0, 0.8) == 20
    assert over(100, 10**12, 0.8) == 0


@given(
    parts=st.lists(st.tuples(st.sampled_from(["OK", "NG", "REVIEW", None]), st.integers(0, 50))),
    over=st.integers(0, 500),
)
def test_the_oldest_ok_go_first_then_the_others_and_no_more_than_needed(
    parts: list[tuple[str | None, int]], over: int
) -> None:
    recordings = [replace(OK, number=k, verdict=verdict, bytes=size) for k, (verdict, size) in enumerate(parts)]
    gone = list(crowded_out(recordings, over))
    order = [each for each in recordings if each.verdict == "OK"] + [
        each for each in recordings if each.verdict != "OK"
    ]
    assert gone == order[: len(gone)]
    assert len(gone) == len(recordings) or sum(each.bytes for each in gone) >= over
    assert not gone or sum(each.bytes for each in gone[:-1]) < over


class Folder:
    """Recordings of 100 bytes on a disk of 1000; to what tidies up, the Files of a service."""

    def __init__(self, path: Path, store: AbstractStore) -> None:
        self.path, self.store = path, store
        store.ensure_product("plate", 0)
        store.add_appearance(StoredAppearance("a", "plate", 0, (), {}, (), 0))

    def add(self, inspection_id: str, verdict: str | None, ended_ns: int = NOW) -> None:
        """An inspection; one without a verdict is still being recorded."""
        self.store.begin_inspection(
            inspection_id, "plate", part_id=None, recipe_id=None, appearance_id="a", policy={}, begun_ns=0
        )
        self.of(inspection_id).write_bytes(bytes(100))
        if verdict is not None:
            self.store.conclude_inspection(
                inspection_id, "completed", verdict=verdict, ended_ns=ended_ns, result={}, scores=b"scores"
            )
            self.store.set_recording(inspection_id, "kept", 100)

    def of(self, inspection_id: str) -> Path:
        return self.path / f"{inspection_id}.mcap"

    def remove(self, kind: Kind, id: str) -> None:
        self.of(id).unlink(missing_ok=True)

    def free(self) -> int:
        return 1000 - sum(file.stat().st_size for file in self.path.iterdir() if file.is_file())

    def tidy(self, rules: Retention, now_ns: int = NOW) -> retention.Tidied:
        return tidy(self.store, cast("Files", self), rules, now_ns)

    def there(self) -> str:
        """What the files and the store agree on."""
        files = {file.stem for file in self.path.iterdir() if file.is_file()}
        kept = {each.inspection_id for state in ("kept", "being written") for each in self.store.recordings(state)}
        assert files == kept
        return "".join(sorted(files))


@pytest.fixture(params=[1, 500])
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[Folder]:
    monkeypatch.setattr(retention, "BATCH", request.param)
    with open_store("memory:") as store:
        yield Folder(tmp_path, store)


def test_what_is_due_goes_and_the_store_says_why(folder: Folder) -> None:
    for name, verdict in zip("abcde", ["OK", "OK", "NG", "OK", "OK"], strict=True):
        folder.add(name, verdict)
    folder.add("f", "NG", ended_ns=NOW - 31 * DAY_NS)
    done = folder.tidy(Retention(ok_one_in=2))
    assert (done.removed, done.bytes, done.failures) == (3, 300, ())
    assert folder.there() == "acd"
    gone = folder.store.inspection("b")
    assert (gone.recording, gone.recording_bytes, gone.verdict) == ("removed", 0, "OK")
    assert gone.recording_note == "of parts that are OK, one in 2 is kept"
    assert folder.store.inspection("f").recording_note == "it ended more than 30 days before"
    assert folder.tidy(Retention(ok_one_in=2)).removed == 0


def test_a_short_disk_takes_the_oldest_ok_first_and_never_what_is_being_written(folder: Folder) -> None:
    folder.add("a", None)
    for name, verdict in zip("bcdefg", ["NG", "OK", "NG", "OK", "OK", "NG"], strict=True):
        folder.add(name, verdict)
    left: list[str] = []
    for share in (0.7, 0.5, 0.34, 0.3, 0.01):
        folder.tidy(Retention(disk_share=share))
        left.append(folder.there())
    assert left == ["abcdefg", "abdfg", "abdg", "adg", "a"]
    why = folder.store.inspection("c").recording_note
    assert why == "recordings filled more than 50 % of their room on the disk"


def test_it_ends_where_the_service_does(folder: Folder) -> None:
    for name in "abc":
        folder.add(name, "NG", ended_ns=0)
    answers = iter([False, False, True, True])
    done = tidy(folder.store, cast("Files", folder), Retention(), NOW, enough=lambda: next(answers))
    assert (done.removed, folder.there()) == (2, "c")
    with_no_days = Retention(days=10_000, disk_share=0.01)
    assert tidy(folder.store, cast("Files", folder), with_no_days, NOW, enough=lambda: True).removed == 0


def test_a_file_that_cannot_be_removed_is_told_and_tried_again(folder: Folder) -> None:
    folder.add("a", "NG", ended_ns=0)
    folder.add("b", "NG", ended_ns=0)
    folder.of("a").unlink()
    folder.of("a").mkdir()
    done = folder.tidy(Retention())
    assert done.removed == 1
    assert [text.startswith("recording a cannot be removed: ") for text in done.failures] == [True]
    assert folder.store.inspection("a").recording == "kept"
    folder.of("a").rmdir()
    assert folder.tidy(Retention()).removed == 1
    assert folder.there() == ""


def test_so_many_bytes_and_no_more(folder: Folder) -> None:
    for name, verdict in zip("abcd", ["NG", "OK", "OK", "NG"], strict=True):
        folder.add(name, verdict)
    folder.tidy(Retention(bytes=250))
    assert folder.there() == "ad"
    assert folder.store.inspection("b").recording_note == "recordings filled more than 250 bytes"
    folder.tidy(Retention(bytes=199))
    assert folder.there() == "d"


def test_in_a_bucket_recordings_go_by_days_and_bytes(tmp_path: Path, buckets: Buckets) -> None:
    place = DataFolder(tmp_path / "data")
    files, ids = Files(place, buckets.new()), [new_id() for _ in range(3)]
    with open_store("memory:") as store:
        folder = Folder(tmp_path, store)
        for id, ended_ns in zip(ids, (0, NOW - 1, NOW), strict=True):
            folder.add(id, "NG", ended_ns)
            files.publish(folder.of(id), "inspection", id)
        assert tidy(store, files, Retention(disk_share=0.01), NOW).removed == 1
        assert [files.size("inspection", id) for id in ids] == [None, 100, 100]
        assert tidy(store, files, Retention(bytes=100), NOW).removed == 1
        assert [files.size("inspection", id) for id in ids] == [None, None, 100]
    place.close()


@pytest.mark.parametrize("at_a_time", [1, 2, 3, 100])
def test_scores_go_after_their_days_whatever_the_verdict(
    folder: Folder, monkeypatch: pytest.MonkeyPatch, at_a_time: int
) -> None:
    monkeypatch.setattr(retention, "SCORES_AT_A_TIME", at_a_time)
    for name, verdict, days in zip("abcd", ["OK", "NG", "REVIEW", "NG"], [4, 3, 2.5, 1], strict=True):
        folder.add(name, verdict, ended_ns=NOW - round(days * DAY_NS))
    folder.add("e", None)
    store = folder.store
    assert [remove_scores(store, days, NOW) for days in (float("inf"), 1e9, 4.0)] == [0, 0, 0]
    assert remove_scores(store, 2.5, NOW, enough=lambda: True) == 0
    assert remove_scores(store, 2.5, NOW) == 2
    assert [name for name in "abcde" if store.scores(name) is not None] == ["c", "d"]
    assert [store.inspection(name).scores_removed_ns for name in "abcde"] == [NOW, NOW, None, None, None]
    assert folder.there() == "abcde"
    assert [remove_scores(store, 1e-9, NOW), remove_scores(store, 1e-9, NOW)] == [2, 0]


def test_a_service_removes_what_is_due(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path, keep_days=30, keep_scores_days=30, keep_disk_share=1, scorers=1)
    old, young = new_id(), new_id()

    async def serve() -> list[tuple[str, str]]:
        service = Service(settings)
        await service.start()
        try:
            async with asyncio.timeout(SECONDS):
                while service.store.inspection(old).scores == "kept":
                    await asyncio.sleep(0.01)
            found = [service.store.inspection(each) for each in (old, young)]
            return [(each.recording, each.scores) for each in found]
        finally:
            await service.stop("test")

    (tmp_path / "inspections").mkdir()
    with open_store(settings.database_url) as store:
        folder = Folder(tmp_path / "inspections", store)
        folder.add(old, "NG", ended_ns=0)
        folder.add(young, "NG", ended_ns=time.time_ns())
    assert asyncio.run(serve()) == [("removed", "removed"), ("kept", "kept")]
    assert [file.stem for file in (tmp_path / "inspections").iterdir()] == [young]
