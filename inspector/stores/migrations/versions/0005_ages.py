"""Scores of frames that are not kept for ever; and parts found by how their numbers begin."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Add a column that says since when, an index of what has scores by its age, and one of the parts' numbers."""
    op.add_column("inspections", sa.Column("scores_removed_ns", sa.BigInteger()))
    scored = sa.text("result IS NOT NULL AND scores_removed_ns IS NULL")
    op.create_index("ix_inspections_scored", "inspections", ["ended_ns"], sqlite_where=scored, postgresql_where=scored)
    op.create_index(
        "ix_inspections_part_id_number",
        "inspections",
        ["part_id", "number"],
        # By bytes, as SQLite has it anyway: an index in the order of a language does not know how texts begin.
        postgresql_ops={"part_id": "text_pattern_ops"},
    )
