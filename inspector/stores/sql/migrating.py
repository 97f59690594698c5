"""Bring a database to the tables of this program; the scripts are in `inspector/stores/migrations`."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, inspect, select, text

from inspector.stores.errors import NewerStore, OlderServices, StoreNotOpened
from inspector.stores.sql.database import Database, sentence
from inspector.stores.sql.engines import keep_a_log_ahead
from inspector.stores.sql.nodes import database_ns
from inspector.stores.sql.tables import NODES

SCRIPTS = Path(__file__).parent.parent / "migrations"
LOCK = 0x494E5350
"""The advisory lock of PostgreSQL that whoever migrates holds."""
ALIVE_SECONDS = 3.0
"""A service that said so a longer time ago does not live, as `inspector.service.heart` has it."""
_ALEMBIC = threading.Lock()
"""Alembic hands the connection to its scripts by a global."""


def migrate(database: Database) -> None:
    """All scripts that have not run, in one transaction; who comes at the same time waits.

    Not while services work on the tables as they were. Raises StoreNotOpened, NewerStore, OlderServices.
    """
    is_sqlite = database.engine.dialect.name == "sqlite"
    try:
        if is_sqlite and (journal := keep_a_log_ahead(database.engine)) not in ("wal", "memory"):
            raise StoreNotOpened(database.place, f"its journal cannot be a log written ahead, but only {journal!r}")
        with _ALEMBIC, database.engine.connect() as plain:
            connection = plain.execution_options(writing=True)
            driver: Any = connection.connection.driver_connection
            if is_sqlite:
                # Of no effect inside a transaction.
                driver.execute("PRAGMA foreign_keys = OFF")
            try:
                with connection.begin():
                    _upgrade(connection, database.place)
            finally:
                if is_sqlite:
                    driver.execute("PRAGMA foreign_keys = ON")
    except database.errors as error:
        raise StoreNotOpened(database.place, sentence(error)) from error


def _upgrade(connection: Connection, place: str) -> None:
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": LOCK})
    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(SCRIPTS).replace("%", "%%"))
    scripts = ScriptDirectory.from_config(config)
    known = {script.revision for script in scripts.walk_revisions()}
    head = scripts.get_current_head()
    there = MigrationContext.configure(connection).get_current_heads()
    if strange := set(there) - known:
        raise NewerStore(place, ", ".join(sorted(strange)), str(head))
    if there == (head,):
        return
    if names := _at_work(connection):
        raise OlderServices(place, ", ".join(there), str(head), names)
    command.upgrade(config, "head")
    if connection.dialect.name == "sqlite" and (broken := connection.exec_driver_sql("PRAGMA foreign_key_check").all()):
        raise StoreNotOpened(place, f"after its migration, {len(broken)} rows point to what is not there")


def _at_work(connection: Connection) -> tuple[str, ...]:
    """Names of the services that lived a moment ago."""
    if not inspect(connection).has_table(NODES.name):
        return ()
    alive = NODES.c.beaten_ns > database_ns(connection) - int(ALIVE_SECONDS * 1e9)
    return tuple(connection.execute(select(NODES.c.name).where(alive).order_by(NODES.c.number)).scalars())
