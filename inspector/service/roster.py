"""Which inspections are here: those in processing, and for a while those that have ended."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator

from inspector.service.running import Running

_REMEMBERED = 64
"""Inspections whose messages are kept after their end, for connections that break just then."""


class Roster:
    """Of one process. Goes through those in processing; who leaves meanwhile does no harm."""

    def __init__(self) -> None:
        self._running: dict[str, Running] = {}
        self._ended: OrderedDict[str, Running] = OrderedDict()

    def __len__(self) -> int:
        return len(self._running)

    def __iter__(self) -> Iterator[Running]:
        return iter([*self._running.values()])

    def running(self, inspection_id: str) -> Running | None:
        """The inspection, if it is in processing here."""
        return self._running.get(inspection_id)

    def find(self, inspection_id: str) -> Running | None:
        """The same, or one that ended a short while ago."""
        return self._running.get(inspection_id) or self._ended.get(inspection_id)

    def add(self, running: Running) -> None:
        """It begins, or goes on, here."""
        self._running[running.inspection_id] = running

    def remove(self, running: Running) -> None:
        """It goes on elsewhere, or came back since."""
        if self._running.get(running.inspection_id) is running:
            del self._running[running.inspection_id]

    def retire(self, running: Running) -> None:
        """It has ended."""
        self._running.pop(running.inspection_id, None)
        self._ended[running.inspection_id] = running
        while len(self._ended) > _REMEMBERED:
            self._ended.popitem(last=False)
