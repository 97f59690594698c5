"""Products, their sweeps, and what was learnt of them."""

from __future__ import annotations

from dataclasses import asdict

from sqlalchemy import Connection, select

from inspector.stores.errors import NoSuchAppearance, NoSuchSweep
from inspector.stores.records import Page, Product, StoredAppearance, Sweep
from inspector.stores.sql.database import found, insert_absent, insert_new, made, page
from inspector.stores.sql.room import Room, product_row, row_by
from inspector.stores.sql.tables import APPEARANCES, PRODUCTS, SWEEPS


class Products(Room):
    """Products, sweeps, appearances."""

    def ensure_product(self, product_id: str, t_ns: int) -> Product:
        with self._database.writing() as connection:
            ensure_product(connection, product_id, t_ns)
            return made(Product, product_row(connection, product_id))

    def product(self, product_id: str) -> Product:
        with self._database.reading() as connection:
            return made(Product, product_row(connection, product_id))

    def products(self, after: int | None = None, limit: int = 50) -> Page[Product]:
        with self._database.reading() as connection:
            return page(connection, select(PRODUCTS), Product, after, limit)

    def add_sweep(self, sweep: Sweep) -> None:
        with self._database.writing() as connection:
            ensure_product(connection, sweep.product_id, sweep.created_ns)
            insert_new(connection, SWEEPS, "sweep", sweep.sweep_id, asdict(sweep))

    def sweep(self, sweep_id: str) -> Sweep:
        with self._database.reading() as connection:
            return made(Sweep, found(row_by(connection, SWEEPS, "sweep_id", sweep_id), NoSuchSweep, sweep_id))

    def sweeps(self, product_id: str, after: int | None = None, limit: int = 50) -> Page[Sweep]:
        with self._database.reading() as connection:
            product_row(connection, product_id)
            query = select(SWEEPS).where(SWEEPS.c.product_id == product_id)
            return page(connection, query, Sweep, after, limit)

    def add_appearance(self, appearance: StoredAppearance) -> StoredAppearance:
        with self._database.writing() as connection:
            product_row(connection, appearance.product_id)
            insert_absent(connection, APPEARANCES, asdict(appearance))
            return appearance_of(connection, appearance.product_id, appearance.appearance_id)

    def appearance(self, product_id: str, appearance_id: str) -> StoredAppearance:
        with self._database.reading() as connection:
            return appearance_of(connection, product_id, appearance_id)

    def appearances(self, product_id: str, after: int | None = None, limit: int = 50) -> Page[StoredAppearance]:
        with self._database.reading() as connection:
            product_row(connection, product_id)
            query = select(APPEARANCES).where(APPEARANCES.c.product_id == product_id)
            return page(connection, query, StoredAppearance, after, limit)


def ensure_product(connection: Connection, product_id: str, t_ns: int) -> None:
    """The product is there afterwards."""
    insert_absent(connection, PRODUCTS, {"product_id": product_id, "created_ns": t_ns})


def appearance_of(connection: Connection, product_id: str, appearance_id: str) -> StoredAppearance:
    """Raises NoSuchAppearance."""
    query = select(APPEARANCES).where(
        APPEARANCES.c.product_id == product_id, APPEARANCES.c.appearance_id == appearance_id
    )
    return made(StoredAppearance, found(connection.execute(query).one_or_none(), NoSuchAppearance, appearance_id))
