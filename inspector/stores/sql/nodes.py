"""The services that work on the store: they say that they live, and what those that do not had is free again."""

from __future__ import annotations

from typing import Any

from sqlalchemy import BigInteger, ColumnElement, Connection, Row, delete, literal_column, or_, select, update

from inspector.stores.errors import NoSuchNode
from inspector.stores.records import Buried, Json, Node
from inspector.stores.sql.database import insert_absent
from inspector.stores.sql.room import Room
from inspector.stores.sql.tables import CLAIMS, INSPECTIONS, JOBS, NODES

_NOW = {
    "sqlite": "CAST(ROUND((julianday('now') - 2440587.5) * 86400000) AS INTEGER) * 1000000",
    "postgresql": "CAST(extract(epoch FROM clock_timestamp()) * 1000000 AS bigint) * 1000",
}


class Nodes(Room):
    """Services."""

    def join(self, node_id: str, name: str, t_ns: int) -> None:
        with self._database.writing() as connection:
            now = database_ns(connection)
            values: dict[str, Any] = {"node_id": node_id, "name": name, "started_ns": t_ns, "facts": {}}
            if insert_absent(connection, NODES, values | {"beaten_ns": now}) is None:
                connection.execute(update(NODES).where(NODES.c.node_id == node_id).values(beaten_ns=now))

    def beat(self, node_id: str, facts: Json | None = None) -> None:
        with self._database.writing() as connection:
            values: dict[str, Any] = {"beaten_ns": database_ns(connection)}
            if facts is not None:
                values["facts"] = facts
            if not connection.execute(update(NODES).where(NODES.c.node_id == node_id).values(values)).rowcount:
                raise NoSuchNode(node_id)

    def leave(self, node_id: str, why: str) -> Buried:
        return self._gone(why, NODES.c.node_id == node_id)

    def nodes(self) -> tuple[Node, ...]:
        with self._database.reading() as connection:
            query = select(NODES, database_ns(connection).label("now_ns")).order_by(NODES.c.number)
            return tuple(map(_node, connection.execute(query)))

    def bury(self, silent_seconds: float, why: str) -> Buried:
        return self._gone(why, silent_seconds=silent_seconds)

    def _gone(self, why: str, which: ColumnElement[bool] | None = None, silent_seconds: float = 0) -> Buried:
        """Those services, or those that were silent, are not there any more; nobody does what they did."""
        with self._database.writing() as connection:
            now = database_ns(connection)
            if which is None:
                which = NODES.c.beaten_ns < now - int(silent_seconds * 1e9)
            dead = connection.execute(delete(NODES).where(which).returning(NODES, now.label("now_ns"))).all()
            jobs = (
                update(JOBS)
                .where(JOBS.c.state == "running", _undone(JOBS.c.node))
                .values(state="failed", ended_ns=now, error=why)
            )
            inspection = INSPECTIONS.c
            left = (
                update(INSPECTIONS)
                .where(inspection.state == "processing", inspection.left_ns.is_(None), _undone(inspection.node))
                .values(node=None, left_ns=now)
            )
            connection.execute(delete(CLAIMS).where(CLAIMS.c.status.is_(None), _undone(CLAIMS.c.node)))
            job_ids = sorted(connection.execute(jobs.returning(JOBS.c.job_id)).scalars())
            inspection_ids = sorted(connection.execute(left.returning(inspection.inspection_id)).scalars())
            return Buried(tuple(map(_node, dead)), tuple(job_ids), tuple(inspection_ids))


def database_ns(connection: Connection) -> ColumnElement[int]:
    """The time by the clock of the database, which all services share."""
    return literal_column(_NOW[connection.dialect.name], BigInteger)


def _undone(node: ColumnElement[Any]) -> ColumnElement[bool]:
    """Of no service, or of one that is not there."""
    return or_(node.is_(None), node.not_in(select(NODES.c.node_id)))


def _node(row: Row[Any]) -> Node:
    silent = max(0.0, (row.now_ns - row.beaten_ns) / 1e9)
    return Node(row.node_id, row.name, row.started_ns, silent, row.facts)
