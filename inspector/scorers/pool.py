"""The service's side of the scorers: processes, what waits for each, and whose turn it is.

An inspection is pinned to one scorer from begin to end. What is asked of it waits in a line of its own; the lines of
a scorer take turns, so that one inspection that comes as fast as it can does not hold up those in real time. A scorer
has two frames at a time: one in work, one that it finds when it is done.
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from inspector.scorers.wire import Head, pack, receive_async

_DEPTH = 2
_ANSWERED = ("frame", "begin", "prepare", "locate", "track")
"""Questions that take a while: a scorer has `_DEPTH` of them at a time."""
_PIPE_BYTES = 1 << 20
_PATIENCE_SECONDS = 20.0
"""How long a scorer may take to close its recordings when the service stops."""
_REST_SECONDS = 0.5
"""Before a scorer that died is started again."""


class Listener(Protocol):
    """Who is told what a scorer says of its inspection."""

    def heard(self, head: Head, body: bytes) -> None:
        """An answer, by the table in `wire`."""
        ...

    def sent(self, head: Head) -> None:
        """A question has left the line for the scorer."""
        ...

    def died(self, why: str) -> None:
        """The scorer is gone, and with it all that it knew of the inspection."""
        ...


@dataclass(frozen=True)
class _Question:
    head: Head
    body: bytes | memoryview

    @property
    def holds(self) -> bool:
        """Whether the next one waits for its answer."""
        return self.head["do"] in _ANSWERED


class Scorer:
    """One process. Used from the event loop only."""

    def __init__(self, number: int, max_pixels: int, on_death: Callable[[Scorer], None]) -> None:
        self.number = number
        self.restarts = 0
        self.listeners: dict[str, Listener] = {}
        self.waiting_bytes = 0
        self._max_pixels, self._on_death = max_pixels, on_death
        self._lines: dict[str, deque[_Question]] = {}
        self._turns: deque[str] = deque()
        self._in_work = 0
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None
        self._stopping = False

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self._process is not None and self._process.returncode is None

    @property
    def pid(self) -> int | None:
        """Of the process, while there is one."""
        return self._process.pid if self._process is not None and self.alive else None

    @property
    def waiting(self) -> int:
        """Questions that wait for their turn."""
        return sum(map(len, self._lines.values()))

    async def start(self) -> None:
        """Begin the process, and begin it again whenever it dies, until `stop`."""
        await self._spawn()
        self._task = asyncio.create_task(self._listen(), name=f"scorer-{self.number}")

    async def stop(self) -> None:
        """Let it finish what it has, close its recordings, and end."""
        self._stopping = True
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()
        if self._task is not None:
            try:
                await asyncio.wait_for(self._task, _PATIENCE_SECONDS)
            except TimeoutError:
                if self._process is not None and self.alive:
                    self._process.kill()
        if self._process is not None:
            await self._process.wait()

    def ask(self, listener: Listener, head: Head, body: bytes | memoryview = b"") -> None:
        """Put a question at the end of the inspection's line; answers go to the listener."""
        name = head["id"]
        self.listeners.setdefault(name, listener)
        line = self._lines.get(name)
        if line is None:
            line = self._lines[name] = deque()
            self._turns.append(name)
        line.append(_Question(head, body))
        self.waiting_bytes += len(body)
        self._pump()

    def load(self, appearance_id: str, path: str) -> None:
        """Have an appearance ready before it is needed."""
        self._write(_Question({"do": "load", "appearance_id": appearance_id, "path": path}, b""))

    def dismiss(self, name: str) -> None:
        """What was tracked under that name is not any more."""
        self._write(_Question({"do": "forget", "id": name}, b""))

    def forget(self, name: str) -> None:
        """The inspection has ended."""
        self.listeners.pop(name, None)
        for question in self._lines.pop(name, ()):
            self.waiting_bytes -= len(question.body)
        if name in self._turns:
            self._turns.remove(name)

    def _pump(self) -> None:
        while self._in_work < _DEPTH and self._turns and self.alive:
            name = self._turns.popleft()
            line = self._lines[name]
            question = line.popleft()
            if line:
                self._turns.append(name)
            else:
                del self._lines[name]
            self.waiting_bytes -= len(question.body)
            self._in_work += question.holds
            self._write(question)
            if listener := self.listeners.get(name):
                listener.sent(question.head)

    def _write(self, question: _Question) -> None:
        if self._process is not None and self._process.stdin is not None and self.alive:
            self._process.stdin.write(pack(question.head, question.body))

    async def _listen(self) -> None:
        while True:
            assert self._process is not None
            assert self._process.stdout is not None
            while (answer := await receive_async(self._process.stdout)) is not None:
                self._hear(*answer)
            code = await self._process.wait()
            self._bury(f"the process that scored it ended unexpectedly (code {code})")
            if self._stopping:
                return
            self.restarts += 1
            await asyncio.sleep(_REST_SECONDS)
            if self._stopping:
                return
            await self._spawn()

    def _hear(self, head: Head, body: bytes) -> None:
        if head["did"] in ("frame", "begun", "located") or head.get("do") in _ANSWERED:
            self._in_work -= 1
        listener = self.listeners.get(head.get("id") or "")
        if listener is not None:
            listener.heard(head, body)
        self._pump()

    def _bury(self, why: str) -> None:
        bereft = [*self.listeners.values()]
        self.listeners.clear()
        self._lines.clear()
        self._turns.clear()
        self._in_work = self.waiting_bytes = 0
        for listener in bereft:
            listener.died(why)
        if not self._stopping:
            self._on_death(self)

    async def _spawn(self) -> None:
        threads = {f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL")}
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "inspector.scorers.worker",
            str(self._max_pixels),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=_PIPE_BYTES,
            env={**os.environ, **threads},
        )
        if self._stopping and self._process.stdin is not None:
            # while it was being started; `stop` has closed that of the one before
            self._process.stdin.close()


class Pool:
    """All scorers; the one with the fewest inspections takes the next."""

    def __init__(self, count: int, max_pixels: int, on_death: Callable[[Scorer], None] = lambda scorer: None) -> None:
        self.scorers = [Scorer(number, max_pixels, on_death) for number in range(count)]

    async def start(self) -> None:
        """Begin all processes."""
        await asyncio.gather(*(scorer.start() for scorer in self.scorers))

    async def stop(self) -> None:
        """End all processes; recordings are closed."""
        await asyncio.gather(*(scorer.stop() for scorer in self.scorers))

    def least(self) -> Scorer | None:
        """The scorer for the next inspection, None while none is alive."""
        alive = [scorer for scorer in self.scorers if scorer.alive]
        return min(alive, key=lambda scorer: (len(scorer.listeners), scorer.number)) if alive else None

    def load(self, appearance_id: str, path: str) -> None:
        """Have an appearance ready in every scorer."""
        for scorer in self.scorers:
            scorer.load(appearance_id, path)

    @property
    def waiting_bytes(self) -> int:
        """Of pictures that wait for their turn."""
        return sum(scorer.waiting_bytes for scorer in self.scorers)
