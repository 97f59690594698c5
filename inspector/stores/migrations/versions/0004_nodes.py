"""Several services on one database: who they are, what each of them does, and how far it is."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Make the tables, and columns that say who does it."""
    op.create_table(
        "nodes",
        _number(),
        sa.Column("node_id", sa.Text(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("started_ns", sa.BigInteger(), nullable=False),
        sa.Column("beaten_ns", sa.BigInteger(), nullable=False),
        sa.Column("facts", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("number", name="pk_nodes"),
        sa.UniqueConstraint("node_id", name="uq_nodes_node_id"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "told",
        _number(),
        sa.Column("told_ns", sa.BigInteger(), nullable=False),
        sa.Column("body", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("number", name="pk_told"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_told_told_ns", "told", ["told_ns"])
    if op.get_bind().dialect.name == "postgresql":
        # Of use for a minute only: no log is written of it.
        op.execute("ALTER TABLE told SET UNLOGGED")
    op.create_table(
        "checkpoints",
        sa.Column("inspection_id", sa.Text(), nullable=False),
        sa.Column("state", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["inspection_id"], ["inspections.inspection_id"], name="fk_checkpoints_inspection_id"),
        sa.PrimaryKeyConstraint("inspection_id", name="pk_checkpoints"),
    )
    if op.get_bind().dialect.name == "postgresql":
        # A state is as good as new after a second: were it logged, a camera would make 14 GB of log a day.
        op.execute("ALTER TABLE checkpoints SET UNLOGGED")
    op.create_table(
        "checkpoint_parts",
        sa.Column("inspection_id", sa.Text(), nullable=False),
        sa.Column("number", sa.BigInteger(), nullable=False),
        sa.Column("added", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["inspection_id"], ["inspections.inspection_id"], name="fk_checkpoint_parts_inspection_id"
        ),
        sa.PrimaryKeyConstraint("inspection_id", "number", name="pk_checkpoint_parts"),
    )
    op.add_column("inspections", sa.Column("node", sa.Text()))
    op.add_column("inspections", sa.Column("left_ns", sa.BigInteger()))
    op.add_column("inspections", sa.Column("takes", sa.BigInteger(), server_default=sa.text("0"), nullable=False))
    op.add_column("jobs", sa.Column("node", sa.Text()))
    op.add_column("claims", sa.Column("node", sa.Text()))
    op.create_index(
        "ix_claims_pending",
        "claims",
        ["node"],
        sqlite_where=sa.text("status IS NULL"),
        postgresql_where=sa.text("status IS NULL"),
    )


def _number() -> sa.Column[int]:
    return sa.Column("number", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), autoincrement=True, nullable=False)
