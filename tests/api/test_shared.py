"""Answers that many ask for: made once, never older than the last change."""

from __future__ import annotations

import asyncio
import threading

import pytest

from api.shared import Shared
from inspector.service.events import Events


def test_who_asks_at_the_same_time_gets_the_same_answer():
    async def work() -> tuple[list[bytes], int]:
        shared, made, go = Shared(Events()), 0, threading.Event()

        def make() -> bytes:
            nonlocal made
            made += 1
            go.wait(10)
            return b"%d" % made

        asking = [asyncio.create_task(shared.get("it", make)) for _ in range(5)]
        await asyncio.sleep(0)
        asking[0].cancel()
        go.set()
        return await asyncio.gather(*asking[1:]), made

    assert asyncio.run(work()) == ([b"1"] * 4, 1)


@pytest.mark.parametrize("change", ["publish", "changed"])
def test_after_a_change_it_is_made_again(change: str):
    async def work() -> list[bytes]:
        events, answers = Events(), iter((b"old", b"new"))
        shared = Shared(events)
        before = await shared.get("it", lambda: next(answers))
        if change == "publish":
            events.publish("verdict")
        else:
            events.changed()
        return [before, await shared.get("it", lambda: next(answers))]

    assert asyncio.run(work()) == [b"old", b"new"]


def test_what_went_wrong_is_not_kept():
    async def work() -> bytes:
        shared = Shared(Events())

        def fail() -> bytes:
            raise ValueError("no disk")

        with pytest.raises(ValueError, match="no disk"):
            await shared.get("it", fail)
        return await shared.get("it", lambda: b"there")

    assert asyncio.run(work()) == b"there"
