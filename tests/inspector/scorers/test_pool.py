"""Real scorer processes: the digest of a replay, whose turn it is, what happens when one dies."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from inspector.cameras import open_camera
from inspector.learner import learn_recordings
from inspector.pictures import encode_jpeg
from inspector.recorder import record
from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.scorers import pool as module
from inspector.scorers.pool import Pool
from inspector.scorers.wire import Head
from models.appearance import Appearance
from models.frame import Frame
from tests.patience import SECONDS

LINE = "simulated:?frames=40&size=240x180&part=plate&path=line"
MAX_PIXELS = 320 * 240
PATIENCE = SECONDS
REST = module._REST_SECONDS


class Heard:
    """Keeps what a scorer says of one inspection."""

    def __init__(self) -> None:
        self.answers: asyncio.Queue[tuple[Head, bytes]] = asyncio.Queue()
        self.dead: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self.order: list[int] = []

    def heard(self, head: Head, body: bytes) -> None:
        if head["did"] == "frame":
            self.order.append(head["sequence"])
        self.answers.put_nowait((head, body))

    def sent(self, head: Head) -> None:
        pass

    def died(self, why: str) -> None:
        self.dead.set_result(why)

    async def until(self, did: str) -> tuple[list[dict[str, Any]], Head, bytes]:
        """All messages about frames, up to the answer of that kind."""
        said: list[dict[str, Any]] = []
        while True:
            head, body = await asyncio.wait_for(self.answers.get(), PATIENCE)
            if head["did"] == did:
                return said, head, body
            said += [json.loads(line) for line in body.splitlines()]


@cache
def folder() -> Path:
    import tempfile

    return Path(tempfile.mkdtemp(prefix="scorers-"))


@cache
def learnt() -> tuple[Appearance, Path]:
    golden, out = folder() / "golden.mcap", folder() / "plate.appearance"
    with open_camera(f"{LINE}&unit=1&seed=1") as camera:
        record(camera, golden, lossless=True)
    return learn_recordings([golden], out), out


@cache
def frames(options: str = "unit=2&seed=2&defect=extra&at=0.3") -> tuple[Frame, ...]:
    with open_camera(f"{LINE}&{options}") as camera:
        return tuple(camera.frames())


def begin(name: str, recording: Path) -> Head:
    appearance, path = learnt()
    names = dict.fromkeys(("product_id", "part_id", "recipe_id", "result_id"), "x") | {"inspection_id": name}
    about = {"appearance_id": appearance.id, "path": str(path), "policy": {}, "names": names}
    return {"do": "begin", "id": name, "record_to": str(recording)} | about


def question(name: str, frame: Frame) -> tuple[Head, bytes]:
    head = {"do": "frame", "id": name, "sequence": frame.sequence, "t_ns": frame.t_ns, "encoder": frame.encoder}
    return head, (frame.encoded or encode_jpeg(frame.pixels)).data


def with_pool(work: Any, count: int = 1) -> Any:
    async def all_of_it() -> Any:
        pool = Pool(count, MAX_PIXELS)
        await pool.start()
        try:
            return await work(pool)
        finally:
            await pool.stop()

    return asyncio.run(all_of_it())


def test_what_is_scored_is_recorded_and_replays_to_the_same_digest(tmp_path: Path):
    path = tmp_path / "one.mcap"

    async def work(pool: Pool) -> tuple[list[dict[str, Any]], Head, bytes]:
        scorer, heard = pool.least(), Heard()
        assert scorer is not None
        scorer.ask(heard, begin("one", path))
        for frame in frames():
            scorer.ask(heard, *question("one", frame))
        scorer.ask(heard, {"do": "conclude", "id": "one", "announced": len(frames())})
        return await heard.until("concluded")

    said, head, body = with_pool(work)
    replayed = replay(SweepReader(path), learnt()[0])
    result = head["result"]
    assert result["verdict"] == "NG"
    assert result["digest"] == replayed.result.digest
    assert replayed.facts["inspection_id"] == "one"
    listed = json.loads(body[: head["json"]])
    scored = [each for each in said if each["kind"] == "scored"]
    assert [{k: v for k, v in each.items() if k not in ("kind", "sequence")} for each in scored] == listed
    opened = [each["deviation"]["index_start"] for each in said if each["kind"] == "deviation_opened"]
    assert sorted(opened) == [each["index_start"] for each in result["deviations"]]
    assert [each["kind"] for each in said].count("early_ng") == 1
    assert head["recording"] == {"frames": len(frames()), "bytes": path.stat().st_size, "note": None}


def test_what_is_no_picture_of_the_part_is_refused_in_words_and_counted(tmp_path: Path):
    async def work(pool: Pool) -> tuple[list[dict[str, Any]], Head, bytes]:
        scorer, heard = pool.least(), Heard()
        assert scorer is not None
        scorer.ask(heard, begin("one", tmp_path / "one.mcap"))
        first, second, *rest = frames()
        for frame in (first, *rest):
            scorer.ask(heard, *question("one", frame))
            if frame is first:
                head, picture = question("one", second)
                scorer.ask(heard, head, picture[: len(picture) // 2])
        head, _ = question("one", rest[-1])
        with open_camera(LINE.replace("240x180", "320x240")) as camera:
            large = next(camera.frames())
        scorer.ask(heard, head | {"sequence": rest[-1].sequence + 1}, question("one", large)[1])
        scorer.ask(heard, {"do": "conclude", "id": "one", "announced": len(frames()) + 1})
        return await heard.until("concluded")

    said, head, _ = with_pool(work)
    refused = [each for each in said if each["kind"] == "refused"]
    assert [each["sequence"] for each in refused] == [1, len(frames())]
    assert "jpeg" in refused[0]["why"]
    assert "320x240" in refused[1]["why"]
    assert head["result"]["frames_dropped"] == 2
    again = SweepReader(tmp_path / "one.mcap")
    assert [frame.sequence for frame in again] == [0, *range(2, len(frames()))]
    assert sum(drop.count for drop in again.drops) == 2


def test_two_inspections_take_turns_and_do_not_mix(tmp_path: Path):
    good = "unit=3&seed=3"

    async def work(pool: Pool) -> tuple[Any, Any, list[int]]:
        scorer, eager, slow = pool.least(), Heard(), Heard()
        assert scorer is not None
        for name, heard in (("eager", eager), ("slow", slow)):
            scorer.ask(heard, begin(name, tmp_path / f"{name}.mcap"))
        for frame in frames():
            scorer.ask(eager, *question("eager", frame))
        when = list[int]()
        for frame in frames(good):
            scorer.ask(slow, *question("slow", frame))
            while frame.sequence not in slow.order:
                await asyncio.sleep(0.001)
            when.append(len(eager.order))
        for name, heard in (("eager", eager), ("slow", slow)):
            scorer.ask(heard, {"do": "conclude", "id": name, "announced": len(frames())})
        return await eager.until("concluded"), await slow.until("concluded"), when

    eager, slow, when = with_pool(work)
    assert (eager[1]["result"]["verdict"], slow[1]["result"]["verdict"]) == ("NG", "OK")
    # The one that comes frame by frame never waits for all that the other has handed in.
    assert when[5] < len(frames()) / 2


def test_a_scorer_that_dies_says_so_and_is_started_again(tmp_path: Path):
    async def work(pool: Pool) -> tuple[str, int]:
        scorer, heard = pool.least(), Heard()
        assert scorer is not None
        scorer.ask(heard, begin("one", tmp_path / "one.mcap"))
        await heard.until("begun")
        assert scorer.pid is not None
        os.kill(scorer.pid, signal.SIGKILL)
        why = await asyncio.wait_for(heard.dead, PATIENCE)
        while not scorer.alive:
            await asyncio.sleep(0.01)
        after = Heard()
        scorer.ask(after, begin("two", tmp_path / "two.mcap"))
        await after.until("begun")
        return why, scorer.restarts

    why, restarts = with_pool(work)
    assert "ended unexpectedly (code -9)" in why
    assert restarts == 1


@pytest.mark.parametrize("later", [0.0, REST + 0.02], ids=["before the next is started", "while the next is started"])
def test_a_pool_stops_where_a_scorer_has_just_died(later: float, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "_PATIENCE_SECONDS", 1000 * PATIENCE)

    async def work() -> None:
        pool = Pool(1, MAX_PIXELS)
        await pool.start()
        (scorer,) = pool.scorers
        assert scorer.pid is not None
        os.kill(scorer.pid, signal.SIGKILL)
        while not scorer.restarts:
            await asyncio.sleep(0.001)
        await asyncio.sleep(later)
        await asyncio.wait_for(pool.stop(), PATIENCE)
        assert not scorer.alive

    asyncio.run(work())


def test_an_appearance_that_is_not_the_one_that_was_meant_is_told(tmp_path: Path):
    async def work(pool: Pool) -> str:
        scorer, heard = pool.least(), Heard()
        assert scorer is not None
        scorer.ask(heard, begin("one", tmp_path / "one.mcap") | {"appearance_id": "sha256:other"})
        return (await heard.until("failed"))[1]["why"]

    assert "its file holds another one" in with_pool(work)


def test_stopping_closes_recordings_that_nobody_concluded(tmp_path: Path):
    async def work(pool: Pool) -> None:
        scorer, heard = pool.least(), Heard()
        assert scorer is not None
        scorer.ask(heard, begin("one", tmp_path / "one.mcap"))
        for frame in frames()[:10]:
            scorer.ask(heard, *question("one", frame))
        while len(heard.order) < 10:
            await asyncio.sleep(0.001)

    with_pool(work)
    recording = SweepReader(tmp_path / "one.mcap")
    assert len(list(recording)) == 10
    assert recording.losses == ()


@pytest.mark.parametrize("count", [2])
def test_inspections_go_to_the_scorer_with_the_fewest(tmp_path: Path, count: int):
    async def work(pool: Pool) -> list[int]:
        pinned = list[int]()
        for number in range(4):
            scorer, heard = pool.least(), Heard()
            assert scorer is not None
            scorer.ask(heard, begin(f"i{number}", tmp_path / f"{number}.mcap"))
            pinned.append(scorer.number)
        return pinned

    assert with_pool(work, count) == [0, 1, 0, 1]
