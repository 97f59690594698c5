"""Requests that may come twice: who claims a key first does the work, all others get its answer."""

from __future__ import annotations

from sqlalchemy import ColumnElement, delete, select, update

from inspector.stores.records import Claim
from inspector.stores.sql.database import insert_absent
from inspector.stores.sql.room import Room
from inspector.stores.sql.tables import CLAIMS


class Claims(Room):
    """Claims."""

    def claim(self, scope: str, key: str, fingerprint: str, t_ns: int, *, node: str | None = None) -> Claim:
        values = {"scope": scope, "key": key, "fingerprint": fingerprint, "t_ns": t_ns, "node": node}
        query = select(CLAIMS).where(CLAIMS.c.scope == scope, CLAIMS.c.key == key)
        with self._database.writing() as connection:
            while True:
                if insert_absent(connection, CLAIMS, values) is not None:
                    return Claim("new")
                # None where it was released in between.
                if (row := connection.execute(query).one_or_none()) is not None:
                    break
        if row.fingerprint != fingerprint:
            return Claim("other")
        return Claim("pending") if row.status is None else Claim("settled", row.status, row.body)

    def settle(self, scope: str, key: str, status: int, body: bytes, *, node: str | None = None) -> None:
        with self._database.writing() as connection:
            connection.execute(update(CLAIMS).where(*_pending(scope, key, node)).values(status=status, body=body))

    def release(self, scope: str, key: str, *, node: str | None = None) -> None:
        with self._database.writing() as connection:
            connection.execute(delete(CLAIMS).where(*_pending(scope, key, node)))

    def release_pending_claims(self) -> int:
        with self._database.writing() as connection:
            return connection.execute(delete(CLAIMS).where(CLAIMS.c.status.is_(None))).rowcount

    def forget_claims(self, before_ns: int) -> int:
        old = (CLAIMS.c.status.is_not(None), CLAIMS.c.t_ns < before_ns)
        with self._database.writing() as connection:
            return connection.execute(delete(CLAIMS).where(*old)).rowcount


def _pending(scope: str, key: str, node: str | None) -> tuple[ColumnElement[bool], ...]:
    """Being done by that service: one that was taken for gone has no word in what another began anew."""
    column = CLAIMS.c
    return column.scope == scope, column.key == key, column.status.is_(None), column.node.is_not_distinct_from(node)
