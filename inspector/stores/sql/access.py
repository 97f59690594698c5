"""The audit trail, and the tokens of those who may ask."""

from __future__ import annotations

from sqlalchemy import select, update

from inspector.stores.errors import NoSuchToken
from inspector.stores.records import AuditEntry, Json, Page, Role, Token
from inspector.stores.sql.database import found, insert_new, made, page
from inspector.stores.sql.room import Room, row_by, write_down
from inspector.stores.sql.tables import AUDIT, TOKENS


class Access(Room):
    """Audit trail, tokens."""

    def add_audit(
        self, *, t_ns: int, actor: str, action: str, thing: str, before: Json | None = None, after: Json | None = None
    ) -> AuditEntry:
        with self._database.writing() as connection:
            row = write_down(connection, t_ns=t_ns, actor=actor, action=action, thing=thing, before=before, after=after)
            return made(AuditEntry, row)

    def audit(self, after: int | None = None, limit: int = 50) -> Page[AuditEntry]:
        with self._database.reading() as connection:
            return page(connection, select(AUDIT), AuditEntry, after, limit)

    def add_token(self, token_id: str, name: str, role: Role, sha256: str, *, actor: str, t_ns: int) -> Token:
        values = {"token_id": token_id, "name": name, "role": role, "sha256": sha256, "created_ns": t_ns}
        with self._database.writing() as connection:
            row = insert_new(connection, TOKENS, "token", token_id, values)
            write_down(
                connection,
                t_ns=t_ns,
                actor=actor,
                action="token.add",
                thing=token_id,
                before=None,
                after={"name": name, "role": role},
            )
            return made(Token, row)

    def revoke_token(self, token_id: str, *, actor: str, t_ns: int) -> Token:
        mine = TOKENS.c.token_id == token_id
        first = update(TOKENS).where(mine, TOKENS.c.revoked_ns.is_(None)).values(revoked_ns=t_ns).returning(TOKENS)
        with self._database.writing() as connection:
            row = connection.execute(first).one_or_none()
            if row is None:
                return made(Token, found(row_by(connection, TOKENS, "token_id", token_id), NoSuchToken, token_id))
            token = made(Token, row)
            write_down(
                connection,
                t_ns=t_ns,
                actor=actor,
                action="token.revoke",
                thing=token_id,
                before={"name": token.name, "role": token.role},
                after=None,
            )
            return token

    def tokens(self) -> tuple[Token, ...]:
        with self._database.reading() as connection:
            return tuple(
                made(Token, row) for row in connection.execute(select(TOKENS).order_by(TOKENS.c.number.desc()))
            )

    def token_by_hash(self, sha256: str) -> Token | None:
        with self._database.reading() as connection:
            row = row_by(connection, TOKENS, "sha256", sha256)
            return made(Token, row) if row else None
