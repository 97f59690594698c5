"""What people say of inspections, beside their verdicts."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Make the table, and a column for the last word, which lists show."""
    op.add_column("inspections", sa.Column("disposition", sa.JSON()))
    op.create_table(
        "dispositions",
        sa.Column(
            "number",
            sa.BigInteger().with_variant(sa.Integer(), "sqlite"),
            autoincrement=True,
            nullable=False,
        ),
        sa.Column("inspection_id", sa.Text(), nullable=False),
        sa.Column("decision", sa.Text(), nullable=False),
        sa.Column("verdict", sa.Text(), nullable=False),
        sa.Column("comment", sa.Text(), nullable=False),
        sa.Column("actor", sa.Text(), nullable=False),
        sa.Column("t_ns", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["inspection_id"], ["inspections.inspection_id"], name="fk_dispositions_inspection_id"),
        sa.PrimaryKeyConstraint("number", name="pk_dispositions"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_dispositions_inspection_id_number", "dispositions", ["inspection_id", "number"])
