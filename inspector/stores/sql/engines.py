"""From a url to a database: SQLite in a file, SQLite in memory, PostgreSQL."""

from __future__ import annotations

import json
import threading
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, QueuePool, create_engine, event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError

from inspector.stores.errors import StoreNotOpened
from inspector.stores.sql.database import Database

CONNECTIONS = 8
"""At most so many at a time; who needs one more waits."""
PATIENCE_S = 30
"""How long to wait for a connection, or for the lock of another process."""

_LIVELY = {"keepalives_idle": 5, "keepalives_interval": 2, "keepalives_count": 3, "tcp_user_timeout": 10_000}
"""A server that is away without saying so is found to be, within 11 seconds."""


def database_of(url: str) -> Database:
    """Connected when first used. Raises StoreNotOpened: a url that cannot be read, a driver that is not installed."""
    scheme, _, rest = url.partition(":")
    match scheme:
        case "memory":
            return _sqlite(":memory:", "memory:", 1)
        case "sqlite":
            return _sqlite_file(rest)
        case _:
            return _postgresql(url)


def _sqlite_file(rest: str) -> Database:
    """`sqlite:PATH`, or as SQLAlchemy has it, `sqlite:///PATH`."""
    name = rest.removeprefix("///")
    path = Path(name)
    if not name or path.is_dir():
        raise StoreNotOpened(f"sqlite:{rest}", "it names no file; allowed is sqlite:FOLDER/FILE")
    if not path.parent.is_dir():
        raise StoreNotOpened(f"sqlite:{name}", f"there is no folder {path.parent}")
    # A new file is its owner's alone, and so is its log. What keeps it from being made, SQLite says better.
    with suppress(OSError):
        path.touch(0o600)
    return _sqlite(str(path), f"sqlite:{name}", CONNECTIONS)


def _sqlite(path: str, place: str, connections: int) -> Database:
    engine = _engine(
        URL.create("sqlite", database=path),
        connections,
        {"timeout": PATIENCE_S, "check_same_thread": False, "isolation_level": None},
    )
    event.listen(engine, "connect", _prepare)
    event.listen(engine, "begin", _begin)
    return Database(engine, place, threading.Lock())


def _prepare(connection: Any, record: object) -> None:
    connection.execute("PRAGMA foreign_keys = ON")
    connection.execute("PRAGMA synchronous = FULL")


def _begin(connection: Connection) -> None:
    """A writer says so at once: one that had read before could not become one while another writes."""
    writing = connection.get_execution_options().get("writing", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writing else "BEGIN")


def _postgresql(url: str) -> Database:
    try:
        parsed = make_url(url)
    except (ArgumentError, ValueError) as error:
        allowed = "it cannot be read; allowed is postgresql://USER:PASSWORD@HOST:PORT/NAME"
        raise StoreNotOpened("postgresql:", allowed) from error
    port = f":{parsed.port}" if parsed.port else ""
    place = f"postgresql://{parsed.host or ''}{port}/{parsed.database or ''}"
    usual = {"connect_timeout": 10, "application_name": "inspector", "client_encoding": "utf8", **_LIVELY}
    try:
        engine = _engine(
            parsed.set(drivername="postgresql+psycopg"),
            CONNECTIONS,
            {name: value for name, value in usual.items() if name not in parsed.query},
        )
    except ModuleNotFoundError as error:
        why = "psycopg is not installed; pip install 'sweep-inspector[postgres]'"
        raise StoreNotOpened(place, why) from error
    return Database(engine, place, threading.Lock())


def _engine(url: URL, connections: int, arguments: dict[str, Any]) -> Engine:
    return create_engine(
        url,
        poolclass=QueuePool,
        pool_size=connections,
        max_overflow=0,
        pool_timeout=PATIENCE_S,
        pool_pre_ping=url.get_backend_name() == "postgresql",
        connect_args=arguments,
        json_serializer=partial(json.dumps, allow_nan=False),
    )


def keep_a_log_ahead(engine: Engine) -> str:
    """SQLite's journal as a log that is written ahead, so that readers and the writer do not wait for each other.

    The answer is the journal's mode, `wal` where it could be had. Two processes that open a new file at once stand in
    each other's way here, and SQLite does not let them wait.
    """
    until = time.monotonic() + PATIENCE_S
    pooled = engine.raw_connection()
    try:
        while True:
            try:
                return str(pooled.driver_connection.execute("PRAGMA journal_mode = WAL").fetchone()[0])  # pyright: ignore
            except engine.dialect.loaded_dbapi.OperationalError as error:
                if "locked" not in str(error) or time.monotonic() > until:
                    raise
                time.sleep(0.02)
    finally:
        pooled.close()
