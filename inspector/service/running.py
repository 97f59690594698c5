"""One running inspection on the side of the service: what was accepted, what waits, and every message said of it."""

from __future__ import annotations

import asyncio
import json
import time
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any, Literal
from uuid import uuid4

from inspector.picture_headers import kind_of
from inspector.protocol import ANSWERS, SentFrame
from inspector.scorers.pool import Scorer
from inspector.scorers.wire import Head
from inspector.service.checkpoints import Cut, Ledger, Restored
from inspector.service.errors import Busy, Moved, NotOpen, OutOfOrder, ResumeFrom, ScorerLost, TooManyFrames
from inspector.service.events import Events
from inspector.service.folder import new_id
from inspector.service.load import Load, Ration
from inspector.service.metrics import Metrics
from inspector.stores.records import StoredInspection

FACTS = "inspection_id", "product_id", "part_id", "recipe_id", "appearance_id"
"""What names an inspection to whoever is told of it."""
_NEWS = frozenset({"deviation_opened", "deviation_closed", "early_ng", "early_invalid", "recognised", "part_found"})
"""Kinds of messages that dashboards are told at once."""
Phase = Literal["open", "ending", "unsaved", "ended", "moved"]
Outcome = Literal["taken", "dropped", "duplicate"]
_MOST_REGIONS = 12


@dataclass(frozen=True)
class Bounds:
    """How much may wait, and how much there may be."""

    window: int = 32
    """Frames of one inspection that may be unanswered."""
    waiting_bytes: int = 256 << 20
    """Pictures of all inspections that wait."""
    frames: int = 100_000
    """Of one inspection."""


@dataclass(frozen=True)
class Around:
    """What all running inspections share."""

    bounds: Bounds
    events: Events
    metrics: Metrics
    waiting_bytes: Callable[[], int]
    """Of the pictures of all inspections that wait."""
    movable: bool = False
    """Whether another process may go on with an inspection: they are saved for it."""


@dataclass(frozen=True)
class Shown:
    """The picture that was scored last."""

    sequence: int
    picture: bytes | memoryview
    """Exactly as it was received."""
    message: bytes
    """Its `scored` message."""

    @property
    def scored(self) -> dict[str, Any]:
        """What was said of it, by the names of a result; of its regions the highest 12."""
        said = _parsed(self.message)
        del said["sequence"]
        return said | {"regions": sorted(said["regions"], key=lambda each: -each["score"])[:_MOST_REGIONS]}

    def to_json(self, facts: Mapping[str, str]) -> str:
        """The event `picture`."""
        picture = b64encode(self.picture).decode()
        kind = f"image/{kind_of(bytes(self.picture[:16]))}"
        return _json({**facts, "type": kind, "scored": self.scored, "picture": picture}).decode()


@dataclass(frozen=True)
class Ended:
    """What the scorer made of it."""

    result: Head
    """Without frames."""
    frames: bytes
    """As JSON."""
    scores: bytes
    recording: Head
    doubted: bool
    """Whether it is INVALID because another part lay there."""

    @cached_property
    def full(self) -> bytes:
        """The result with frames, as JSON."""
        return json.dumps(self.result).encode()[:-1] + b', "frames": ' + self.frames + b"}"


