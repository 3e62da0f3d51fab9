"""Version 4: the positions of corrected programs, by which a copy is recognised under any name."""

from __future__ import annotations

from typing import Final

import sqlalchemy as sa
from alembic import op

revision: Final = "4"
down_revision: Final = "3"
branch_labels: Final = None
depends_on: Final = None


def upgrade() -> None:
    """Add the table; `truepose.store.corrected.list_positions` fills it from the records."""
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
