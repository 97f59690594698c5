"""What the rooms of the store share: the database. Each room answers for one noun, and the store is all of them."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, Row, Table, insert, select

from inspector.stores.base import AbstractStore
from inspector.stores.errors import NoSuchProduct
from inspector.stores.records import Json
from inspector.stores.sql.database import Database, found
from inspector.stores.sql.tables import AUDIT, PRODUCTS


class Room(AbstractStore):
    """A part of the store: the methods of one noun."""

    def __init__(self, database: Database) -> None:
        self._database = database


def product_row(connection: Connection, product_id: str, *, lock: bool = False) -> Row[Any]:
    """The product; locked, others that lock it wait until this transaction ends. Raises NoSuchProduct.

    SQLite needs no such lock: its writers come one after the other.
    """
    query = select(PRODUCTS).where(PRODUCTS.c.product_id == product_id)
    if lock:
        # Inspections that begin refer to the product at the same time, and need not wait.
        query = query.with_for_update(key_share=True)
    return found(connection.execute(query).one_or_none(), NoSuchProduct, product_id)


def write_down(
    connection: Connection, *, t_ns: int, actor: str, action: str, thing: str, before: Json | None, after: Json | None
) -> Row[Any]:
    """An entry of the audit trail, in the transaction of what it tells."""
    values = {"t_ns": t_ns, "actor": actor, "action": action, "thing": thing, "before": before, "after": after}
    return connection.execute(insert(AUDIT).values(values).returning(AUDIT)).one()


def row_by(connection: Connection, table: Table, name: str, id: str) -> Row[Any] | None:
    """The row whose column of that name is the id."""
    return connection.execute(select(table).where(table.c[name] == id)).one_or_none()
