"""Those who only look: their requests take turns, and pictures are rationed by all who watch together."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.service.load import Ration, Turns


def test_requests_that_read_come_in_order_and_apart():
    async def work() -> tuple[float, list[tuple[int, float]]]:
        turns, loop, came = Turns(), asyncio.get_running_loop(), list[tuple[int, float]]()
        begun = loop.time()

        async def one(number: int) -> None:
            await turns.wait()
            came.append((number, loop.time()))

        await asyncio.gather(*map(one, range(8)))
        return begun, came

    begun, came = asyncio.run(work())
    assert [number for number, _ in came] == list(range(8))
    # Not before its turn; how much later is the machine's.
    assert all(at - begun >= 0.004 * number for number, at in came)


@given(st.lists(st.tuples(st.integers(0, 64), st.integers(0, 1 << 20)), min_size=1, max_size=400))
def test_no_more_pictures_go_out_than_the_ration_allows(asked: list[tuple[int, int]]):
    ration, told, largest = Ration(), 0.0, 0.0
    for watching, size in asked:
        ration.refill(0.25)
        if ration.take(watching, size):
            cost = watching * max(1.0, size / 65536)
            told, largest = told + cost, max(largest, cost)
    # What the last one took too much is paid for by those that come.
    assert told <= 80 * 0.25 * len(asked) + largest


@pytest.mark.parametrize(("watching", "running", "each"), [(1, 1, 4.0), (20, 1, 4.0), (20, 4, 1.0), (64, 1, 1.25)])
def test_how_often_each_picture_is_told(watching: int, running: int, each: float):
    ration, told = Ration(), [0] * running
    for tick in range(4 * 60):
        ration.refill(0.25)
        for number in sorted(range(running), key=lambda number: told[number]):
            told[number] += ration.take(watching, 30_000)
        assert max(told) <= tick + 1
    assert sum(told) / running / 60 == pytest.approx(each, rel=0.05)
