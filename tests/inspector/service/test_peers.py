"""Services that share a store: each hears what happens at the others, and finds out who is gone."""

from __future__ import annotations

import asyncio
import itertools
import json
import threading
import time
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import psycopg
import pytest

from inspector.service import heart
from inspector.service import peers as module
from inspector.service.events import EVERY, Event, Events
from inspector.service.heart import GONE, STOPPED
from inspector.service.peers import Peers
from inspector.stores import AbstractStore, open_store
from tests.contracts.stores import NOW, begin, behind, engine, learnt
from tests.patience import SECONDS
from tests.postgresql import Server


class Place:
    """One service's share of it."""

    def __init__(self, store: AbstractStore) -> None:
        self.store, self.events = store, Events()
        self.facts: dict[str, Any] = {"running": 0}
        self.peers = Peers(store, self.events, facts=lambda: self.facts)

    def told(self, kind: str) -> list[Any]:
        """What is remembered of a kind."""
        return [json.loads(event.data) for event in self.events._events if event.kind == kind]


@asynccontextmanager
async def places(url: str, count: int = 2) -> AsyncGenerator[list[Place]]:
    """So many services, which know of each other."""
    made = [Place(await asyncio.to_thread(open_store, url)) for _ in range(count)]
    try:
        for place in made:
            place.events.start()
            await place.peers.start()
        await until(lambda: all(len(place.peers.nodes) == count for place in made))
        yield made
    finally:
        for place in made:
            await place.peers.stop()
            await asyncio.to_thread(place.store.close)


async def until(true: Callable[[], object]) -> None:
    """Wait for it."""
    async with asyncio.timeout(SECONDS):
        while not true():
            await asyncio.sleep(0.01)


def run(work: Awaitable[None]) -> None:
    asyncio.run(work)  # pyright: ignore[reportArgumentType]


@pytest.fixture(autouse=True)
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heart, "BEAT_SECONDS", 0.05)
    monkeypatch.setattr(module, "TELL_SECONDS", 0.05)


def test_what_happens_at_one_is_told_at_all_in_its_order_and_to_nobody_twice(postgresql: Server) -> None:
    async def work() -> None:
        async with places(postgresql.new_database(), 3) as (one, two, three):
            for number in range(500):
                one.events.publish("begun", number=number, text="grün, \n" + "x" * (number % 7 == 0) * 9000)
            two.events.publish("verdict", inspection_id="i1")
            for place in (one, two, three):
                await until(lambda place=place: len(place.told("begun")) == 500 and place.told("verdict"))
                assert [each["number"] for each in place.told("begun")] == list(range(500))
                assert place.told("begun")[7]["text"] == "grün, \n" + "x" * 9000
                assert len(place.told("verdict")) == 1
            ids = {event.id.partition("-")[0] for event in three.events._events}
            assert ids == {three.events._boot}

    run(work())


def test_scores_are_told_where_somebody_listens_and_what_is_about_one_service_nowhere(postgresql: Server) -> None:
    async def work() -> None:
        async with places(postgresql.new_database()) as (one, two):
            await until(lambda: one.peers.nodes[1].facts.get("listening") is False)
            for kind in ("scores", "station", "begun"):
                one.events.publish(kind, first=True)
            await until(lambda: two.told("begun"))
            assert two.told("scores") == two.told("station") == []
            with two.events.listening():
                await until(lambda: one.peers.nodes[1].facts.get("listening"))
                one.events.publish("scores", second=True)
                await until(lambda: two.told("scores"))
            assert two.told("scores") == [{"second": True}]
            assert two.told("missed") == []

    run(work())


