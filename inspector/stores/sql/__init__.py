"""The store on a database: SQLite in a file or in memory, and PostgreSQL, by the same SQLAlchemy Core."""

from inspector.stores.sql.store import SqlStore

__all__ = ["SqlStore"]
