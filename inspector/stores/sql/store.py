"""The store, all rooms together."""

from __future__ import annotations

from typing import Self, final

from sqlalchemy import text

from inspector.stores.sql.access import Access
from inspector.stores.sql.checkpoints import Checkpoints
from inspector.stores.sql.claims import Claims
from inspector.stores.sql.engines import database_of
from inspector.stores.sql.inspections import Inspections
from inspector.stores.sql.jobs import Jobs
from inspector.stores.sql.migrating import migrate
from inspector.stores.sql.nodes import Nodes
from inspector.stores.sql.products import Products
from inspector.stores.sql.recipes import Recipes
from inspector.stores.sql.telling import Telling
from inspector.stores.sql.workspaces import Workspaces


@final
class SqlStore(Products, Workspaces, Jobs, Recipes, Inspections, Checkpoints, Access, Claims, Nodes, Telling):
    """A store on SQLite or PostgreSQL."""

    @classmethod
    def open(cls, url: str) -> Self:
        database = database_of(url)
        try:
            migrate(database)
        except BaseException:
            database.engine.dispose()
            raise
        return cls(database)

    def ping(self) -> None:
        with self._database.reading() as connection:
            connection.execute(text("SELECT 1"))

    def close(self) -> None:
        self._database.engine.dispose()
