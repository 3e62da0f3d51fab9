"""Version 1: the tables of a store."""

from __future__ import annotations

from typing import Final

import sqlalchemy as sa
from alembic import op

from truepose.store.engines import postgresql, sqlite

revision: Final = "1"
down_revision: Final = None
branch_labels: Final = None
depends_on: Final = None
_INTEGER: Final = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    """Make the tables, and the triggers that keep the audit trail append-only."""
    op.create_table(
        "audit",
        sa.Column("sequence", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("time", sa.String(length=27), nullable=False),
        sa.Column("user", sa.String(length=200), nullable=False),
        sa.Column("action", sa.String(length=64), nullable=False),
        sa.Column("object", sa.String(length=64), nullable=False),
        sa.Column("object_id", _INTEGER, nullable=True),
        sa.Column("payload", sa.Text(), nullable=False),
        sa.Column("previous", sa.String(length=64), nullable=False),
        sa.Column("hash", sa.String(length=64), nullable=False),
        sa.PrimaryKeyConstraint("sequence", name=op.f("pk_audit")),
        sa.UniqueConstraint("hash", name=op.f("uq_audit_hash")),
    )
    op.create_index(
        op.f("ix_audit_object_object_id_sequence"), "audit", ["object", "object_id", "sequence"], unique=False
    )
    op.create_table(
        "blob",
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("size", _INTEGER, nullable=False),
        sa.Column("content", sa.LargeBinary(), nullable=True),
        sa.PrimaryKeyConstraint("sha256", name=op.f("pk_blob")),
    )
    op.create_table(
        "job",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("kind", sa.String(length=200), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("options", sa.Text(), nullable=False),
        sa.Column("result", sa.Text(), nullable=True),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.Column("ended", sa.String(length=27), nullable=True),
        sa.Column("made_by", sa.String(length=200), nullable=False),
        sa.CheckConstraint("state IN ('waiting', 'running', 'done', 'failed', 'cancelled')", name=op.f("ck_job_state")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_job")),
    )
    op.create_table(
        "site",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("key", sa.String(length=200), nullable=False),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_site")),
        sa.UniqueConstraint("key", name=op.f("uq_site_key")),
    )
    op.create_table(
        "user",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("key", sa.String(length=200), nullable=False),
        sa.Column("password", sa.Text(), nullable=True),
        sa.Column("subject", sa.String(length=500), nullable=True),
        sa.Column("disabled", sa.Boolean(), nullable=False),
        sa.Column("failures", _INTEGER, server_default="0", nullable=False),
        sa.Column("last_failure", sa.String(length=27), nullable=True),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_user")),
        sa.UniqueConstraint("key", name=op.f("uq_user_key")),
        sa.UniqueConstraint("subject", name=op.f("uq_user_subject")),
    )
    op.create_table(
        "release",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("object", sa.String(length=200), nullable=False),
        sa.Column("object_id", _INTEGER, nullable=False),
        sa.Column("user_id", _INTEGER, nullable=False),
        sa.Column("second_user_id", _INTEGER, nullable=True),
        sa.Column("meaning", sa.Text(), nullable=False),
        sa.Column("reason", sa.Text(), nullable=True),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.ForeignKeyConstraint(["second_user_id"], ["user.id"], name=op.f("fk_release_second_user_id")),
        sa.ForeignKeyConstraint(["user_id"], ["user.id"], name=op.f("fk_release_user_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_release")),
    )
    op.create_table(
        "robot",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("site_id", _INTEGER, nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("key", sa.String(length=200), nullable=False),
        sa.Column("model", sa.Text(), nullable=True),
        sa.Column("serial", sa.Text(), nullable=True),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.ForeignKeyConstraint(["site_id"], ["site.id"], name=op.f("fk_robot_site_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_robot")),
        sa.UniqueConstraint("site_id", "key", name=op.f("uq_robot_site_id_key")),
    )
    op.create_table(
        "role",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("user_id", _INTEGER, nullable=False),
        sa.Column("role", sa.String(length=16), nullable=False),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.CheckConstraint("role IN ('read', 'measure', 'program', 'release', 'admin')", name=op.f("ck_role_role")),
        sa.ForeignKeyConstraint(["user_id"], ["user.id"], name=op.f("fk_role_user_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_role")),
        sa.UniqueConstraint("user_id", "role", name=op.f("uq_role_user_id_role")),
    )
    op.create_table(
        "token",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("user_id", _INTEGER, nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("identity", sa.String(length=64), nullable=False),
        sa.Column("hash", sa.String(length=64), nullable=False),
        sa.Column("scope", sa.Text(), nullable=False),
        sa.Column("expires", sa.String(length=27), nullable=True),
        sa.Column("revoked", sa.Boolean(), nullable=False),
        sa.Column("last_used", sa.String(length=27), nullable=True),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.ForeignKeyConstraint(["user_id"], ["user.id"], name=op.f("fk_token_user_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_token")),
        sa.UniqueConstraint("hash", name=op.f("uq_token_hash")),
        sa.UniqueConstraint("identity", name=op.f("uq_token_identity")),
    )
    op.create_table(
        "cell",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("robot_id", _INTEGER, nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("key", sa.String(length=200), nullable=False),
        sa.Column("version", _INTEGER, nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.Column("made_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(["robot_id"], ["robot.id"], name=op.f("fk_cell_robot_id")),
        sa.ForeignKeyConstraint(["sha256"], ["blob.sha256"], name=op.f("fk_cell_sha256")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_cell")),
        sa.UniqueConstraint("robot_id", "key", "version", name=op.f("uq_cell_robot_id_key_version")),
    )
    op.create_table(
        "program",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("robot_id", _INTEGER, nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("key", sa.String(length=200), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("language", sa.Text(), nullable=True),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.Column("made_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(["robot_id"], ["robot.id"], name=op.f("fk_program_robot_id")),
        sa.ForeignKeyConstraint(["sha256"], ["blob.sha256"], name=op.f("fk_program_sha256")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_program")),
        sa.UniqueConstraint("robot_id", "key", "sha256", name=op.f("uq_program_robot_id_key_sha256")),
    )
    op.create_table(
        "campaign",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("cell_id", _INTEGER, nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("key", sa.String(length=200), nullable=False),
        sa.Column("figures", sa.Text(), nullable=False),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.Column("made_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(["cell_id"], ["cell.id"], name=op.f("fk_campaign_cell_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_campaign")),
        sa.UniqueConstraint("cell_id", "key", name=op.f("uq_campaign_cell_id_key")),
    )
    op.create_table(
        "map",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("cell_id", _INTEGER, nullable=False),
        sa.Column("parent_id", _INTEGER, nullable=True),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("predictor", sa.Text(), nullable=False),
        sa.Column("figures", sa.Text(), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.Column("made_by", sa.String(length=200), nullable=False),
        sa.CheckConstraint("state IN ('draft', 'released', 'superseded', 'withdrawn')", name=op.f("ck_map_state")),
        sa.ForeignKeyConstraint(["cell_id"], ["cell.id"], name=op.f("fk_map_cell_id")),
        sa.ForeignKeyConstraint(["parent_id"], ["map.id"], name=op.f("fk_map_parent_id")),
        sa.ForeignKeyConstraint(["sha256"], ["blob.sha256"], name=op.f("fk_map_sha256")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_map")),
        sa.UniqueConstraint("sha256", name=op.f("uq_map_sha256")),
    )
    op.create_table(
        "correction",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("program_id", _INTEGER, nullable=False),
        sa.Column("map_id", _INTEGER, nullable=False),
        sa.Column("options", sa.Text(), nullable=False),
        sa.Column("output_sha256", sa.String(length=64), nullable=False),
        sa.Column("record_sha256", sa.String(length=64), nullable=False),
        sa.Column("targets", _INTEGER, nullable=False),
        sa.Column("corrected", _INTEGER, nullable=False),
        sa.Column("refused", _INTEGER, nullable=False),
        sa.Column("draft", sa.Boolean(), nullable=False),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.Column("made_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(["map_id"], ["map.id"], name=op.f("fk_correction_map_id")),
        sa.ForeignKeyConstraint(["output_sha256"], ["blob.sha256"], name=op.f("fk_correction_output_sha256")),
        sa.ForeignKeyConstraint(["program_id"], ["program.id"], name=op.f("fk_correction_program_id")),
        sa.ForeignKeyConstraint(["record_sha256"], ["blob.sha256"], name=op.f("fk_correction_record_sha256")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_correction")),
        sa.UniqueConstraint(
            "program_id", "map_id", "record_sha256", name=op.f("uq_correction_program_id_map_id_record_sha256")
        ),
    )
    op.create_table(
        "reading_set",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("campaign_id", _INTEGER, nullable=False),
        sa.Column("name", sa.String(length=200), nullable=False),
        sa.Column("samples_sha256", sa.String(length=64), nullable=False),
        sa.Column("source_sha256", sa.String(length=64), nullable=True),
        sa.Column("poses", _INTEGER, nullable=False),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.Column("made_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(["campaign_id"], ["campaign.id"], name=op.f("fk_reading_set_campaign_id")),
        sa.ForeignKeyConstraint(["samples_sha256"], ["blob.sha256"], name=op.f("fk_reading_set_samples_sha256")),
        sa.ForeignKeyConstraint(["source_sha256"], ["blob.sha256"], name=op.f("fk_reading_set_source_sha256")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_reading_set")),
        sa.UniqueConstraint("campaign_id", "samples_sha256", name=op.f("uq_reading_set_campaign_id_samples_sha256")),
    )
    op.create_table(
        "map_reading_set",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("map_id", _INTEGER, nullable=False),
        sa.Column("reading_set_id", _INTEGER, nullable=False),
        sa.ForeignKeyConstraint(["map_id"], ["map.id"], name=op.f("fk_map_reading_set_map_id")),
        sa.ForeignKeyConstraint(["reading_set_id"], ["reading_set.id"], name=op.f("fk_map_reading_set_reading_set_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_map_reading_set")),
        sa.UniqueConstraint("map_id", "reading_set_id", name=op.f("uq_map_reading_set_map_id_reading_set_id")),
    )
    op.create_table(
        "verification",
        sa.Column("id", _INTEGER, autoincrement=False, nullable=False),
        sa.Column("map_id", _INTEGER, nullable=True),
        sa.Column("correction_id", _INTEGER, nullable=True),
        sa.Column("reading_set_id", _INTEGER, nullable=True),
        sa.Column("kind", sa.String(length=200), nullable=False),
        sa.Column("record_sha256", sa.String(length=64), nullable=True),
        sa.Column("figures", sa.Text(), nullable=False),
        sa.Column("created", sa.String(length=27), nullable=False),
        sa.Column("made_by", sa.String(length=200), nullable=False),
        sa.ForeignKeyConstraint(["correction_id"], ["correction.id"], name=op.f("fk_verification_correction_id")),
        sa.ForeignKeyConstraint(["map_id"], ["map.id"], name=op.f("fk_verification_map_id")),
        sa.ForeignKeyConstraint(["reading_set_id"], ["reading_set.id"], name=op.f("fk_verification_reading_set_id")),
        sa.ForeignKeyConstraint(["record_sha256"], ["blob.sha256"], name=op.f("fk_verification_record_sha256")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_verification")),
    )
    connection = op.get_bind()
    for statement in {"sqlite": sqlite, "postgresql": postgresql}[connection.dialect.name].AUDIT_GUARDS:
        connection.exec_driver_sql(statement)
