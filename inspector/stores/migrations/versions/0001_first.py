"""The first tables; the audit trail refuses to be changed."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

SQLITE = [
    f"CREATE TRIGGER audit_no_{name} BEFORE {event} BEGIN SELECT RAISE(ABORT, 'the audit trail is append-only'); END"
    for name, event in [
        ("update", "UPDATE ON audit"),
        ("delete", "DELETE ON audit"),
        # INSERT OR REPLACE deletes without saying so.
        ("replace", "INSERT ON audit WHEN EXISTS (SELECT 1 FROM audit WHERE number = NEW.number)"),
    ]
]
POSTGRESQL = [
    """CREATE FUNCTION audit_append_only() RETURNS trigger LANGUAGE plpgsql AS
    $$ BEGIN RAISE EXCEPTION 'the audit trail is append-only'; END $$""",
    """CREATE TRIGGER audit_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON audit
    FOR EACH STATEMENT EXECUTE FUNCTION audit_append_only()""",
]


def upgrade() -> None:
    """Make them."""
    op.create_table(
        "audit",
        _number(),
        sa.Column("t_ns", sa.BigInteger(), nullable=False),
        sa.Column("actor", sa.Text(), nullable=False),
        sa.Column("action", sa.Text(), nullable=False),
        sa.Column("thing", sa.Text(), nullable=False),
        sa.Column("before", sa.JSON()),
        sa.Column("after", sa.JSON()),
        sa.PrimaryKeyConstraint("number", name="pk_audit"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "claims",
        sa.Column("scope", sa.Text(), nullable=False),
        sa.Column("key", sa.Text(), nullable=False),
        sa.Column("fingerprint", sa.Text(), nullable=False),
        sa.Column("t_ns", sa.BigInteger(), nullable=False),
        sa.Column("status", sa.Integer()),
        sa.Column("body", sa.LargeBinary()),
        sa.PrimaryKeyConstraint("scope", "key", name="pk_claims"),
    )
    op.create_index("ix_claims_t_ns", "claims", ["t_ns"])
    op.create_table(
        "products",
        _number(),
        sa.Column("product_id", sa.Text(), nullable=False),
        sa.Column("created_ns", sa.BigInteger(), nullable=False),
        sa.Column("ok_count", sa.BigInteger(), server_default=sa.text("0"), nullable=False),
        sa.PrimaryKeyConstraint("number", name="pk_products"),
        sa.UniqueConstraint("product_id", name="uq_products_product_id"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "tokens",
        _number(),
        sa.Column("token_id", sa.Text(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("role", sa.Text(), nullable=False),
        sa.Column("sha256", sa.Text(), nullable=False),
        sa.Column("created_ns", sa.BigInteger(), nullable=False),
        sa.Column("revoked_ns", sa.BigInteger()),
        sa.PrimaryKeyConstraint("number", name="pk_tokens"),
        sa.UniqueConstraint("sha256", name="uq_tokens_sha256"),
        sa.UniqueConstraint("token_id", name="uq_tokens_token_id"),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "appearances",
        _number(),
        sa.Column("appearance_id", sa.Text(), nullable=False),
        sa.Column("product_id", sa.Text(), nullable=False),
        sa.Column("created_ns", sa.BigInteger(), nullable=False),
        sa.Column("sweep_ids", sa.JSON(), nullable=False),
        sa.Column("facts", sa.JSON(), nullable=False),
        sa.Column("said", sa.JSON(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["product_id"], ["products.product_id"], name="fk_appearances_product_id"),
        sa.PrimaryKeyConstraint("number", name="pk_appearances"),
        sa.UniqueConstraint("product_id", "appearance_id", name="uq_appearances_product_id_appearance_id"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_appearances_product_id_number", "appearances", ["product_id", "number"])
    op.create_table(
        "jobs",
        _number(),
        sa.Column("job_id", sa.Text(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("product_id", sa.Text(), nullable=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("progress", sa.Float(), nullable=False),
        sa.Column("created_ns", sa.BigInteger(), nullable=False),
        sa.Column("ended_ns", sa.BigInteger()),
        sa.Column("request", sa.JSON(), nullable=False),
        sa.Column("outcome", sa.JSON()),
        sa.Column("error", sa.Text()),
        sa.ForeignKeyConstraint(["product_id"], ["products.product_id"], name="fk_jobs_product_id"),
        sa.PrimaryKeyConstraint("number", name="pk_jobs"),
        sa.UniqueConstraint("job_id", name="uq_jobs_job_id"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_jobs_product_id_number", "jobs", ["product_id", "number"])
    op.create_index("ix_jobs_state_number", "jobs", ["state", "number"])
    op.create_table(
        "sweeps",
        _number(),
        sa.Column("sweep_id", sa.Text(), nullable=False),
        sa.Column("product_id", sa.Text(), nullable=False),
        sa.Column("part_id", sa.Text()),
        sa.Column("created_ns", sa.BigInteger(), nullable=False),
        sa.Column("frames", sa.BigInteger(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        sa.Column("sha256", sa.Text(), nullable=False),
        sa.Column("source", sa.Text(), nullable=False),
        sa.Column("losses", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(["product_id"], ["products.product_id"], name="fk_sweeps_product_id"),
        sa.PrimaryKeyConstraint("number", name="pk_sweeps"),
        sa.UniqueConstraint("sweep_id", name="uq_sweeps_sweep_id"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_sweeps_product_id_number", "sweeps", ["product_id", "number"])
    op.create_table(
        "recipes",
        _number(),
        sa.Column("recipe_id", sa.Text(), nullable=False),
        sa.Column("product_id", sa.Text(), nullable=False),
        sa.Column("version", sa.BigInteger(), nullable=False),
        sa.Column("appearance_id", sa.Text(), nullable=False),
        sa.Column("policy", sa.JSON(), nullable=False),
        sa.Column("active", sa.Boolean(), server_default=sa.false(), nullable=False),
        sa.Column("created_ns", sa.BigInteger(), nullable=False),
        sa.Column("created_by", sa.Text(), nullable=False),
        sa.Column("note", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(
            ["product_id", "appearance_id"],
            ["appearances.product_id", "appearances.appearance_id"],
            name="fk_recipes_product_id_appearance_id",
        ),
        sa.ForeignKeyConstraint(["product_id"], ["products.product_id"], name="fk_recipes_product_id"),
        sa.PrimaryKeyConstraint("number", name="pk_recipes"),
        sa.UniqueConstraint("product_id", "version", name="uq_recipes_product_id_version"),
        sa.UniqueConstraint("recipe_id", name="uq_recipes_recipe_id"),
        sqlite_autoincrement=True,
    )
    op.create_index(
        "ix_recipes_active",
        "recipes",
        ["product_id"],
        unique=True,
        sqlite_where=sa.text("active"),
        postgresql_where=sa.text("active"),
    )
    op.create_table(
        "inspections",
        _number(),
        sa.Column("inspection_id", sa.Text(), nullable=False),
        sa.Column("product_id", sa.Text(), nullable=False),
        sa.Column("part_id", sa.Text()),
        sa.Column("recipe_id", sa.Text()),
        sa.Column("appearance_id", sa.Text(), nullable=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("verdict", sa.Text()),
        sa.Column("is_simulated", sa.Boolean(), nullable=False),
        sa.Column("source", sa.Text(), nullable=False),
        sa.Column("begun_ns", sa.BigInteger(), nullable=False),
        sa.Column("ended_ns", sa.BigInteger()),
        sa.Column("acknowledged_ns", sa.BigInteger()),
        sa.Column("reason", sa.Text()),
        sa.Column("ok_number", sa.BigInteger()),
        sa.Column("recording", sa.Text(), nullable=False),
        sa.Column("recording_bytes", sa.BigInteger(), server_default=sa.text("0"), nullable=False),
        sa.Column("recording_note", sa.Text()),
        sa.Column("policy", sa.JSON(), nullable=False),
        sa.Column("result", sa.JSON()),
        sa.ForeignKeyConstraint(
            ["product_id", "appearance_id"],
            ["appearances.product_id", "appearances.appearance_id"],
            name="fk_inspections_product_id_appearance_id",
        ),
        sa.ForeignKeyConstraint(["product_id"], ["products.product_id"], name="fk_inspections_product_id"),
        sa.ForeignKeyConstraint(["recipe_id"], ["recipes.recipe_id"], name="fk_inspections_recipe_id"),
        sa.PrimaryKeyConstraint("number", name="pk_inspections"),
        sa.UniqueConstraint("inspection_id", name="uq_inspections_inspection_id"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_inspections_product_id_number", "inspections", ["product_id", "number"])
    op.create_index("ix_inspections_product_id_verdict_number", "inspections", ["product_id", "verdict", "number"])
    op.create_index("ix_inspections_recording_number", "inspections", ["recording", "number"])
    op.create_index("ix_inspections_source_number", "inspections", ["source", "number"])
    op.create_index("ix_inspections_state_number", "inspections", ["state", "number"])
    op.create_index("ix_inspections_verdict_number", "inspections", ["verdict", "number"])
    op.create_table(
        "scores",
        sa.Column("inspection_id", sa.Text(), nullable=False),
        sa.Column("scores", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["inspection_id"], ["inspections.inspection_id"], name="fk_scores_inspection_id"),
        sa.PrimaryKeyConstraint("inspection_id", name="pk_scores"),
    )
    for statement in SQLITE if op.get_bind().dialect.name == "sqlite" else POSTGRESQL:
        op.execute(statement)


def _number() -> sa.Column[int]:
    return sa.Column("number", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), autoincrement=True, nullable=False)
