"""An inspection that moves from one real scorer process to another says what one that stays says, to the last bit."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inspector.recording import SweepReader, join_parts
from inspector.replay import replay
from inspector.scorers.pool import Pool
from inspector.scorers.wire import Head
from models.frame import Frame
from models.verdict import Policy
from tests.inspector.scorers.test_pool import PATIENCE, Heard, begin, frames, learnt, question, with_pool

POLICY = {"sensitivity": 1.2}


def another_part() -> list[Frame]:
    return [*frames("part=casting&unit=3&seed=3")]


def another_part_first() -> list[Frame]:
    """Turned upside down for some frames, then as it should lie; numbered and timed as one sweep."""
    right = frames()
    wrong = [Frame(np.ascontiguousarray(each.pixels[::-1, ::-1]), 0, 0) for each in right[::-1][:8]]
    step_ns = right[1].t_ns - right[0].t_ns
    return [Frame(each.pixels, right[0].t_ns + i * step_ns, i) for i, each in enumerate([*wrong, *right])]


SWEEPS = {
    "a defect": lambda: [*frames()],
    "another part": another_part,
    "another part first": another_part_first,
}

TOLD = {
    "a defect": {"deviation_opened", "early_ng"},
    "another part": {"early_invalid"},
    "another part first": {"early_invalid", "part_found"},
}
"""What is said in the course of each, among other things."""


@dataclass
class Kept:
    """What a store keeps of an inspection, and what was said of it so far."""

    state: bytes = b""
    added: list[bytes] = field(default_factory=list[bytes])
    said: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    doubted: list[bytes] = field(default_factory=list[bytes])
    parts: list[Path] = field(default_factory=list[Path])

    def begin(self, folder: Path) -> tuple[Head, bytes]:
        self.parts.append(folder / f"{len(self.parts)}.mcap")
        head = begin("one", self.parts[-1]) | {"policy": POLICY}
        if not self.state:
            return head, b""
        sizes = [len(self.state), *map(len, self.added)]
        return head | {"resume": sizes}, b"".join((self.state, *self.added))

    async def hear(self, heard: Heard, did: str) -> tuple[Head, bytes]:
        """The answer of that kind; what is said of frames before it is kept."""
        while True:
            head, body = await asyncio.wait_for(heard.answers.get(), PATIENCE)
            if head["did"] == did:
                return head, body
            if head["did"] == "doubted":
                self.doubted.append(body)
            elif head["did"] == "frame":
                self.said += [json.loads(line) for line in body.splitlines()]
            else:
                assert head["did"] == "begun", head

    async def save(self, heard: Heard) -> Head:
        head, body = await self.hear(heard, "checkpoint")
        self.state = body[: head["size"]]
        self.added.append(body[head["size"] :])
        return head


async def through(pool: Pool, sweep: list[Frame], folder: Path, every: int | None) -> tuple[Kept, Head, bytes]:
    """A sweep that moves to the other scorer after every so many frames; never where that is None."""
    kept, scorers = Kept(), cycle(pool.scorers)
    scorer, heard = next(scorers), Heard()
    scorer.ask(heard, *kept.begin(folder))
    await kept.hear(heard, "begun")
    for i, frame in enumerate(sweep):
        if every is not None and i and i % every == 0:
            scorer.ask(heard, {"do": "checkpoint", "id": "one"})
            scorer.ask(heard, {"do": "release", "id": "one"})
            told = await kept.save(heard)
            assert told["sequence"] == sweep[i - 1].sequence
            released, _ = await kept.hear(heard, "released")
            assert released["recording"]["frames"] == every
            scorer.forget("one")
            scorer, heard = next(scorers), Heard()
            scorer.ask(heard, *kept.begin(folder))
            await kept.hear(heard, "begun")
        scorer.ask(heard, *question("one", frame))
    scorer.ask(heard, {"do": "conclude", "id": "one", "announced": len(sweep) + 1})
    concluded, body = await kept.hear(heard, "concluded")
    return kept, concluded, body


@pytest.mark.parametrize(("name", "every"), [*((name, 1) for name in SWEEPS), ("a defect", 7)])
def test_moved_again_and_again_it_says_the_same_to_the_last_bit(name: str, every: int, tmp_path: Path):
    sweep = SWEEPS[name]()
    for folder in ("stays", "moves"):
        (tmp_path / folder).mkdir()

    async def work(pool: Pool) -> list[tuple[Kept, Head, bytes]]:
        stays = await through(pool, sweep, tmp_path / "stays", None)
        pool.scorers[0].forget("one")
        return [stays, await through(pool, sweep, tmp_path / "moves", every)]

    (stays, wanted, scores), (moves, concluded, moved_scores) = with_pool(work, 2)
    assert moves.said == stays.said
    assert moves.doubted == stays.doubted
    assert concluded["result"] == wanted["result"]
    assert (concluded["doubted"], moved_scores) == (wanted["doubted"], scores)
    replayed = replay(SweepReader(stays.parts[0]), learnt()[0], Policy(**POLICY))
    assert concluded["result"]["digest"] == replayed.result.digest
    pictures = [frame.encoded for part in moves.parts for frame in SweepReader(part)]
    assert pictures == [frame.encoded for frame in SweepReader(stays.parts[0])]
    told = {each["kind"] for each in stays.said}
    assert TOLD[name] <= told
    assert bool(stays.doubted) is ("early_invalid" in told)


def test_after_a_kill_it_goes_on_from_the_last_checkpoint(tmp_path: Path):
    sweep = SWEEPS["a defect"]()

    async def work(pool: Pool) -> tuple[Kept, Head]:
        kept, first, second = Kept(), *pool.scorers
        heard = Heard()
        first.ask(heard, *kept.begin(tmp_path))
        for i, frame in enumerate(sweep[:25]):
            first.ask(heard, *question("one", frame))
            if i in (9, 19):
                first.ask(heard, {"do": "checkpoint", "id": "one"})
        await kept.hear(heard, "begun")
        await kept.save(heard)
        told = await kept.save(heard)
        while len(heard.order) < 23:
            await asyncio.sleep(0.001)
        assert first.pid is not None
        os.kill(first.pid, signal.SIGKILL)
        await asyncio.wait_for(heard.dead, PATIENCE)
        assert told["sequence"] == 19
        again = Heard()
        second.ask(again, *kept.begin(tmp_path))
        for frame in sweep[told["sequence"] + 1 :]:
            second.ask(again, *question("one", frame))
        second.ask(again, {"do": "conclude", "id": "one", "announced": len(sweep)})
        return kept, (await kept.hear(again, "concluded"))[0]

    kept, concluded = with_pool(work, 2)
    # what the checkpoint says was scored is on the disk, too
    assert len([*SweepReader(kept.parts[0])]) >= 20
    join_parts(kept.parts, [0, 20], tmp_path / "whole.mcap")
    replayed = replay(SweepReader(tmp_path / "whole.mcap"), learnt()[0], Policy(**POLICY))
    assert concluded["result"]["digest"] == replayed.result.digest
    assert replayed.result.frames_scored == concluded["result"]["frames_scored"]


def test_a_checkpoint_that_cannot_be_gone_on_with_is_told_and_nothing_is_recorded(tmp_path: Path):
    sweep = SWEEPS["a defect"]()[:5]

    async def work(pool: Pool) -> list[str]:
        kept, scorer, heard = Kept(), pool.scorers[0], Heard()
        scorer.ask(heard, *kept.begin(tmp_path))
        await kept.hear(heard, "begun")
        for frame in sweep:
            scorer.ask(heard, *question("one", frame))
        scorer.ask(heard, {"do": "checkpoint", "id": "one"})
        await kept.save(heard)
        head, body = kept.begin(tmp_path)
        names = {"id": "two"}
        spoilt = [
            (names | {"policy": {"sensitivity": 1.3}}, body),
            (names, body[:-1]),
            (names, bytes([*body[:100], body[100] ^ 1, *body[101:]])),
            (names | {"resume": [head["resume"][0]]}, body[: head["resume"][0]]),
            (names | {"resume": [10]}, body),
            (names | {"resume": [0]}, b""),
        ]
        answers, other = list[str](), Heard()
        for change, data in spoilt:
            scorer.ask(other, head | change, data)
            answers.append((await kept.hear(other, "failed"))[0]["why"])
        return answers

    answers = with_pool(work)
    assert all("checkpoint" in answer for answer in answers)
    assert "allowed is Policy(" in answers[0]
    assert not (tmp_path / "1.mcap").exists()


def test_a_checkpoint_before_the_first_frame_and_of_frames_that_were_refused(tmp_path: Path):
    frame = frames()[0]

    async def work(pool: Pool) -> tuple[Kept, list[Head]]:
        kept, (first, second) = Kept(), pool.scorers
        heard, told = Heard(), list[Head]()
        first.ask(heard, *kept.begin(tmp_path))
        first.ask(heard, {"do": "checkpoint", "id": "one"})
        head, picture = question("one", frame)
        first.ask(heard, head, picture[:50])
        first.ask(heard, {"do": "checkpoint", "id": "one"})
        await kept.hear(heard, "begun")
        told += [await kept.save(heard), await kept.save(heard)]
        again = Heard()
        second.ask(again, *kept.begin(tmp_path))
        second.ask(again, {"do": "checkpoint", "id": "one"})
        return kept, [*told, await kept.save(again)]

    kept, told = with_pool(work, 2)
    assert [each["sequence"] for each in told] == [None, frame.sequence, frame.sequence]
    assert kept.added == [b"", b"", b""]
