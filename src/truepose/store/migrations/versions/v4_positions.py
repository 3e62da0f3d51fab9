"""Version 4: the positions of corrected programs, by which a copy is recognised, and what was accepted for them."""

from __future__ import annotations

from typing import Final

import sqlalchemy as sa
from alembic import op

revision: Final = "4"
down_revision: Final = "3"
branch_labels: Final = None
depends_on: Final = None


def upgrade() -> None:
    """Add the tables; `truepose.store.corrected.list_positions` fills the first from the records."""
    integer = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
    op.create_table(
        "position",
        sa.Column("hash", integer, autoincrement=False, nullable=False),
        sa.Column("correction_id", integer, autoincrement=False, nullable=False),
        sa.ForeignKeyConstraint(
            ["correction_id"], ["correction.id"], name=op.f("fk_position_correction_id_correction")
        ),
        sa.PrimaryKeyConstraint("hash", "correction_id", name=op.f("pk_position")),
    )
    op.create_table(
        "acceptance",
        sa.Column("id", integer, autoincrement=False, nullable=False),
        sa.Column("correction_id", integer, nullable=False),
        sa.Column("kind", sa.String(length=200), nullable=False),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.Column("made_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(
            ["correction_id"], ["correction.id"], name=op.f("fk_acceptance_correction_id_correction")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_acceptance")),
        sa.UniqueConstraint("correction_id", "kind", name=op.f("uq_acceptance_correction_id_kind")),
    )
