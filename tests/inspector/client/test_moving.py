"""An inspection goes from one process of the service to another, and neither line nor result know the difference."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from inspector.client import AbstractInspection, Client, ServiceRefused
from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.service import moving
from inspector.service.checkpoints import Kept, state_bytes
from inspector.service.folder import new_id
from inspector.service.service import HAND_OVER, Service
from tests import patience
from tests.api.stations import BAD, PART, PRODUCT, frames, learnt, material, picture, sweep, teach
from tests.contracts.stores import engine
from tests.inspector.client.served import Switch, served
from tests.patience import SECONDS, until
from tests.postgresql import Server

WAYS = ("ws", "rest")
_BATCH = itertools.count()


@pytest.fixture(scope="module")
def two(postgresql: Server, tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[tuple[str, Service]]]:
    """Two services on one database."""
    folder, database = tmp_path_factory.mktemp("two"), postgresql.new_database()
    files = f"file://{folder}/files"
    with (
        served(folder / "one", database=database, files=files) as one,
        served(folder / "other", database=database, files=files) as other,
    ):
        teach(one[1])
        shutil.copy(material() / "plate.appearance", one[1].files.place("appearance", learnt().id))
        yield [one, other]


@pytest.fixture
def way(two: list[tuple[str, Service]]) -> Iterator[Switch]:
    with Switch(two[0][0]) as switch:
        yield switch


Begin = Callable[[str, list[dict[str, Any]]], AbstractInspection]


@pytest.fixture
def begin(way: Switch) -> Iterator[Begin]:
    """An inspection, by a transport; what is said of it goes to a list."""
    with Client(way.url) as client:
        yield lambda transport, said: client.begin(
            PRODUCT, f"{PART}-{next(_BATCH)}", transport=transport, on_message=said.append
        )


def offline() -> Any:
    return replay(SweepReader(sweep(BAD)), learnt()).result


def unhurt(service: Service, inspection: AbstractInspection, said: list[dict[str, Any]], lost: int = 0) -> None:
    """Every frame was answered once, in order, and the result is that of the sweep that nobody interrupted.

    Its recording has all frames but the first ones, which a process recorded that was lost.
    """
    result = inspection.conclude()
    wanted = offline()
    assert (result["verdict"], result["digest"]) == (wanted.verdict.value, wanted.digest)
    assert [each["index"] for each in said if each["kind"] == "scored"] == [*range(len(frames()))]
    assert inspection.counts["scored"] == len(frames()) == result["frames_scored"]
    assert len(result["frames"]) == len(frames())
    until(lambda: service.store.inspection(inspection.inspection_id).recording == "kept")
    note = service.store.inspection(inspection.inspection_id).recording_note
    assert note == (
        f"frames from 0 to {lost - 1} are not in it: the process that recorded them was lost" if lost else None
    )
    kept = SweepReader(service.files.place("inspection", inspection.inspection_id))
    assert [picture(frame) for frame in kept] == [picture(frame) for frame in frames()[lost:]]


def saved(service: Service, inspection: AbstractInspection, below: int) -> None:
    """Wait until the frames below that are in the store, and the line knows it."""
    while (running := service.inspections.find(inspection.inspection_id)) is None or running.ledger.below < below:
        inspection.wait(0.02)
    inspection.wait(0.1)


def kept(service: Service, inspection: AbstractInspection) -> Kept:
    """What is kept of it there, as soon as it is there."""
    while (running := service.inspections.find(inspection.inspection_id)) is None:
        inspection.wait(0.02)
    return running.ledger.kept


@pytest.fixture
def deaf(two: list[tuple[str, Service]]) -> Iterator[None]:
    """Who has an inspection does not hand it over, and does not know that it is taken."""
    for _, service in two:
        service.peers.on(HAND_OVER, lambda asked: None)
    yield
    for _, service in two:
        service.peers.on(
            HAND_OVER, lambda asked, service=service: service.inspections.give_soon(asked["inspection_id"])
        )


@pytest.mark.usefixtures("deaf")
@pytest.mark.parametrize(("transport", "moved_at"), [("ws", 0), ("ws", 17), ("rest", 1), ("rest", len(frames()))])
def test_what_was_never_saved_is_sent_once_more(
    *,
    two: list[tuple[str, Service]],
    way: Switch,
    begin: Begin,
    transport: str,
    moved_at: int,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(moving, "SAVE_SECONDS", 1000.0)
    said: list[dict[str, Any]] = []
    inspection = begin(transport, said)
    for frame in frames()[:moved_at]:
        inspection.send(frame)
    way.to(two[1][0])
    for frame in frames()[moved_at:]:
        inspection.send(frame)
    unhurt(two[1][1], inspection, said)


@pytest.mark.usefixtures("deaf")
@pytest.mark.parametrize("transport", WAYS)
def test_it_goes_on_from_where_it_was_saved(
    two: list[tuple[str, Service]], way: Switch, begin: Begin, transport: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(moving, "SAVE_SECONDS", 0.05)
    said: list[dict[str, Any]] = []
    inspection = begin(transport, said)
    for frame in frames():
        if frame.sequence == 20:
            saved(two[0][1], inspection, frame.sequence)
        if frame.sequence == 27:
            way.to(two[1][0])
        inspection.send(frame)
    ((_, start),) = kept(two[1][1], inspection).starts
    assert 20 <= start <= 27
    running = two[1][1].inspections.find(inspection.inspection_id)
    assert running is not None
    assert [each["kind"] for each in running.so_far].count("early_ng") == 1
    unhurt(two[1][1], inspection, said, lost=start)


@pytest.mark.usefixtures("deaf")
def test_what_a_crash_of_the_database_has_lost_is_told(
    two: list[tuple[str, Service]], way: Switch, begin: Begin, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(moving, "SAVE_SECONDS", 0.05)
    said: list[dict[str, Any]] = []
    inspection = begin("rest", said)
    for frame in frames()[:20]:
        inspection.send(frame)
    # All of it: nothing is due to be saved any more.
    saved(two[0][1], inspection, frame.sequence + 1)
    monkeypatch.setattr(moving, "SAVE_SECONDS", 1000.0)
    running = two[0][1].inspections.find(inspection.inspection_id)
    while running is None or running.ledger.turn.locked():
        inspection.wait(0.02)
    with engine(two[0][1].store).begin() as connection:
        connection.execute(text("DELETE FROM checkpoints"))
    way.to(two[1][0])

    def go_on() -> None:
        for frame in frames()[20:]:
            inspection.send(frame)
        inspection.conclude()

    with pytest.raises(ServiceRefused, match="the checkpoint has lost its state"):
        go_on()
    stored = two[1][1].store.inspection(inspection.inspection_id)
    assert stored.state == "failed"
    assert "the checkpoint has lost its state" in (stored.reason or "")


@pytest.mark.parametrize("transport", WAYS)
def test_it_is_handed_over_at_the_last_frame(
    two: list[tuple[str, Service]], way: Switch, begin: Begin, transport: str, monkeypatch: pytest.MonkeyPatch
):
    # Who has it may be slow; nobody goes on from what was saved before.
    monkeypatch.setattr(moving, "_HANDED_SECONDS", SECONDS)
    said: list[dict[str, Any]] = []
    inspection = begin(transport, said)
    services = itertools.cycle([two[1], two[0]])
    starts: list[tuple[int, int]] = []
    for frame in frames():
        if frame.sequence % 13 == 12:
            while inspection.counts["scored"] < frame.sequence:
                inspection.wait(0.02)
            url, service = next(services)
            way.to(url)
            inspection.send(frame)
            starts.append((len(starts) + 1, frame.sequence))
            assert kept(service, inspection).starts == tuple(starts)
        else:
            inspection.send(frame)
    unhurt(two[1][1], inspection, said)
    assert two[0][1].store.inspection(inspection.inspection_id).takes == len(starts) == 3


@pytest.mark.parametrize("transport", WAYS)
def test_a_scorer_that_dies_takes_nothing_with_it(two: list[tuple[str, Service]], begin: Begin, transport: str):
    said: list[dict[str, Any]] = []
    inspection = begin(transport, said)
    for frame in frames():
        if frame.sequence == 21:
            (scorer,) = two[0][1].inspections.pool.scorers
            assert scorer.pid is not None
            os.kill(scorer.pid, signal.SIGKILL)
        inspection.send(frame)
    unhurt(two[1][1], inspection, said)


def test_a_service_that_is_stopped_leaves_its_inspections_to_others(
    two: list[tuple[str, Service]], postgresql: Server, tmp_path: Path
):
    said: list[dict[str, Any]] = []
    database = two[0][1].settings.database_url
    with Switch("") as way, Client(way.url) as client:
        with served(tmp_path / "third", database=database, files=two[0][1].settings.files) as third:
            way.to(third[0])
            inspection = client.begin(PRODUCT, "stopped", on_message=said.append)
            for frame in frames()[:25]:
                inspection.send(frame)
        stored = two[0][1].store.inspection(inspection.inspection_id)
        assert (stored.state, stored.node) == ("processing", None)
        way.to(two[0][0])
        for frame in frames()[25:]:
            inspection.send(frame)
        unhurt(two[1][1], inspection, said)


def test_what_nobody_goes_on_with_is_aborted(two: list[tuple[str, Service]], tmp_path: Path):
    other = two[0][1]
    settings = {"database": other.settings.database_url, "files": other.settings.files, "idle_seconds": 1.0}
    with served(tmp_path / "third", **settings) as (url, _):
        inspection_id = new_id()
        other.store.begin_inspection(
            inspection_id, PRODUCT, part_id="left", recipe_id=None, appearance_id=learnt().id, policy={},
            begun_ns=other.now_ns(), node="a process that was killed",
        )  # fmt: skip
        other.store.bury(3.0, "gone")
        assert other.store.inspection(inspection_id).node is None
        with Client(url):
            until(lambda: other.store.inspection(inspection_id).state == "aborted")
    stored = other.store.inspection(inspection_id)
    assert stored.verdict is None
    assert stored.reason == "its process was lost, and no frame came for 1 s"


def test_what_cannot_be_gone_on_with_has_failed_and_is_told(two: list[tuple[str, Service]]):
    service, inspection_id = two[0][1], new_id()
    service.store.begin_inspection(
        inspection_id, PRODUCT, part_id="damaged", recipe_id=None, appearance_id=learnt().id, policy={},
        begun_ns=service.now_ns(), node="a process that was killed",
    )  # fmt: skip
    damaged = state_bytes(Kept(first=0, next=7), b"not a state")
    service.store.save_checkpoint(inspection_id, "a process that was killed", 0, damaged, b"")
    service.store.release_inspection(inspection_id, "a process that was killed", service.now_ns())
    answer = patience.post(f"{two[0][0]}/v1/inspections/{inspection_id}/conclude", json={})
    assert (answer.status_code, "the checkpoint cannot be read" in answer.text) == (500, True), answer.text
    stored = service.store.inspection(inspection_id)
    assert (stored.state, stored.verdict) == ("failed", None)
    assert "the checkpoint cannot be read" in (stored.reason or "")