class Running:
    """A `Listener` of its scorer. `messages` is the log that every connection reads at its own pace."""

    impossible = False
    """Whether no other scorer would do: what it needs cannot be read."""
    reason: str | None = None
    """Why it is aborted, where it is."""

    def __init__(self, row: StoredInspection, scorer: Scorer, around: Around) -> None:
        """`row` is what the store has of it, as it begins or is taken over."""
        self.row, self.scorer, self._around = row, scorer, around
        self.inspection_id, self.product_id = row.inspection_id, row.product_id
        self.phase: Phase = "open"
        self.messages: list[bytes] = []
        self.log_id = uuid4().hex[:8]
        """Of `messages`: whoever takes the inspection over numbers them anew."""
        self.news = asyncio.Event()
        self.next_sequence = 0
        self.scored = 0
        self.since = self.touched = self.asked_at = time.monotonic()
        self.lost_because: str | None = None
        """Why it has no scorer any more."""
        self.begun: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.ended: asyncio.Future[Ended] = asyncio.get_running_loop().create_future()
        self.made: Ended | None = None
        """What the scorer made of it; there while it is not stored yet."""
        self.doubted: Callable[[Sequence[bytes]], object] = lambda pictures: None
        """Told pictures of the beginning, where another part lies there."""
        self.recognised: asyncio.Future[Head | None] | None = None
        """What lies there instead, while somebody looks for it, and afterwards."""
        self.load = Load()
        self.ledger = Ledger(self.since)
        self.resumed = False
        """Whether another process had it, and no frame has come since."""
        self._asked_for: int | None = None
        """The frame that came instead of those that were lost with that process."""
        self._cut: asyncio.Future[Cut] | None = None
        self._released: asyncio.Future[Head] | None = None
        self.connections = 0
        """Counts the streams that were opened; the last one is the one that counts."""
        self._first: int | None = None
        self.keys: dict[str, int] = {}
        """The sequence that an Idempotency-Key was used for."""
        self.shown: Shown | None = None
        """None before the first, and after the end."""
        self._shown_last: Shown | None = None
        self.shown_at = 0.0
        """When a picture was told, by the clock of `since`."""
        self._received: dict[int, float] = {}
        self._pictures: dict[int, bytes | memoryview] = {}
        """Of frames that have no answer yet: those that wait are held for the scorer already."""
        self._answers: dict[int, asyncio.Future[bytes]] = {}
        self._said: dict[int, int] = {}
        """Where in `messages` the answer to a frame is, by its sequence."""
        self._scored_at: list[int] = []
        self._news_at: list[int] = []
        """Where in `messages` the scored frames are, by their index."""
        self._briefs: list[object] = []
        self._dropped = 0

    @cached_property
    def facts(self) -> dict[str, str]:
        """What names it to whoever is told of it."""
        return {name: getattr(self.row, name) for name in FACTS}

    @property
    def waiting(self) -> int:
        """Frames that were accepted and have no answer yet."""
        return len(self._received)

    @property
    def lost(self) -> int:
        """Frames that came or were announced, were not scored, and do not wait for it."""
        return 0 if self._first is None else self.next_sequence - self._first - self.scored - self.waiting

    @property
    def so_far(self) -> list[Head]:
        """What was found until now, as the messages that told it."""
        return [json.loads(self.messages[at]) for at in self._news_at]

    def begin(self, appearance: Path, record_to: Path, restored: Restored | None = None) -> None:
        """Ask the scorer to make it ready, from the beginning or to go on; `begun` says when it is."""
        if restored is not None:
            self._restore(restored)
        names = {name: value for name, value in self.facts.items() if name != "appearance_id"}
        head: Head = {
            "do": "begin",
            "id": self.inspection_id,
            "appearance_id": self.row.appearance_id,
            "path": str(appearance),
            "policy": self.row.policy,
            "names": names | {"result_id": new_id()},
            "record_to": str(record_to),
        }
        self.scorer.ask(self, head | restored.resume if restored else head, restored.body if restored else b"")

    def _restore(self, restored: Restored) -> None:
        """What the process knew that had it before."""
        self.resumed, kept = True, restored.kept
        self._first, self.next_sequence, self.keys = kept.first, kept.next, dict(kept.keys)
        for line in restored.lines:
            said = json.loads(line)
            if said["kind"] in ANSWERS:
                self._said[said["sequence"]] = len(self.messages)
            if said["kind"] == "scored":
                self.scored += 1
                self._scored_at.append(len(self.messages))
            if said["kind"] in _NEWS:
                self._news_at.append(len(self.messages))
            if said["kind"] == "recognised":
                self.recognised = asyncio.get_running_loop().create_future()
                self.recognised.set_result({name: value for name, value in said.items() if name != "kind"})
            self._log(line)
        self.ledger.restore(restored)

    def cut(self) -> asyncio.Future[Cut]:
        """What is to be saved, when all frames that came so far are answered. Raises Moved, also as its result."""
        self._ask_scorer({"do": "checkpoint", "id": self.inspection_id})
        self._cut = asyncio.get_running_loop().create_future()
        return self._cut

    def release(self) -> asyncio.Future[Head]:
        """The scorer closes the recording and forgets the inspection; then, what became of the recording."""
        self._ask_scorer({"do": "release", "id": self.inspection_id})
        self._released = asyncio.get_running_loop().create_future()
        return self._released

    def move(self) -> None:
        """It goes on elsewhere: connections end without a last message, and are made again there."""
        self.phase = "moved"
        self.shown = None
        self._around.events.forget(self.inspection_id)
        self.scorer.forget(self.inspection_id)
        for answer in self._answers.values():
            if not answer.done():
                answer.set_exception(Moved(self.inspection_id))
                answer.exception()
        self.wake()

    def offer(self, sent: SentFrame) -> Outcome:
        """Take a frame of a stream; one that finds no room is dropped, counted, and answered so.

        The rule: what waits was here first. Raises NotOpen, TooManyFrames.
        """
        if self._old(sent):
            return "duplicate"
        why = self._no_room(len(sent.picture))
        self._count(sent)
        if why is None:
            self._ask(sent)
            return "taken"
        self.scorer.ask(self, {"do": "drop", "id": self.inspection_id, "count": 1, "t_ns": sent.t_ns})
        self._around.metrics.frames.labels(self.product_id, "dropped").inc()
        self._dropped += 1
        self._said[sent.sequence] = len(self.messages)
        self._log(_json({"kind": "dropped", "sequence": sent.sequence, "why": why}), sent.sequence)
        return "dropped"

    async def offer_and_wait(self, sent: SentFrame) -> bytes:
        """Take a frame, or know one that came before, and wait for the answer.

        Raises Busy, and then nothing has changed, NotOpen, TooManyFrames, OutOfOrder, ScorerLost.
        """
        return await asyncio.shield(self._answer(sent))

    def _answer(self, sent: SentFrame) -> asyncio.Future[bytes]:
        self._check_gap(sent.sequence)
        if sent.sequence in self._answers:
            return self._answers[sent.sequence]
        if sent.sequence in self._said:
            answer: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
            answer.set_result(self.messages[self._said[sent.sequence]])
            return answer
        if self._old(sent):
            raise OutOfOrder(sent.sequence, self.next_sequence)
        if self._no_room(len(sent.picture)) is not None:
            raise Busy(self.waiting)
        self._count(sent)
        answer = self._answers[sent.sequence] = asyncio.get_running_loop().create_future()
        self._ask(sent)
        return answer

    def scores_after(self, index: int, limit: int) -> list[bytes]:
        """The `scored` messages with a higher index, the oldest first."""
        return [self.messages[at] for at in self._scored_at[index + 1 : index + 1 + limit]]

    def wake(self) -> None:
        """All connections look at what there is to say."""
        news, self.news = self.news, asyncio.Event()
        news.set()

    def end(self, *, stopped: bool = False, reason: str | None = None) -> None:
        """No more frames; what waits is scored, then `ended` has the result. Raises ScorerLost."""
        if self.lost_because is not None:
            raise ScorerLost(self.inspection_id, self.lost_because)
        self.phase, self.reason = "ending", reason
        announced = 0 if self._first is None else self.next_sequence - self._first
        head: Head = {"id": self.inspection_id, "announced": announced}
        ask = {"do": "conclude", "stopped": stopped} if reason is None else {"do": "abort", "reason": reason}
        self.scorer.ask(self, head | ask)

    def leave(self, kind: str, full: bytes | None, reason: str | None) -> None:
        """The last message; the scorer knows nothing of it any more."""
        self.phase = "ended"
        self.shown = None
        self._around.events.forget(self.inspection_id)
        self.scorer.forget(self.inspection_id)
        said = b'{"kind":%b,"reason":%b,"result":%b}' % (_json(kind), _json(reason), full or b"null")
        self._log(said)

    def tell_saved(self, below: int) -> None:
        """Frames below this need not be kept by those who sent them."""
        self.ledger.below = below
        self.wake()

    def tell_briefs(self) -> None:
        """What was scored since the last time, as one event for all dashboards."""
        if self._briefs or self._dropped:
            frames, dropped, self._briefs, self._dropped = self._briefs, self._dropped, [], 0
            self._around.events.publish("scores", **self._names(), frames=frames, dropped=dropped, lost=self.lost)

    def tell_picture(self, ration: Ration) -> None:
        """The latest picture for those who watch, where there is a new one and it may be told now."""
        if (shown := self.shown) is None or shown is self._shown_last:
            return
        if ration.take(self._around.events.watching(self.inspection_id), len(shown.picture)):
            self._shown_last, self.shown_at = shown, time.monotonic()
            self._around.events.show(self.inspection_id, shown.to_json(self._names()))

    def tell(self, kind: str, said: Head) -> None:
        """News that no frame brought, to whoever feeds it and to dashboards."""
        self._news_at.append(len(self.messages))
        self._around.events.publish(kind, **self._names(), **said)
        self._log(_json({"kind": kind, **said}))

    # What the scorer says.

    def sent(self, head: Head) -> None:
        received = self._received.get(head.get("sequence", -1))
        if head["do"] == "frame" and received is not None:
            self._around.metrics.stages.labels("wait").observe(time.perf_counter() - received)

    def heard(self, head: Head, body: bytes) -> None:
        if head["did"] == "frame":
            self._hear_frame(head, body)
        elif head["did"] == "begun":
            _settle(self.begun, None)
        elif head["did"] == "checkpoint":
            size = head["size"]
            cut = self.ledger.cut(head["sequence"], self._first, self.keys, body[:size], body[size:])
            if self._cut is not None:
                _settle(self._cut, cut)
        elif head["did"] == "released":
            if self._released is not None:
                _settle(self._released, head["recording"])
        elif head["did"] == "doubted":
            ends = [*accumulate(head["sizes"], initial=0)]
            self.doubted([body[start:end] for start, end in pairwise(ends)])
        elif head["did"] == "concluded":
            size = head["json"]
            _settle(self.ended, Ended(head["result"], body[:size], body[size:], head["recording"], head["doubted"]))
        else:
            self.impossible = head.get("do") == "begin"
            self.died(head["why"])

    def died(self, why: str) -> None:
        self.touched = time.monotonic()
        self.lost_because = why
        moves = self._around.movable and self.begun.done()
        error = Moved(self.inspection_id) if moves else ScorerLost(self.inspection_id, why)
        for waiting in (self.begun, self.ended, self._cut, self._released, *self._answers.values()):
            if waiting is not None and not waiting.done():
                waiting.set_exception(error)
                # not everybody waits
                waiting.exception()
        self._answers.clear()
        self._received.clear()
        self._pictures.clear()

    def _hear_frame(self, head: Head, body: bytes) -> None:
        sequence = head["sequence"]
        lines = body.split(b"\n")
        self.touched = time.monotonic()
        self._said[sequence] = len(self.messages)
        for kind, line in zip(head["kinds"], lines, strict=True):
            if kind in _NEWS:
                self._news_at.append(len(self.messages))
                self._around.events.publish(kind, **self._names(), **_parsed(line))
            self._log(line, sequence)
        outcome, picture = head["kinds"][0], self._pictures.pop(sequence)
        self._around.metrics.frames.labels(self.product_id, outcome).inc()
        if outcome == "scored":
            self.scored += 1
            self._scored_at.append(self._said[sequence])
            self._briefs.append(head["brief"])
            self.shown = Shown(sequence, picture, lines[0])
        self.load.took(sum(head["took"].values()))
        for stage, seconds in head["took"].items():
            self._around.metrics.stages.labels(stage).observe(seconds)
        self._around.metrics.stages.labels("total").observe(time.perf_counter() - self._received.pop(sequence))
        if answer := self._answers.pop(sequence, None):
            _settle(answer, self.messages[self._said[sequence]])

    def _ask_scorer(self, head: Head) -> None:
        if self.lost_because is not None:
            raise Moved(self.inspection_id)
        self.scorer.ask(self, head)

    def _log(self, line: bytes, sequence: int = -1) -> None:
        """A message; where it is of a frame, with its number."""
        if self._around.movable:
            self.ledger.said(line, sequence)
        self.messages.append(b'{"n":%d,%b' % (len(self.messages), line[1:]))
        self.wake()

    def _check_gap(self, sequence: int) -> None:
        """Raises ResumeFrom where frames before that one were lost with another process.

        Who cannot send them again goes on with the next one, and they count as lost. The same frame once more may be
        a request that nobody waits for any more.
        """
        if self.resumed and self._asked_for is None:
            self._asked_for = sequence
        if self._asked_for is not None and self.next_sequence < sequence <= self._asked_for:
            raise ResumeFrom(self.inspection_id, self.next_sequence, sequence)

    def _old(self, sent: SentFrame) -> bool:
        self.touched = time.monotonic()
        if self.phase == "moved" or (self.lost_because is not None and self._around.movable):
            raise Moved(self.inspection_id)
        if self.phase != "open":
            raise NotOpen(self.inspection_id)
        if self.scored + self.waiting >= self._around.bounds.frames:
            raise TooManyFrames(self._around.bounds.frames)
        return sent.sequence < self.next_sequence

    def _no_room(self, size: int) -> str | None:
        if self.waiting >= self._around.bounds.window:
            return f"{self.waiting} frames of this inspection waited already"
        if self._around.waiting_bytes() + size > self._around.bounds.waiting_bytes:
            return "the pictures of all inspections that wait leave no room for it"
        return None

    def _count(self, sent: SentFrame) -> None:
        self.load.came(sent.t_ns)
        self.resumed = False
        self._first = sent.sequence if self._first is None else self._first
        self.next_sequence = sent.sequence + 1

    def _ask(self, sent: SentFrame) -> None:
        self._received[sent.sequence] = time.perf_counter()
        self._pictures[sent.sequence] = sent.picture
        head = {"do": "frame", "id": self.inspection_id, "sequence": sent.sequence, "t_ns": sent.t_ns}
        self.scorer.ask(self, head | {"encoder": sent.encoder}, sent.picture)

    def _names(self) -> dict[str, str]:
        return {"inspection_id": self.inspection_id, "product_id": self.product_id}


def _settle(future: asyncio.Future[Any], value: object) -> None:
    if not future.done():
        future.set_result(value)


def _json(message: object) -> bytes:
    return json.dumps(message, separators=(",", ":")).encode()


def _parsed(line: bytes) -> Head:
    return {name: value for name, value in json.loads(line).items() if name != "kind"}
