"""A database behind the store: its connections, its transactions, and what goes wrong with them as one sentence."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, fields
from functools import cache
from typing import Any, TypeVar, cast

from sqlalchemy import Connection, Engine, Row, Select, Table
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import DBAPIError, TimeoutError

from inspector.stores.errors import IdTaken, StoreFailed
from inspector.stores.records import Page

R = TypeVar("R")
LARGEST = 2**63 - 1


@dataclass(frozen=True)
class Database:
    """An engine, and the name under which messages speak of it."""

    engine: Engine
    place: str
    writers: threading.Lock
    """SQLite has one writer at a time, and those who wait for the file are not served in order: they wait here."""

    @property
    def errors(self) -> tuple[type[Exception], ...]:
        """What the database raises: through SQLAlchemy, and from the driver itself while it connects."""
        return DBAPIError, self.engine.dialect.loaded_dbapi.Error

    @contextmanager
    def reading(self) -> Generator[Connection]:
        """A transaction that only reads. Raises StoreFailed."""
        with self.told(), self.engine.connect() as connection:
            yield connection

    @contextmanager
    def writing(self) -> Generator[Connection]:
        """A transaction: done in the end, undone where something is raised. Raises StoreFailed."""
        turn = self.writers if self.engine.dialect.name == "sqlite" else nullcontext()
        with turn, self.told(), self.engine.connect() as plain:
            connection = plain.execution_options(writing=True)
            with connection.begin():
                yield connection

    @contextmanager
    def told(self) -> Generator[None]:
        """What the database raises becomes StoreFailed."""
        try:
            yield
        except self.errors as error:
            raise StoreFailed(self.place, sentence(error)) from error
        except TimeoutError as error:
            raise StoreFailed(self.place, "all its connections are in use") from error


def sentence(error: Exception) -> str:
    """What the driver says, on one line."""
    said = error.orig if isinstance(error, DBAPIError) else error
    return "; ".join(line.strip() for line in str(said).splitlines() if line.strip()) or type(said).__name__


def made(kind: type[R], row: Row[Any]) -> R:
    """The record from the row's columns of the same names; lists become tuples."""
    values = row._mapping  # pyright: ignore[reportPrivateUsage]  # so named to leave the columns their names
    return kind(**{name: _frozen(values[name]) for name in names(kind)})


def _frozen(value: Any) -> Any:
    return tuple(cast("list[Any]", value)) if isinstance(value, list) else value


@cache
def names(kind: Any) -> tuple[str, ...]:
    """The fields of a record."""
    return tuple(field.name for field in fields(kind))


def page(connection: Connection, query: Select[Any], kind: type[R], after: int | None, limit: int) -> Page[R]:
    """The newest `limit` rows with a number below `after`."""
    number = query.selected_columns.number
    if after is not None:
        query = query.where(number < max(-LARGEST, min(after, LARGEST)))
    rows = connection.execute(query.order_by(number.desc()).limit(limit + 1)).all()
    following = rows[limit - 1].number if len(rows) > limit else None
    return Page(tuple(made(kind, row) for row in rows[:limit]), following)


def insert_absent(connection: Connection, table: Table, values: dict[str, Any]) -> Row[Any] | None:
    """The row as it was inserted; None where its id is taken."""
    insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
    statement = insert(table).values(values).on_conflict_do_nothing().returning(table)
    return connection.execute(statement).one_or_none()


def insert_new(connection: Connection, table: Table, thing: str, id: str, values: dict[str, Any]) -> Row[Any]:
    """The row as it was inserted. Raises IdTaken."""
    row = insert_absent(connection, table, values)
    if row is None:
        raise IdTaken(thing, id)
    return row


def found(row: Row[Any] | None, missing: Callable[[str], Exception], id: str) -> Row[Any]:
    """The row. Raises `missing(id)` where there is none."""
    if row is None:
        raise missing(id)
    return row
