"""The store, all rooms together."""

from __future__ import annotations

from typing import Self, final

from sqlalchemy import text

from inspector.stores.sql.access import Access
from inspector.stores.sql.claims import Claims
from inspector.stores.sql.engines import database_of
from inspector.stores.sql.inspections import Inspections
from inspector.stores.sql.jobs import Jobs
from inspector.stores.sql.migrating import migrate
from inspector.stores.sql.products import Products
from inspector.stores.sql.recipes import Recipes
from inspector.stores.sql.reservation import Reservation
from inspector.stores.sql.workspaces import Workspaces


@final
class SqlStore(Products, Workspaces, Jobs, Recipes, Inspections, Access, Claims):
    """A store on SQLite or PostgreSQL."""

    _reservation: Reservation | None = None

    @classmethod
    def open(cls, url: str) -> Self:
        database = database_of(url)
        try:
            migrate(database)
        except BaseException:
            database.engine.dispose()
            raise
        return cls(database)

    def reserve(self) -> None:
        if self._database.engine.dialect.name == "postgresql" and self._reservation is None:
            self._reservation = Reservation(self._database)

    def ping(self) -> None:
        if self._reservation is None:
            with self._database.reading() as connection:
                connection.execute(text("SELECT 1"))
        else:
            self._reservation.renew()

    def close(self) -> None:
        if self._reservation is not None:
            self._reservation.release()
            self._reservation = None
        self._database.engine.dispose()
