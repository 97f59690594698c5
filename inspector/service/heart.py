"""The heart of a service that shares its store: a thread that says that it lives, and buries those that do not.

What a service believes of itself decides nothing: the store lets only who has an inspection write to it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import final

import structlog

from inspector.errors import StoreError
from inspector.stores.base import AbstractStore
from inspector.stores.errors import NoSuchNode
from inspector.stores.records import Buried, Json, Node

BEAT_SECONDS = 1.0
DEAD_SECONDS = 3.0
"""Who was silent for longer is gone, by the clock of the database."""
GONE = "the service that did this does not answer any more"
STOPPED = "the service that did this was stopped"
_LONG_SECONDS = 86_400.0


@final
class Heart:
    """Waits for nothing but the database. Its callbacks are called in threads."""

    def __init__(
        self,
        store: AbstractStore,
        me: Node,
        *,
        facts: Callable[[], Json],
        saw: Callable[[tuple[Node, ...]], object],
        freed: Callable[[Buried, str], object],
    ) -> None:
        """`facts` is what is kept of this service; `saw` hears of all others once a second, `freed` what was buried."""
        self.trouble: str | None = None
        """Why the others do not hear from this service, where they do not."""
        self._store, self._me, self._facts, self._saw, self._freed = store, me, facts, saw, freed
        self._log = structlog.get_logger("inspector")
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heart", daemon=True)

    def start(self) -> None:
        """Join the others. Blocks. Raises StoreFailed."""
        self._join()
        # Who was silent for a while is buried later, when it is sure that it is.
        self._freed(self._store.bury(_LONG_SECONDS, GONE), GONE)
        self._look()
        self._thread.start()

    def stop(self) -> Buried:
        """Leave the others; the answer is what this service had not ended. Blocks. Raises StoreFailed."""
        self._stopped.set()
        self._thread.join()
        return self._store.leave(self._me.node_id, STOPPED)

    def _run(self) -> None:
        beaten = steady = time.monotonic()
        while not self._stopped.wait(BEAT_SECONDS):
            try:
                self._beat()
                silent = [node for node in self._look() if node.silent_seconds > DEAD_SECONDS]
                now = time.monotonic()
                if now - beaten > DEAD_SECONDS:
                    # What held this one up, as a database that was away, may hold up all: they may speak first.
                    steady = now
                beaten = now
                if silent and now - steady > DEAD_SECONDS:
                    self._freed(self._store.bury(DEAD_SECONDS, GONE), GONE)
            except StoreError as error:
                steady = time.monotonic()
                if self.trouble is None:
                    self._log.warning("service not heard", error=str(error))
                self.trouble = str(error)
            else:
                self.trouble = None

    def _join(self) -> None:
        self._store.join(self._me.node_id, self._me.name, self._me.started_ns)

    def _beat(self) -> None:
        try:
            self._store.beat(self._me.node_id, self._facts())
        except NoSuchNode:
            # What it had is not its own any more: whatever it writes to it fails.
            self._log.warning("service was taken for gone", node_id=self._me.node_id)
            self._join()

    def _look(self) -> tuple[Node, ...]:
        others = tuple(node for node in self._store.nodes() if node.node_id != self._me.node_id)
        self._saw(others)
        return others
