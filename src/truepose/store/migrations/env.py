"""Run migrations in the transaction that `truepose.store.migrate` has opened; Alembic loads this file."""

from __future__ import annotations

from alembic import context

from truepose.store.schema import metadata

if hasattr(context, "config"):  # Alembic runs it; what lists all modules only imports it
    context.configure(
        connection=context.config.attributes["connection"],
        target_metadata=metadata,
        transactional_ddl=True,
        render_as_batch=True,
    )
    context.run_migrations()
