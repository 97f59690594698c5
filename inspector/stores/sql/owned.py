"""Whose an inspection is: what everything that writes to one asks first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, delete

from inspector.stores.errors import AlreadyConcluded, NoSuchInspection, NotOwner, StoreConflict
from inspector.stores.sql.database import found
from inspector.stores.sql.room import row_by
from inspector.stores.sql.tables import CHECKPOINT_PARTS, CHECKPOINTS, INSPECTIONS


def owned_by(node: str | None) -> tuple[ColumnElement[bool], ...]:
    """In processing, and of that service; None: of no service."""
    return INSPECTIONS.c.state == "processing", INSPECTIONS.c.node.is_not_distinct_from(node)


def not_owned(connection: Connection, inspection_id: str) -> StoreConflict:
    """Why it was not found by `owned_by`. Raises NoSuchInspection."""
    row = inspection_row(connection, inspection_id)
    if row.state != "processing":
        return AlreadyConcluded(inspection_id, row.state)
    return NotOwner(inspection_id, row.node)


def inspection_row(connection: Connection, inspection_id: str) -> Row[Any]:
    """Raises NoSuchInspection."""
    return found(row_by(connection, INSPECTIONS, "inspection_id", inspection_id), NoSuchInspection, inspection_id)


def forget_checkpoints(connection: Connection, inspection_ids: Sequence[str]) -> None:
    """They have ended."""
    for table in (CHECKPOINTS, CHECKPOINT_PARTS):
        connection.execute(delete(table).where(table.c.inspection_id.in_(inspection_ids)))
