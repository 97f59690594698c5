"""Inspections that go from one service to another, and how far they are."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, Table, select, update
from sqlalchemy.dialects import postgresql, sqlite

from inspector.stores.records import Checkpoint, StoredInspection
from inspector.stores.sql.database import made
from inspector.stores.sql.owned import not_owned, owned_by
from inspector.stores.sql.room import Room
from inspector.stores.sql.tables import CHECKPOINT_PARTS, CHECKPOINTS, INSPECTIONS

_COLUMN = INSPECTIONS.c


class Checkpoints(Room):
    """Who has an inspection, and its checkpoint."""

    def take_inspection(self, inspection_id: str, node: str) -> tuple[StoredInspection, Checkpoint | None]:
        taken = (
            update(INSPECTIONS)
            .where(_COLUMN.inspection_id == inspection_id, _COLUMN.state == "processing")
            .values(node=node, left_ns=None, takes=_COLUMN.takes + 1)
            .returning(INSPECTIONS)
        )
        with self._database.writing() as connection:
            row = connection.execute(taken).one_or_none()
            if row is None:
                raise not_owned(connection, inspection_id)
            return made(StoredInspection, row), _checkpoint(connection, inspection_id)

    def release_inspection(self, inspection_id: str, node: str, t_ns: int) -> StoredInspection:
        released = (
            update(INSPECTIONS)
            .where(_COLUMN.inspection_id == inspection_id, *owned_by(node))
            .values(node=None, left_ns=t_ns)
            .returning(INSPECTIONS)
        )
        with self._database.writing() as connection:
            row = connection.execute(released).one_or_none()
            if row is None:
                raise not_owned(connection, inspection_id)
            return made(StoredInspection, row)

    def save_checkpoint(self, inspection_id: str, node: str, number: int, state: bytes, added: bytes) -> None:
        # Locked until this is done: who takes it at the same time waits, and gets this, or comes first.
        owned = (
            select(_COLUMN.number)
            .where(_COLUMN.inspection_id == inspection_id, *owned_by(node))
            .with_for_update(read=True)
        )
        with self._database.writing() as connection:
            if connection.execute(owned).one_or_none() is None:
                raise not_owned(connection, inspection_id)
            _put(connection, CHECKPOINTS, {"inspection_id": inspection_id}, {"state": state})
            _put(connection, CHECKPOINT_PARTS, {"inspection_id": inspection_id, "number": number}, {"added": added})

    def ownerless(self) -> tuple[StoredInspection, ...]:
        query = select(INSPECTIONS).where(*owned_by(None)).order_by(_COLUMN.number)
        with self._database.reading() as connection:
            return tuple(made(StoredInspection, row) for row in connection.execute(query))


def _checkpoint(connection: Connection, inspection_id: str) -> Checkpoint | None:
    asked = select(CHECKPOINTS.c.state).where(CHECKPOINTS.c.inspection_id == inspection_id)
    state = connection.execute(asked).scalar_one_or_none()
    part = CHECKPOINT_PARTS.c
    parts = select(part.added).where(part.inspection_id == inspection_id).order_by(part.number)
    added = tuple(connection.execute(parts).scalars())
    return None if state is None and not added else Checkpoint(state or b"", added)


def _put(connection: Connection, table: Table, key: dict[str, Any], values: dict[str, Any]) -> None:
    """A new row, or instead of the one that is there."""
    insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
    connection.execute(
        insert(table).values(key | values).on_conflict_do_update(index_elements=[*key], set_=values)
    )  # fmt: skip
