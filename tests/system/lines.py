"""Lines and dashboards for tests of several services: threads that note what they were told."""

from __future__ import annotations

import json
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import httpx2

from inspector.client import Client
from inspector.recording import SweepReader
from inspector.replay import replay
from tests import patience
from tests.api.stations import BAD, GOOD, PRODUCT, frames, learnt, picture, sweep

OPTIONS = (BAD, GOOD)
IN_THE_MIDDLE = 10
"""Frames of a part, of about forty."""
HALF_WAY = 25
"""Where lines wait at a gate that is closed."""
EACH_SECONDS = 0.1
"""The pace of a camera that many of can be tried on one machine."""


class Front(Protocol):
    """Whatever leads to the services."""

    url: str
    token: str

    def client(self) -> Client: ...

    def get(self, path: str) -> httpx2.Response: ...

    def owners(self, inspections: set[str]) -> dict[str, str | None]: ...


@dataclass
class Part:
    """What a line knows of one inspection."""

    options: str
    inspection: str = ""
    counts: Counter[str] = field(default_factory=Counter[str])
    heard: list[tuple[float, str]] = field(default_factory=list[tuple[float, str]])
    result: dict[str, Any] = field(default_factory=dict[str, Any])
    half_done: bool = False
    """Whether it is past the gate: it may end at any time."""

    def silence(self, since: float) -> float:
        """Seconds from then until anything was said again."""
        return min((at - since for at, _ in self.heard if at > since), default=float("inf"))

    def check(self, front: Front) -> None:
        """It has the result that its recording has, at the line and for everybody, and no frame was lost."""
        assert self.counts["scored"] == len(frames(self.options))
        assert (self.counts["dropped"], self.result["frames_dropped"]) == (0, 0)
        assert self.result["digest"] == offline(self.options)
        assert front.get(f"/v1/inspections/{self.inspection}/result").json() == self.result

    def check_recording(self, front: Front, folder: Path, *, lost: bool = False) -> None:
        """It is one, whoever wrote it, and its replay says the same; where a process is `lost`, what it had is told."""
        path, note = folder / f"{self.inspection}.mcap", self._kept(front)
        path.write_bytes(front.get(f"/v1/inspections/{self.inspection}/recording").content)
        recorded = [picture(frame) for frame in SweepReader(path)]
        sent = [picture(frame) for frame in frames(self.options)]
        missing = len(sent) - len(recorded)
        assert recorded == sent[missing:]
        if lost:
            told = f"frames from 0 to {frames(self.options)[missing - 1].sequence} are not in it"
            assert (note or "").startswith(told) == (missing > 0), note
        else:
            assert (missing, note) == (0, None)
            assert replay(SweepReader(path), learnt()).result.digest == offline(self.options)

    def _kept(self, front: Front) -> str | None:
        """What is said of the recording, once it is where all find it."""
        known: dict[str, Any] = {}

        def kept() -> bool:
            known.update(front.get(f"/v1/inspections/{self.inspection}").json())
            return known["recording"] == "kept"

        patience.until(kept, lambda: known)
        return known["recording_note"]


class Gate:
    """Half way through every part, lines wait while it is closed: what is done to services is done in the middle."""

    def __init__(self, *, is_open: bool = False) -> None:
        self._turn, self._open = threading.Lock(), is_open

    def open(self) -> None:
        """All go on."""
        with self._turn:
            self._open = True

    def close(self) -> None:
        """From now on. Who is past it is known by then."""
        with self._turn:
            self._open = False

    def lets(self, part: Part) -> bool:
        """Whether it may go on."""
        with self._turn:
            part.half_done = self._open
            return self._open


