"""Version 2: indexes for what is listed by map, cell and object; a recall searched all corrections before."""

from __future__ import annotations

from typing import Final

from alembic import op

revision: Final = "2"
down_revision: Final = "1"
branch_labels: Final = None
depends_on: Final = None
_INDEXES: Final = (
    ("correction", ["map_id", "id"]),
    ("verification", ["map_id", "id"]),
    ("verification", ["correction_id", "id"]),
    ("map", ["cell_id", "id"]),
    ("release", ["object", "object_id", "id"]),
)


def upgrade() -> None:
    """Add the indexes."""
    for table, columns in _INDEXES:
        op.create_index(op.f(f"ix_{table}_{'_'.join(columns)}"), table, columns)
