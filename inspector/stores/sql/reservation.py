"""One service at a time: a lock of PostgreSQL that is held as long as its connection."""

from __future__ import annotations

import threading
from typing import final

from sqlalchemy import Connection, text
from sqlalchemy.exc import DBAPIError

from inspector.stores.base import StoreInUse
from inspector.stores.sql.database import Database

LOCK = 0x494E5351


@final
class Reservation:
    """The lock, held; raises StoreInUse where another service holds it."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._one_at_a_time = threading.Lock()
        self._connection: Connection | None = self._locked()

    def renew(self) -> None:
        """Hold it again where the server was away. Raises StoreFailed, StoreInUse."""
        with self._one_at_a_time:
            try:
                if self._connection is not None:
                    self._connection.execute(text("SELECT 1"))
                    return
            except DBAPIError:
                self._let_go()
            self._connection = self._locked()

    def release(self) -> None:
        """The lock goes with the connection."""
        with self._one_at_a_time:
            self._let_go()

    def _let_go(self) -> None:
        if self._connection is not None:
            self._connection.invalidate()
            self._connection.close()
            self._connection = None

    def _locked(self) -> Connection:
        with self._database.told():
            connection = self._database.engine.connect().execution_options(isolation_level="AUTOCOMMIT")
            if connection.execute(text("SELECT pg_try_advisory_lock(:key)"), {"key": LOCK}).scalar():
                return connection
            connection.close()
        raise StoreInUse(self._database.place)