class Line(threading.Thread):
    """A line that inspects one part, or one after the other as long as `more` says so; `each`: seconds of a frame."""

    def __init__(
        self,
        front: Front,
        number: int,
        *,
        way: str = "ws",
        each: float = EACH_SECONDS,
        more: Callable[[], bool] = lambda: False,
        gate: Gate | None = None,
    ) -> None:
        super().__init__(daemon=True)
        self._front, self._number = front, number
        self._way, self._each, self._more = way, each, more
        self._gate = gate or Gate(is_open=True)
        self.parts: list[Part] = []
        self.went_wrong: BaseException | None = None

    @property
    def now(self) -> Part:
        """Which is under the camera."""
        return self.parts[-1]

    def another(self, number: int) -> Line:
        """One more that works as this one does."""
        line = Line(self._front, number, way=self._way, each=self._each, more=self._more, gate=self._gate)
        line.start()
        return line

    def run(self) -> None:
        try:
            with self._front.client() as client:
                self._inspect(client)
                while self._more():
                    self._inspect(client)
        except BaseException as error:
            self.went_wrong = error

    def _inspect(self, client: Client) -> None:
        part = Part(OPTIONS[(self._number + len(self.parts)) % len(OPTIONS)])
        self.parts.append(part)

        def hear(message: dict[str, Any]) -> None:
            part.heard.append((time.monotonic(), message["kind"]))

        name = f"{self._number:02}-{len(self.parts):03}"
        with client.begin(PRODUCT, name, transport=self._way, on_message=hear) as inspection:
            part.inspection, part.counts = inspection.inspection_id, inspection.counts
            for number, frame in enumerate(frames(part.options)):
                while number == HALF_WAY and not self._gate.lets(part):
                    inspection.wait(EACH_SECONDS)
                inspection.send(frame)
                inspection.wait(self._each)
            part.result = inspection.conclude()


def started(front: Front, count: int, ways: Sequence[str] = ("ws",), **options: Any) -> list[Line]:
    """So many lines at work, which send by each way in turn."""
    for each in OPTIONS:
        # Made here, once: lines are threads.
        frames(each)
    lines = [Line(front, number, way=ways[number % len(ways)], **options) for number in range(count)]
    for line in lines:
        line.start()
    return lines


def come_to_the_middle(front: Front, lines: list[Line], services: int = 2) -> None:
    """Return when all parts are in the middle, where a closed gate keeps them, and every service has some.

    Ids are random: where a service has none, there are more lines.
    """
    patience.until(lambda: _in_the_middle(lines), lambda: [line.parts for line in lines])
    while len({*front.owners({line.now.inspection for line in lines}).values()}) < services:
        lines.append(lines[0].another(len(lines)))
        patience.until(lambda: _in_the_middle(lines), lambda: [line.parts for line in lines])


def _in_the_middle(lines: Sequence[Line]) -> bool:
    well(lines)
    parts = [line.now if line.parts else Part("") for line in lines]
    return all(part.counts["scored"] >= IN_THE_MIDDLE and not part.half_done for part in parts)


def end_well(front: Front, lines: Sequence[Line]) -> None:
    """All of their parts are as they should be."""
    for line in lines:
        line.join(patience.SECONDS)
        assert not line.is_alive(), line.parts
    well(lines)
    for line in lines:
        for part in line.parts:
            part.check(front)


def well(lines: Sequence[Line]) -> None:
    """Nothing was raised in any line."""
    wrong = [repr(line.went_wrong) for line in lines if line.went_wrong]
    assert not wrong, wrong


@cache
def offline(options: str) -> str:
    """The digest of that recording's replay."""
    return replay(SweepReader(sweep(options)), learnt()).result.digest


class Dashboard(threading.Thread):
    """Somebody who looks at what one address tells, and goes on looking."""

    def __init__(self, url: str, token: str, **headers: str) -> None:
        super().__init__(daemon=True)
        self._url, self._headers = url, {"Authorization": f"Bearer {token}"} | headers
        self.seen: dict[str, set[str]] = {}
        """Of which inspections, by the kind of event."""
        self.ready = threading.Event()
        self._closed = threading.Event()
        self.start()

    def has(self, kind: str, inspections: set[str]) -> bool:
        """Whether all of these were told of."""
        return self.seen.get(kind, set()) >= inspections

    def close(self) -> None:
        """Look no more, from the next line on that is told."""
        self._closed.set()

    def run(self) -> None:
        while not self._closed.wait(0.2):
            with (
                suppress(httpx2.TransportError),
                patience.stream("GET", f"{self._url}/v1/events", headers=self._headers) as events,
            ):
                self._read(events.iter_lines())

    def _read(self, lines: Iterator[str]) -> None:
        kind = ""
        for line in lines:
            if self._closed.is_set():
                return
            name, _, value = line.partition(": ")
            if name == "event":
                kind = value
                self.ready.set()
            elif name == "data" and kind:
                told = json.loads(value)
                self.seen.setdefault(kind, set()).add(told.get("inspection_id", ""))