def test_who_listens_again_after_a_while_is_told_that_scores_are_missing(
    postgresql: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_LINGER_SECONDS", 0.2)

    async def work() -> None:
        async with places(postgresql.new_database()) as (one, two):
            with two.events.listening():
                await until(lambda: one.peers.nodes[1].facts.get("listening"))
            await until(lambda: not one.peers.nodes[1].facts.get("listening"))
            assert two.told("missed") == []
            with two.events.listening():
                await until(lambda: two.told("missed"))

    run(work())


def test_pictures_go_to_services_where_somebody_looks(postgresql: Server) -> None:
    async def seen(events: Events, pictures: str, count: int) -> list[Event]:
        got: list[Event] = []
        with events.listening(pictures):
            async for batch in events.since(None, pictures):
                got += [event for event in batch if event.kind == "picture"]
                if len(got) >= count:
                    break
        return got

    async def work() -> None:
        async with places(postgresql.new_database(), 3) as (one, two, three):
            one.events.show("i1", '"nobody looks"')
            assert one.events.watching("i1") == 0
            looking = asyncio.create_task(seen(two.events, "i1", 1))
            all_of_them = asyncio.create_task(seen(three.events, EVERY, 2))
            await until(lambda: (one.events.watching("i1"), one.events.watching("i2")) == (2, 1))
            one.events.show("i1", '"%s"' % ("x" * 50_000))
            one.events.show("i2", '"second"')
            assert [event.data for event in await looking] == ['"%s"' % ("x" * 50_000)]
            assert {event.data[:4] for event in await all_of_them} == {'"xxx', '"sec'}
            assert "i2" not in two.events._pictures
            one.events.publish("verdict", inspection_id="i1")
            await until(lambda: "i1" not in three.events._pictures)
            await until(lambda: one.events.watching("i1") == 0)

    run(work())


def test_pictures_are_rationed_and_the_latest_is_the_one_that_is_told(postgresql: Server) -> None:
    async def work() -> None:
        async with places(postgresql.new_database()) as (one, two):
            with two.events.listening(EVERY):
                await until(lambda: one.events.watching("i1"))
                numbers, begun = itertools.count(), time.monotonic()
                while (number := next(numbers)) < 100 or not two.events._told_pictures:
                    for k in range(4):
                        one.events.show(f"i{k}", json.dumps({"number": number, "picture": "x" * 100_000}))
                    await asyncio.sleep(0.005)
                seen, seconds = two.events._told_pictures, time.monotonic() - begun
                # The first of each time may take more than is left of the ration.
                assert seen <= (seconds + 2 * module.TELL_SECONDS) * module._PICTURE_BYTES / 100_000 + 1
                assert seen < 4 * number
                await until(lambda: len(two.events._pictures) == 4)
                last = f'"number": {number - 1},'
                await until(lambda: all(last in event.data for _, event in two.events._pictures.values()))

    run(work())


def test_one_asks_another_for_something(postgresql: Server) -> None:
    async def work() -> None:
        async with places(postgresql.new_database(), 3) as (one, two, three):
            asked: list[tuple[str, object]] = []
            for name, place in (("two", two), ("three", three)):
                place.peers.on("hand over", lambda facts, name=name: asked.append((name, facts)))
            assert one.peers.ask(three.peers.node_id, "hand over", inspection_id="i1")
            await until(lambda: asked)
            assert asked == [("three", {"inspection_id": "i1"})]
            assert not one.peers.ask("nobody", "hand over", inspection_id="i1")
            await three.peers.stop()
            await until(lambda: len(one.peers.nodes) == 2)
            assert not one.peers.ask(three.peers.node_id, "hand over", inspection_id="i1")

    run(work())


def test_who_is_silent_is_buried_and_all_are_told_what_it_had(
    postgresql: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(heart, "DEAD_SECONDS", 4.0)

    async def work() -> None:
        async with places(postgresql.new_database()) as (one, two):
            learnt(one.store)
            one.store.join("dead", "dead", NOW)
            begin(one.store, "i1", node="dead")
            begin(one.store, "i2", node=two.peers.node_id)
            one.store.add_job("j1", "learn", "plate", {}, NOW, node="dead")
            for place in (one, two):
                await until(lambda place=place: place.told("interrupted"))
                assert place.told("interrupted") == [{"inspection_id": "i1", "product_id": "plate", "reason": GONE}]
                assert [job["job_id"] for job in place.told("job")] == ["j1"]
                await until(lambda place=place: len(place.peers.nodes) == 2)
            assert (one.store.job("j1").error, one.store.inspection("i2").node) == (GONE, two.peers.node_id)

    run(work())


def test_what_a_service_that_stops_did_not_end_is_free(postgresql: Server) -> None:
    async def work() -> None:
        async with places(postgresql.new_database()) as (one, two):
            learnt(one.store)
            begin(one.store, "i1", node=two.peers.node_id)
            one.store.add_job("j1", "learn", "plate", {}, NOW, node=two.peers.node_id)
            await two.peers.stop()
            assert (one.store.job("j1").error, one.store.inspection("i1").node) == (STOPPED, None)
            await until(lambda: one.told("interrupted"))
            assert [job["job_id"] for job in one.told("job")] == ["j1"]

    run(work())


def test_what_was_left_before_services_had_names_is_free_when_one_starts(postgresql: Server) -> None:
    url = postgresql.new_database()
    with open_store(url) as store:
        store.add_job("j1", "learn", "plate", {}, NOW)

    async def work() -> None:
        async with places(url, 1) as (one,):
            assert one.store.job("j1").state == "failed"

    run(work())


def test_who_was_taken_for_gone_joins_again(postgresql: Server) -> None:
    async def work() -> None:
        async with places(postgresql.new_database()) as (one, two):
            one.store.leave(two.peers.node_id, "a mistake")
            await until(lambda: two.peers.node_id in {node.node_id for node in one.store.nodes()})
            two.events.publish("begun")
            await until(lambda: one.told("begun"))

    run(work())


def test_a_database_that_was_away_buries_nobody_and_what_may_be_missing_is_said(
    postgresql: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(heart, "DEAD_SECONDS", 4.0)

    async def work() -> None:
        async with places(postgresql.new_database()) as (one, two):
            learnt(one.store)
            for place, inspection_id in ((one, "i1"), (two, "i2")):
                begin(one.store, inspection_id, node=place.peers.node_id)
            with psycopg.connect(postgresql.url(), autocommit=True) as connection:
                name = engine(one.store).url.database or ""
                connection.execute(f"ALTER DATABASE {name} ALLOW_CONNECTIONS false".encode())
                gone = "SELECT pg_terminate_backend(pid, 10000) FROM pg_stat_activity WHERE datname = %s"
                connection.execute(gone, [name])
                await until(lambda: one.peers.troubles() and two.peers.troubles())
                assert "do not hear from this one" in one.peers.troubles()[0]
                one.events.publish("begun", number=1)
                # Longer than a service may be silent.
                await asyncio.sleep(4.2)
                connection.execute(f"ALTER DATABASE {name} ALLOW_CONNECTIONS true".encode())
            await until(lambda: not one.peers.troubles() and not two.peers.troubles())
            for place in (one, two):
                await until(lambda place=place: place.told("missed"))
            one.events.publish("begun", number=2)
            await until(lambda: {"number": 2} in two.told("begun"))
            assert one.store.ownerless() == ()

    run(work())


def test_a_change_of_which_no_event_tells_is_noticed_elsewhere(postgresql: Server) -> None:
    async def work() -> None:
        async with places(postgresql.new_database()) as (one, two):
            before = two.events.changes
            one.events.changed()
            await until(lambda: two.events.changes > before)
            assert not two.events._events

    run(work())


def test_a_service_alone_with_its_store_does_nothing_for_others() -> None:
    async def work() -> None:
        threads = threading.active_count()
        with open_store("memory:") as store:
            place = Place(store)
            await place.peers.start()
            assert [node.node_id for node in place.peers.nodes] == [place.peers.node_id]
            place.events.publish("begun")
            assert not place.peers.ask("nobody", "hand over")
            assert place.peers.troubles() == []
            assert (threading.active_count(), place.events.told, store.nodes()) == (threads, None, ())
            await place.peers.stop()

    run(work())


def test_a_message_that_is_not_understood_does_no_harm(postgresql: Server) -> None:
    async def work() -> None:
        async with places(postgresql.new_database()) as (one, two):
            one.store.tell(b'{"from": "a newer one", "do": "dance"}')
            behind(one.store, "NOTIFY inspector, '#999999'")
            one.events.publish("begun")
            await until(lambda: two.told("begun"))

    run(work())
