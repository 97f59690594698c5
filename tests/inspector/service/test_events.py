"""Events: everything that happens, in order, for as many as listen; what cannot be told any more is said."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.service.events import EVERY, Event, Events, TooManyListeners
from tests.patience import SECONDS


async def take(events: Events, last_id: str | None, count: int) -> list[Event]:
    """The next so many events."""
    got: list[Event] = []
    async for batch in events.since(last_id):
        got += batch
        if len(got) >= count:
            break
    return got[:count]


def run(work: Any) -> Any:
    return asyncio.run(asyncio.wait_for(work, SECONDS))


@given(st.integers(0, 30), st.integers(1, 30))
def test_who_comes_back_goes_on_where_it_left(heard: int, told: int):
    async def work() -> None:
        events = Events(remembered=100)
        for number in range(heard + told):
            events.publish("it", number=number)
        all_of_it = await take(events, f"{first(events)}-{0}", heard + told - 1) if heard + told > 1 else []
        if heard:
            rest = await take(events, f"{first(events)}-{heard - 1}", told)
            assert [json.loads(each.data)["number"] for each in rest] == list(range(heard, heard + told))
        assert [json.loads(each.data)["number"] for each in all_of_it] == list(range(1, heard + told))

    run(work())


def first(events: Events) -> str:
    return events._events[0].id.rpartition("-")[0] if events._events else ""


def test_who_is_new_hears_only_what_comes():
    async def work() -> list[Event]:
        events = Events()
        events.publish("before")
        listening = asyncio.create_task(take(events, None, 2))
        await asyncio.sleep(0)
        events.publish("one")
        events.publish("two")
        return await listening

    assert [event.kind for event in run(work())] == ["one", "two"]


@pytest.mark.parametrize("last_id", ["other-3", "nonsense", "-1", ""])
def test_who_comes_from_before_the_last_start_is_told_to_read_again(last_id: str):
    async def work() -> list[Event]:
        events = Events()
        events.publish("old")
        listening = asyncio.create_task(take(events, last_id, 2))
        await asyncio.sleep(0)
        events.publish("new")
        return await listening

    assert [event.kind for event in run(work())] == ["missed", "new"]


def test_who_is_slow_misses_the_oldest_and_is_told_how_many():
    async def work() -> list[Event]:
        events = Events(remembered=10)
        events.publish("first")
        mark = events._events[0].id
        for number in range(25):
            events.publish("it", number=number)
        return await take(events, mark, 11)

    got = run(work())
    assert json.loads(got[0].data) == {"count": 15}
    assert [json.loads(each.data)["number"] for each in got[1:]] == list(range(15, 25))


def test_there_is_room_for_so_many_and_it_is_given_back():
    events = Events(max_listeners=1)
    with events.listening(), pytest.raises(TooManyListeners):
        events.check_room()
    events.check_room()


def test_they_end_when_the_service_does():
    async def work() -> int:
        events = Events()

        async def all_of_it() -> int:
            return len([batch async for batch in events.since(None)])

        listening = asyncio.create_task(all_of_it())
        await asyncio.sleep(0)
        events.close()
        return await listening

    assert run(work()) == 0


@pytest.mark.parametrize(("asked", "told"), [(EVERY, ["a2", "b1"]), ("b", ["b1"]), ("c", []), (None, [])])
def test_pictures_are_told_to_who_asked_for_them_and_only_the_latest(asked: str | None, told: list[str]):
    async def work() -> tuple[list[Event], int]:
        events = Events()
        heard: list[Event] = []

        async def listen() -> None:
            with events.listening(asked):
                async for batch in events.since(None, asked):
                    heard.extend(batch)

        async def until(kind: str, count: int) -> None:
            while [each.kind for each in heard].count(kind) < count:
                await asyncio.sleep(0)

        listening = asyncio.create_task(listen())
        await asyncio.sleep(0)
        watching = events.watching("b")
        for inspection, data in (("a", "a1"), ("a", "a2"), ("gone", "g1"), ("b", "b1")):
            events.show(inspection, data)
        events.forget("gone")
        await until("picture", len(told))
        events.publish("it")
        await until("it", 1)
        events.close()
        await listening
        return heard, watching

    heard, watching = run(work())
    assert sorted(each.data for each in heard if each.kind == "picture") == told
    assert [each.kind for each in heard].count("it") == 1
    assert all(each.id == "" for each in heard if each.kind == "picture")
    assert watching == (asked in (EVERY, "b"))
