"""Version 3: an index for corrected programs by their content, so that none is corrected a second time."""

from __future__ import annotations

from typing import Final

from alembic import op

revision: Final = "3"
down_revision: Final = "2"
branch_labels: Final = None
depends_on: Final = None


def upgrade() -> None:
    """Add the index."""
    op.create_index(op.f("ix_correction_output_sha256_id"), "correction", ["output_sha256", "id"])
