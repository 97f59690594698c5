"""Who may do what: tokens, of which only the hash is kept, and roles, each of which may do what those before it may.

inspector.errors.WorldError
└── AccessRefused            somebody who may not do what they ask for
    ├── TokenMissing         no token, where one is needed
    ├── TokenRefused         a token that nobody was given, or that was revoked
    └── RoleTooLow           a token whose role is not enough
"""

from __future__ import annotations

import asyncio
import hashlib
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass

from inspector.errors import WorldError
from inspector.service.folder import new_id
from inspector.stores import AbstractStore
from inspector.stores.records import Role, Token

ROLES: tuple[Role, ...] = ("viewer", "operator", "engineer", "admin")
"""From the one that may only look to the one that may do everything."""
FRESH_SECONDS = 2.0
"""For so long a token that was right is believed: a line does not wait for the database with every frame."""


class AccessRefused(WorldError):
    """Somebody who may not do what they ask for."""


class TokenMissing(AccessRefused):
    """No token, where one is needed."""

    def __init__(self) -> None:
        super().__init__("this service asks for a token; send it as `Authorization: Bearer TOKEN`")


class TokenRefused(AccessRefused):
    """A token that nobody was given, or that was revoked."""

    def __init__(self) -> None:
        super().__init__("this token is not known here, or was revoked; ask an admin for another")


class RoleTooLow(AccessRefused):
    """A token whose role is not enough."""

    def __init__(self, role: Role, needed: Role) -> None:
        super().__init__(f"this token has the role {role}; needed is {needed}")


@dataclass(frozen=True)
class Who:
    """Somebody who asks."""

    actor: str
    """For the audit trail."""
    role: Role


LOCAL = Who("local", "admin")
"""Everybody, where no token is asked for."""


class Access:
    """Tells who asks by the token that they show."""

    def __init__(
        self,
        store: AbstractStore,
        asks_for_tokens: bool,
        now_ns: Callable[[], int] = time.time_ns,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.asks_for_tokens = asks_for_tokens
        self._store, self._now_ns, self._clock = store, now_ns, clock
        self._known: dict[str, tuple[Who, float]] = {}

    async def who(self, token: str | None, needed: Role) -> Who:
        """Who shows this token. Raises AccessRefused where they may not do what needs that role."""
        if not self.asks_for_tokens:
            return LOCAL
        if token is None:
            raise TokenMissing
        who = await self._owner(hashed(token))
        if ROLES.index(who.role) < ROLES.index(needed):
            raise RoleTooLow(who.role, needed)
        return who

    async def _owner(self, digest: str) -> Who:
        # Looked up by the hash: how long that takes tells nothing about the token.
        who, until = self._known.get(digest, (None, 0.0))
        if who is not None and self._clock() < until:
            return who
        self._known.pop(digest, None)
        token = await asyncio.to_thread(self._store.token_by_hash, digest)
        if token is None or token.revoked_ns is not None:
            raise TokenRefused
        who = Who(f"{token.name} ({token.token_id})", token.role)
        self._known[digest] = who, self._clock() + FRESH_SECONDS
        return who

    def make(self, name: str, role: Role, actor: str) -> tuple[Token, str]:
        """A new token, and its text, which is kept nowhere. Blocks."""
        text = secrets.token_urlsafe(32)
        return self._store.add_token(
            new_id(), name, role, hashed(text), actor=actor, t_ns=self._now_ns()
        ), text  # fmt: skip

    def make_first(self) -> str | None:
        """The text of an admin's token, where tokens are asked for and no admin has one. Blocks.

        Of services that start at once on one store, one makes it.
        """
        with self._store.only_one("first token") as mine:
            admins = (token for token in self._store.tokens() if token.role == "admin" and token.revoked_ns is None)
            if not mine or not self.asks_for_tokens or any(admins):
                return None
            return self.make("first admin", "admin", "the service")[1]

    def revoke(self, token_id: str, actor: str) -> Token:
        """The token is refused from now on. Blocks. Raises NoSuchToken."""
        token = self._store.revoke_token(token_id, actor=actor, t_ns=self._now_ns())
        self._known.pop(token.sha256, None)
        return token


def hashed(token: str) -> str:
    """What is kept of a token. No salt: it is 256 random bits, not a password."""
    return hashlib.sha256(token.encode()).hexdigest()
