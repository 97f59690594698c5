"""Work that nobody waits for: not lost while it runs, and ended in order when the service stops."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")
_FINISH_SECONDS = 5.0
"""How long what must be done may take when the service stops."""


class Background:
    """Tasks on the event loop."""

    def __init__(self) -> None:
        self._tasks: set[asyncio.Task[Any]] = set()
        self._needed: set[asyncio.Task[Any]] = set()

    def keep(self, work: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """A task that ends with the service, if not before."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def finish(self, work: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        """A task that the end of the service waits for."""
        task = self.keep(work)
        self._needed.add(task)
        task.add_done_callback(self._needed.discard)
        return task

    async def stop(self) -> None:
        """What must be done is waited for, and what that begins; then the rest is cancelled."""
        loop = asyncio.get_running_loop()
        until = loop.time() + _FINISH_SECONDS
        while self._needed and loop.time() < until:
            await asyncio.wait(self._needed, timeout=until - loop.time())
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
