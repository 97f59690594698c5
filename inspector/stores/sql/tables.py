"""The tables. Every one has a `number` that increases, which lists are ordered by; ids are text, times nanoseconds."""

from __future__ import annotations

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    Float,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Table,
    Text,
    UniqueConstraint,
    false,
    text,
)
from sqlalchemy.engine import Dialect
from sqlalchemy.types import TypeDecorator

METADATA = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
    }
)


class Words(TypeDecorator[str]):
    """Text that every database takes: what UTF-8 has no bytes for, and the zero that PostgreSQL refuses, are `?`."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        return value and value.replace("\0", "?").encode("utf-8", "replace").decode()


def _number() -> Column[int]:
    """SQLite counts by itself only what is called INTEGER."""
    return Column("number", BigInteger().with_variant(Integer, "sqlite"), primary_key=True, autoincrement=True)


def _json(name: str, *, nullable: bool = False) -> Column[object]:
    return Column(name, JSON(none_as_null=True), nullable=nullable)


def _product(*, nullable: bool = False) -> Column[str]:
    return Column("product_id", Words, ForeignKey("products.product_id"), nullable=nullable)


PRODUCTS = Table(
    "products",
    METADATA,
    _number(),
    Column("product_id", Words, nullable=False, unique=True),
    Column("created_ns", BigInteger, nullable=False),
    Column("ok_count", BigInteger, nullable=False, server_default=text("0")),
    sqlite_autoincrement=True,
)

SWEEPS = Table(
    "sweeps",
    METADATA,
    _number(),
    Column("sweep_id", Words, nullable=False, unique=True),
    _product(),
    Column("part_id", Words),
    Column("created_ns", BigInteger, nullable=False),
    Column("frames", BigInteger, nullable=False),
    Column("bytes", BigInteger, nullable=False),
    Column("sha256", Words, nullable=False),
    Column("source", Words, nullable=False),
    _json("losses"),
    Index(None, "product_id", "number"),
    sqlite_autoincrement=True,
)

APPEARANCES = Table(
    "appearances",
    METADATA,
    _number(),
    Column("appearance_id", Words, nullable=False),
    _product(),
    Column("created_ns", BigInteger, nullable=False),
    _json("sweep_ids"),
    _json("facts"),
    _json("said"),
    Column("bytes", BigInteger, nullable=False),
    UniqueConstraint("product_id", "appearance_id"),
    Index(None, "product_id", "number"),
    sqlite_autoincrement=True,
)

WORKSPACES = Table(
    "workspaces",
    METADATA,
    _number(),
    Column("workspace_id", Words, nullable=False, unique=True),
    Column("name", Words),
    Column("created_ns", BigInteger, nullable=False),
    Column("source", Words, nullable=False),
    _json("facts"),
    Column("bytes", BigInteger, nullable=False),
    sqlite_autoincrement=True,
)

JOBS = Table(
    "jobs",
    METADATA,
    _number(),
    Column("job_id", Words, nullable=False, unique=True),
    Column("kind", Words, nullable=False),
    _product(nullable=True),
    Column("state", Words, nullable=False),
    Column("progress", Float, nullable=False),
    Column("created_ns", BigInteger, nullable=False),
    Column("ended_ns", BigInteger),
    _json("request"),
    _json("outcome", nullable=True),
    Column("error", Words),
    Column("node", Words),
    Index(None, "product_id", "number"),
    Index(None, "state", "number"),
    sqlite_autoincrement=True,
)

RECIPES = Table(
    "recipes",
    METADATA,
    _number(),
    Column("recipe_id", Words, nullable=False, unique=True),
    _product(),
    Column("version", BigInteger, nullable=False),
    Column("appearance_id", Words, nullable=False),
    _json("policy"),
    Column("active", Boolean, nullable=False, server_default=false()),
    Column("created_ns", BigInteger, nullable=False),
    Column("created_by", Words, nullable=False),
    Column("note", Words, nullable=False),
    UniqueConstraint("product_id", "version"),
    ForeignKeyConstraint(["product_id", "appearance_id"], ["appearances.product_id", "appearances.appearance_id"]),
    Index("ix_recipes_active", "product_id", unique=True, sqlite_where=text("active"), postgresql_where=text("active")),
    sqlite_autoincrement=True,
)

_SCORED = text("result IS NOT NULL AND scores_removed_ns IS NULL")

INSPECTIONS = Table(
    "inspections",
    METADATA,
    _number(),
    Column("inspection_id", Words, nullable=False, unique=True),
    _product(),
    Column("part_id", Words),
    Column("recipe_id", Words, ForeignKey("recipes.recipe_id")),
    Column("appearance_id", Words, nullable=False),
    Column("state", Words, nullable=False),
    Column("verdict", Words),
    Column("is_simulated", Boolean, nullable=False),
    Column("source", Words, nullable=False),
    Column("begun_ns", BigInteger, nullable=False),
    Column("ended_ns", BigInteger),
    Column("acknowledged_ns", BigInteger),
    Column("reason", Words),
    Column("ok_number", BigInteger),
    Column("recording", Words, nullable=False),
    Column("recording_bytes", BigInteger, nullable=False, server_default=text("0")),
    Column("recording_note", Words),
    _json("policy"),
    _json("result", nullable=True),
    _json("disposition", nullable=True),
    Column("node", Words),
    Column("left_ns", BigInteger),
    Column("takes", BigInteger, nullable=False, server_default=text("0")),
    Column("scores_removed_ns", BigInteger),
    ForeignKeyConstraint(["product_id", "appearance_id"], ["appearances.product_id", "appearances.appearance_id"]),
    Index(None, "product_id", "number"),
    Index(None, "verdict", "number"),
    Index(None, "product_id", "verdict", "number"),
    Index(None, "state", "number"),
    Index(None, "source", "number"),
    Index(None, "recording", "number"),
    Index(None, "part_id", "number", postgresql_ops={"part_id": "text_pattern_ops"}),
    # What has scores, by age: how many have none any more does not matter to who removes more of them.
    Index("ix_inspections_scored", "ended_ns", sqlite_where=_SCORED, postgresql_where=_SCORED),
    sqlite_autoincrement=True,
)

DISPOSITIONS = Table(
    "dispositions",
    METADATA,
    _number(),
    Column("inspection_id", Words, ForeignKey("inspections.inspection_id"), nullable=False),
    Column("decision", Words, nullable=False),
    Column("verdict", Words, nullable=False),
    Column("comment", Words, nullable=False),
    Column("actor", Words, nullable=False),
    Column("t_ns", BigInteger, nullable=False),
    Index(None, "inspection_id", "number"),
    sqlite_autoincrement=True,
)

SCORES = Table(
    "scores",
    METADATA,
    Column("inspection_id", Words, ForeignKey("inspections.inspection_id"), primary_key=True),
    Column("scores", LargeBinary, nullable=False),
)

CHECKPOINTS = Table(
    "checkpoints",
    METADATA,
    Column("inspection_id", Words, ForeignKey("inspections.inspection_id"), primary_key=True),
    Column("state", LargeBinary, nullable=False),
)

CHECKPOINT_PARTS = Table(
    "checkpoint_parts",
    METADATA,
    Column("inspection_id", Words, ForeignKey("inspections.inspection_id"), primary_key=True),
    Column("number", BigInteger, primary_key=True, autoincrement=False),
    Column("added", LargeBinary, nullable=False),
)

AUDIT = Table(
    "audit",
    METADATA,
    _number(),
    Column("t_ns", BigInteger, nullable=False),
    Column("actor", Words, nullable=False),
    Column("action", Words, nullable=False),
    Column("thing", Words, nullable=False),
    _json("before", nullable=True),
    _json("after", nullable=True),
    sqlite_autoincrement=True,
)

TOKENS = Table(
    "tokens",
    METADATA,
    _number(),
    Column("token_id", Words, nullable=False, unique=True),
    Column("name", Words, nullable=False),
    Column("role", Words, nullable=False),
    Column("sha256", Words, nullable=False, unique=True),
    Column("created_ns", BigInteger, nullable=False),
    Column("revoked_ns", BigInteger),
    sqlite_autoincrement=True,
)

CLAIMS = Table(
    "claims",
    METADATA,
    Column("scope", Words, primary_key=True),
    Column("key", Words, primary_key=True),
    Column("fingerprint", Words, nullable=False),
    Column("t_ns", BigInteger, nullable=False, index=True),
    Column("status", Integer),
    Column("body", LargeBinary),
    Column("node", Words),
    Index(
        "ix_claims_pending",
        "node",
        sqlite_where=text("status IS NULL"),
        postgresql_where=text("status IS NULL"),
    ),
)

NODES = Table(
    "nodes",
    METADATA,
    _number(),
    Column("node_id", Words, nullable=False, unique=True),
    Column("name", Words, nullable=False),
    Column("started_ns", BigInteger, nullable=False),
    Column("beaten_ns", BigInteger, nullable=False),
    _json("facts"),
    sqlite_autoincrement=True,
)

TOLD = Table(
    "told",
    METADATA,
    _number(),
    Column("told_ns", BigInteger, nullable=False, index=True),
    Column("body", LargeBinary, nullable=False),
    sqlite_autoincrement=True,
)
"""What services tell each other, where it is too much for a notification."""
