"""What happens, as it happens, for any number of listeners: a bounded memory that each reads at its own pace.

What happens at other services that share the store is in it, too, in the order in which it was heard of.

Pictures are told beside it, to those who ask: only the latest of each inspection, and none is remembered.

inspector.errors.WorldError
└── TooManyListeners         more listeners than allowed
"""

from __future__ import annotations

import asyncio
import json
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Collection, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from uuid import uuid4

from inspector.errors import WorldError

_REMEMBERED = 4096
EVERY = "every"
"""Listeners may ask for the pictures of one inspection by its id, or of all of them by this."""
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
    """`boot-number`: where to go on after a broken connection; empty for what is not told again."""
    kind: str
    data: str
    """JSON."""


class Events:
    """The last few thousand events. Nobody who listens holds up who tells.

    Used from the event loop only; `publish_soon` from anywhere. A listener that falls behind what is remembered, or
    that asks for an id of before the last start, is told so by an event `missed`: lists must be read again.
    """

    def __init__(self, max_listeners: int = 64, remembered: int = _REMEMBERED) -> None:
        self.listeners = 0
        self._max = max_listeners
        self._boot = uuid4().hex[:8]
        self._next = self._untold = 0
        self._events: deque[Event] = deque(maxlen=remembered)
        self._watching: Counter[str] = Counter()
        """Listeners by whose pictures they asked for."""
        self._pictures: dict[str, tuple[int, Event]] = {}
        self._told_pictures = 0
        self._others: set[str] = set()
        """Inspections of other services, of which there is a picture."""
        self._watched_by: Mapping[str, Collection[str]] = {}
        self.told: Callable[[str, str], object] | None = None
        """Hears the kind and the data of what is published here; a change of which no event tells is of no kind."""
        self.shown: Callable[[str, str | None], object] | None = None
        """Hears the pictures that are shown here, by inspection; None: there will be no more."""
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

    @property
    def changes(self) -> int:
        """Where it is the same as before, nothing has happened since."""
        return self._next + self._untold

    def changed(self, *, here: bool = True) -> None:
        """Something has changed of which no event tells; `here`, or at another service."""
        self._untold += 1
        if here and self.told is not None:
            self.told("", "")

    def publish(self, kind: str, **facts: object) -> None:
        """Tell all listeners, here and elsewhere."""
        data = json.dumps(facts, separators=(",", ":"))
        self.hear(kind, data)
        if self.told is not None:
            self.told(kind, data)

    def hear(self, kind: str, data: str) -> None:
        """Tell all listeners here."""
        self._events.append(Event(f"{self._boot}-{self._next}", kind, data))
        self._next += 1
        self._wake()

    def publish_soon(self, kind: str, **facts: object) -> None:
        """The same, from another thread."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(lambda: self.publish(kind, **facts))

    @property
    def last_id(self) -> str | None:
        """Of the last event; None before the first."""
        return f"{self._boot}-{self._next - 1}" if self._next else None

    def watching(self, inspection_id: str) -> int:
        """How many asked for its pictures: here, and a service elsewhere counts as one."""
        here = self._watching[inspection_id] + self._watching[EVERY]
        return here + sum(inspection_id in each or EVERY in each for each in self._watched_by.values())

    @property
    def watched(self) -> list[str]:
        """Whose pictures are asked for here."""
        return sorted(asked for asked, count in [*self._watching.items()] if asked and count)

    def watched_by(self, services: Mapping[str, Collection[str]]) -> None:
        """Whose pictures are asked for at other services."""
        self._watched_by = services

    def show(self, inspection_id: str, data: str) -> None:
        """Tell an inspection's latest picture; who has not read the one before will not see that."""
        self._show(inspection_id, data)
        if self.shown is not None:
            self.shown(inspection_id, data)

    def see(self, inspection_id: str, data: str) -> None:
        """The same, of an inspection of another service."""
        self._others.add(inspection_id)
        self._show(inspection_id, data)

    def _show(self, inspection_id: str, data: str) -> None:
        self._told_pictures += 1
        self._pictures[inspection_id] = (self._told_pictures, Event("", "picture", data))
        self._wake()

    def forget(self, inspection_id: str) -> None:
        """There will be no more pictures of it."""
        self._pictures.pop(inspection_id, None)
        self._others.discard(inspection_id)
        if self.shown is not None:
            self.shown(inspection_id, None)

    def forget_others(self) -> None:
        """Of inspections of other services it is not known any more whether they go on."""
        for inspection_id in [*self._others]:
            self.forget(inspection_id)

    def check_room(self) -> None:
        """Raises TooManyListeners where there is no room for one more."""
        if self.listeners >= self._max:
            raise TooManyListeners(self._max)

    @contextmanager
    def listening(self, pictures: str | None = None) -> Generator[None]:
        """One listener more, while this lasts, to pictures too where it is said whose. Raises TooManyListeners."""
        self.check_room()
        self.listeners += 1
        self._watching[pictures or ""] += 1
        try:
            yield
        finally:
            self.listeners -= 1
            self._watching -= Counter([pictures or ""])

    async def since(self, last_id: str | None, pictures: str | None = None) -> AsyncIterator[tuple[Event, ...]]:
        """What was told after that id, then what is told from now on, as many at a time as there are.

        Without an id only the latter. An empty batch where nothing happened for a while.
        """
        at, known = self._place(last_id)
        seen = self._told_pictures
        if not known:
            yield (Event(f"{self._boot}-{at - 1}", "missed", json.dumps({"last_id": last_id})),)
        while not self._closed:
            news = self._news
            oldest = self._next - len(self._events)
            if at < oldest:
                yield (Event(f"{self._boot}-{oldest - 1}", "missed", json.dumps({"count": oldest - at})),)
                at = oldest
            elif at < self._next or seen < self._told_pictures:
                batch = tuple(self._events[i] for i in range(at - self._next, 0))
                fresh = [
                    event
                    for inspection_id, (number, event) in self._pictures.items()
                    if number > seen and pictures in (EVERY, inspection_id)
                ]
                at, seen = self._next, self._told_pictures
                if batch or fresh:
                    yield (*batch, *fresh)
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
