"""What services tell each other: PostgreSQL's LISTEN and NOTIFY, and a table for what is too much for these."""

from __future__ import annotations

import threading
import time
import zlib
from collections.abc import Callable, Collection, Generator
from contextlib import contextmanager, suppress
from typing import Any, final

from sqlalchemy import Connection, delete, insert, select, text

from inspector.stores.errors import StoreFailed
from inspector.stores.sql.database import Database
from inspector.stores.sql.nodes import database_ns
from inspector.stores.sql.room import Room
from inspector.stores.sql.tables import TOLD

_CHANNEL = "inspector"
_MOST = 7900
"""Bytes of a notification; PostgreSQL takes fewer than 8000."""
_KEPT_NS = 60_000_000_000
_SWEEP_SECONDS = 10.0
_TURN_SECONDS = 0.25
"""How long the end of listening may take."""
_AGAIN_SECONDS = 0.5
_TURNS = 0x494E5352
"""The advisory locks of `only_one` are this, and a number made of their name."""
_NOTIFY = text("SELECT pg_notify(:channel, :said)")


class Telling(Room):
    """Notifications, and who may do what only one may."""

    def __init__(self, database: Database) -> None:
        super().__init__(database)
        self._here: set[str] = set()
        self._asking = threading.Lock()
        self._swept = 0.0

    @property
    def shared(self) -> bool:
        return self._database.engine.dialect.name == "postgresql"

    def tell(self, body: bytes, to: Collection[str] | None = None) -> None:
        if not self.shared:
            return
        channels = [_CHANNEL] if to is None else [_channel(node_id) for node_id in to]
        with self._database.writing() as connection:
            said = _said(body)
            if said is None:
                # What a crash of the server loses of this nobody misses.
                connection.execute(text("SET LOCAL synchronous_commit = off"))
                kept = insert(TOLD).values(told_ns=database_ns(connection), body=body).returning(TOLD.c.number)
                said = f"#{connection.execute(kept).scalar_one()}"
                self._sweep(connection)
            for channel in channels:
                connection.execute(_NOTIFY, {"channel": channel, "said": said})

    def _sweep(self, connection: Connection) -> None:
        """Now and then: what everybody has read."""
        if time.monotonic() - self._swept > _SWEEP_SECONDS:
            self._swept = time.monotonic()
            connection.execute(delete(TOLD).where(TOLD.c.told_ns < database_ns(connection) - _KEPT_NS))

    @contextmanager
    def listen(self, node_id: str, heard: Callable[[bytes | None], object]) -> Generator[None]:
        if not self.shared:
            yield
            return
        ear = _Ear(self._database, (_CHANNEL, _channel(node_id)), heard)
        try:
            yield
        finally:
            ear.close()

    @contextmanager
    def only_one(self, name: str) -> Generator[bool]:
        if not self.shared:
            # There is one service.
            with self._asking:
                mine = name not in self._here
                self._here.add(name)
            try:
                yield mine
            finally:
                if mine:
                    self._here.discard(name)
            return
        key = {"turns": _TURNS, "name": zlib.crc32(name.encode()) - 2**31}
        with self._database.told():
            pooled = self._database.engine.connect()
        with pooled as connection:
            alone = connection.execution_options(isolation_level="AUTOCOMMIT")
            with self._database.told():
                mine = bool(alone.execute(text("SELECT pg_try_advisory_lock(:turns, :name)"), key).scalar())
            try:
                yield mine
            finally:
                if mine:
                    # Where the connection is lost, the lock is gone with it.
                    with suppress(*self._database.errors):
                        alone.execute(text("SELECT pg_advisory_unlock(:turns, :name)"), key)


@final
class _Ear:
    """A thread with a connection of its own, which hears what is told on channels."""

    def __init__(self, database: Database, channels: Collection[str], heard: Callable[[bytes | None], object]) -> None:
        self._database, self._channels, self._heard = database, channels, heard
        self._closed = threading.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name="listen", daemon=True)
        self._thread.start()
        # What is told after this is heard, unless the database does not answer.
        self._ready.wait(_AGAIN_SECONDS * 4)

    def close(self) -> None:
        """Nothing is heard after this."""
        self._closed.set()
        self._thread.join()

    def _run(self) -> None:
        first = True
        while not self._closed.is_set():
            with suppress(StoreFailed), self._database.told():
                self._listen(first)
            first = False
            self._closed.wait(_AGAIN_SECONDS)

    def _listen(self, first: bool) -> None:
        """Until it is closed, or the connection breaks."""
        pooled = self._database.engine.raw_connection()
        # The driver itself: SQLAlchemy has no words for it.
        driver: Any = pooled.driver_connection
        # Held for good: not one of those that requests share.
        pooled.detach()
        try:
            driver.autocommit = True
            for channel in self._channels:
                driver.execute(f'LISTEN "{channel}"')
            self._ready.set()
            if not first:
                self._heard(None)
            while not self._closed.is_set():
                for notification in driver.notifies(timeout=_TURN_SECONDS):
                    self._hear(notification.payload)
        finally:
            # Without a rollback, which would complain where the server is gone.
            pooled.invalidate()
            with suppress(*self._database.errors):
                driver.close()

    def _hear(self, said: str) -> None:
        if said.startswith("="):
            self._heard(said[1:].encode())
            return
        asked = select(TOLD.c.body).where(TOLD.c.number == int(said[1:]))
        with self._database.reading() as connection:
            body = connection.execute(asked).scalar_one_or_none()
        # It is not there any more where this was away for long.
        self._heard(body)


def _said(body: bytes) -> str | None:
    """As a notification; None where it is too long for one, or no text."""
    if len(body) < _MOST and body.isascii() and b"\0" not in body:
        return f"={body.decode()}"
    return None


def _channel(node_id: str) -> str:
    return f"{_CHANNEL}_{node_id}"
