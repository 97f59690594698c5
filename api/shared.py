"""Answers that many ask for at the same time, made once."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

from api.deps import in_thread
from inspector.service.events import Events

_SECONDS = 0.25
"""For what changes without anybody asking for it, and without an event, as what is removed because it is old."""
_KEPT = 64


@dataclass(frozen=True)
class _Answer:
    changes: int
    """Before it was begun."""
    begun: float
    body: asyncio.Task[bytes]


class Shared:
    """Answers by what was asked. One that was begun after the last change is as good as a new one."""

    def __init__(self, events: Events) -> None:
        self._events = events
        self._answers: OrderedDict[str, _Answer] = OrderedDict()

    async def get(self, asked: str, make: Callable[[], bytes]) -> bytes:
        """What `make`, called in a thread, returns or raises."""
        known = self._answers.pop(asked, None)
        if known is None or known.changes != self._events.changes or monotonic() - known.begun > _SECONDS:
            known = _Answer(self._events.changes, monotonic(), asyncio.ensure_future(in_thread(make)))
        self._answers[asked] = known
        if len(self._answers) > _KEPT:
            self._answers.popitem(last=False)
        try:
            # Who goes away leaves the others their answer.
            return await asyncio.shield(known.body)
        except Exception:
            self._answers.pop(asked, None)
            raise
