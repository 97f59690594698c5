"""What Alembic runs: the migrations on the connection that it is handed, inside the transaction that is open there."""

from alembic import context

from inspector.stores.sql.tables import METADATA

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=METADATA,
    render_as_batch=True,
    transactional_ddl=True,
)
context.run_migrations()
