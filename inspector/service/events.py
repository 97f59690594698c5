"""What happens, as it happens, for any number of listeners: a bounded memory that each reads at its own pace.

inspector.errors.WorldError
└── TooManyListeners         more listeners than allowed
"""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import AsyncIterator, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from uuid import uuid4

from inspector.errors import WorldError

_REMEMBERED = 4096
_QUIET_SECONDS = 15.0
"""After so long without an event, listeners are told that nothing happened."""


class TooManyListeners(WorldError):
    """More listeners than allowed."""

    def __init__(self, allowed: int) -> None:
        super().__init__(f"{allowed} listen to events already, and no more are allowed; try again later")


@dataclass(frozen=True)
class Event:
    """Something that happened."""

    id: str
    """`boot-number`: where to go on after a broken connection."""
    kind: str
    data: str
    """JSON."""


class Events:
    """The last few thousand events of this process. Nobody who listens holds up who tells.

    Used from the event loop only; `publish_soon` from anywhere. A listener that falls behind what is remembered, or
    that asks for an id of before the last start, is told so by an event `missed`: lists must be read again.
    """

    def __init__(self, max_listeners: int = 64, remembered: int = _REMEMBERED) -> None:
        self.listeners = 0
        self._max = max_listeners
        self._boot = uuid4().hex[:8]
        self._next = 0
        self._events: deque[Event] = deque(maxlen=remembered)
        self._news = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._closed = False

    def start(self) -> None:
        """On the loop that will publish."""
        self._loop = asyncio.get_running_loop()

    def close(self) -> None:
        """All listeners come to their end."""
        self._closed = True
        self._wake()

    def publish(self, kind: str, **facts: object) -> None:
        """Tell all listeners."""
        self._events.append(Event(f"{self._boot}-{self._next}", kind, json.dumps(facts, separators=(",", ":"))))
        self._next += 1
        self._wake()

    def publish_soon(self, kind: str, **facts: object) -> None:
        """The same, from another thread."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(lambda: self.publish(kind, **facts))

    def check_room(self) -> None:
        """Raises TooManyListeners where there is no room for one more."""
        if self.listeners >= self._max:
            raise TooManyListeners(self._max)

    @contextmanager
    def listening(self) -> Generator[None]:
        """One listener more, while this lasts. Raises TooManyListeners."""
        self.check_room()
        self.listeners += 1
        try:
            yield
        finally:
            self.listeners -= 1

    async def since(self, last_id: str | None) -> AsyncIterator[tuple[Event, ...]]:
        """What was told after that id, then what is told from now on, as many at a time as there are.

        Without an id only the latter. An empty batch where nothing happened for a while.
        """
        at, known = self._place(last_id)
        if not known:
            yield (Event(f"{self._boot}-{at - 1}", "missed", json.dumps({"last_id": last_id})),)
        while not self._closed:
            news = self._news
            oldest = self._next - len(self._events)
            if at < oldest:
                yield (Event(f"{self._boot}-{oldest - 1}", "missed", json.dumps({"count": oldest - at})),)
                at = oldest
            elif at < self._next:
                batch = tuple(self._events[i] for i in range(at - self._next, 0))
                at = self._next
                yield batch
            else:
                with suppress(TimeoutError):
                    await asyncio.wait_for(news.wait(), _QUIET_SECONDS)
                    continue
                yield ()

    def _place(self, last_id: str | None) -> tuple[int, bool]:
        """The number to go on with, and whether nothing is missing before it."""
        if last_id is None:
            return self._next, True
        boot, _, number = last_id.rpartition("-")
        known = boot == self._boot and number.isdecimal() and int(number) < self._next
        return (int(number) + 1, True) if known else (self._next, False)

    def _wake(self) -> None:
        news, self._news = self._news, asyncio.Event()
        news.set()
