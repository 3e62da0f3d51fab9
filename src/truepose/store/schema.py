"""The tables of a store, in the newest version of the schema; `truepose.store.migrations` makes them.

Values are integers, booleans and text, which every engine returns as they were written: times are UTC in ISO 8601,
which sorts as text, and ``figures``, ``options`` and ``payload`` are JSON. Rows have an integer ``id``, and each change
of one has an entry in ``audit`` with the SHA-256 of the row; see `truepose.store.audit`.

A column may say in its ``info`` how it is audited: a ``secret`` column counts in the SHA-256, but its value is not
written to the entry; a column that is not ``audited`` may change without an entry. A ``json`` column holds JSON.
"""

from __future__ import annotations

from typing import Any, Final

import sqlalchemy as sa

VERSION: Final = 4
"""The version of this schema: the number of the newest migration."""
LARGEST_BLOB: Final = 64 * 2**20
"""The largest blob in bytes that a database keeps itself, without a folder of blobs."""
MAP_STATES: Final = ("draft", "released", "superseded", "withdrawn")
ROLES: Final = ("read", "measure", "program", "release", "admin")
JOB_STATES: Final = ("waiting", "running", "done", "failed", "cancelled")
SECRET: Final = {"secret": True}
UNAUDITED: Final = {"audited": False}
JSON: Final = {"json": True}

_INTEGER: Final = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
_SHA: Final = sa.String(64)
_TIME: Final = sa.String(27)
_NAME: Final = sa.String(200)

metadata = sa.MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "ck": "ck_%(table_name)s_%(constraint_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
    }
)


def _id() -> sa.Column[int]:
    return sa.Column("id", _INTEGER, primary_key=True, autoincrement=False)


def _of(table: str, name: str | None = None, *, null: bool = False) -> sa.Column[int]:
    """Return a column that names a row of another table."""
    return sa.Column(name or f"{table}_id", _INTEGER, sa.ForeignKey(f"{table}.id"), nullable=null)


def _blob(name: str = "sha256", *, null: bool = False) -> sa.Column[str]:
    """Return a column that names a blob."""
    return sa.Column(name, _SHA, sa.ForeignKey("blob.sha256"), nullable=null)


def _text(name: str, *, null: bool = False, **more: Any) -> sa.Column[str]:
    return sa.Column(name, sa.Text(), nullable=null, **more)


def _name(name: str = "name") -> sa.Column[str]:
    return sa.Column(name, _NAME, nullable=False)


def _time(name: str = "created", *, null: bool = False, **more: Any) -> sa.Column[str]:
    return sa.Column(name, _TIME, nullable=null, **more)


def _whole(name: str, **more: Any) -> sa.Column[int]:
    return sa.Column(name, _INTEGER, nullable=False, **more)


def _among(column: str, values: tuple[str, ...]) -> sa.CheckConstraint:
    listed = ", ".join(f"'{value}'" for value in values)
    return sa.CheckConstraint(f"{column} IN ({listed})", name=column)


def _table(name: str, *parts: Any) -> sa.Table:
    return sa.Table(name, metadata, *parts)


blob = _table(
    "blob",
    sa.Column("sha256", _SHA, primary_key=True),
    _whole("size"),
    sa.Column("content", sa.LargeBinary(), nullable=True),  # NULL: in the folder of blobs
)
user = _table(
    "user",
    _id(),
    _name(),
    sa.Column("key", _NAME, nullable=False, unique=True),
    _text("password", null=True, info=SECRET),
    sa.Column("subject", sa.String(500), nullable=True, unique=True),
    sa.Column("disabled", sa.Boolean(), nullable=False),
    _whole("failures", info=UNAUDITED, server_default="0"),
    _time("last_failure", null=True, info=UNAUDITED),
    _time(),
)
role = _table("role", _id(), _of("user"), sa.Column("role", sa.String(16), nullable=False), _time())
role.append_constraint(sa.UniqueConstraint(role.c.user_id, role.c.role))
role.append_constraint(_among("role", ROLES))
token = _table(
    "token",
    _id(),
    _of("user"),
    _name(),
    sa.Column("identity", sa.String(64), nullable=False, unique=True),
    sa.Column("hash", _SHA, nullable=False, unique=True, info=SECRET),
    _text("scope"),
    _time("expires", null=True),
    sa.Column("revoked", sa.Boolean(), nullable=False),
    _time("last_used", null=True, info=UNAUDITED),
    _time(),
)
site = _table("site", _id(), _name(), sa.Column("key", _NAME, nullable=False, unique=True), _time())
robot = _table(
    "robot",
    _id(),
    _of("site"),
    _name(),
    sa.Column("key", _NAME, nullable=False),
    _text("model", null=True),
    _text("serial", null=True),
    _time(),
)
robot.append_constraint(sa.UniqueConstraint(robot.c.site_id, robot.c.key))
cell = _table(
    "cell",
    _id(),
    _of("robot"),
    _name(),
    sa.Column("key", _NAME, nullable=False),
    _whole("version"),
    _blob(),
    _time(),
    _name("made_by"),
)
cell.append_constraint(sa.UniqueConstraint(cell.c.robot_id, cell.c.key, cell.c.version))
campaign = _table(
    "campaign",
    _id(),
    _of("cell"),
    _name(),
    sa.Column("key", _NAME, nullable=False),
    _text("figures", info=JSON),
    _time(),
    _name("made_by"),
)
campaign.append_constraint(sa.UniqueConstraint(campaign.c.cell_id, campaign.c.key))
reading_set = _table(
    "reading_set",
    _id(),
    _of("campaign"),
    _name(),
    _blob("samples_sha256"),
    _blob("source_sha256", null=True),
    _whole("poses"),
    _time(),
    _name("made_by"),
)
reading_set.append_constraint(sa.UniqueConstraint(reading_set.c.campaign_id, reading_set.c.samples_sha256))
map = _table(  # noqa: A001 - the name of the table
    "map",
    _id(),
    _of("cell"),
    _of("map", "parent_id", null=True),
    _name(),
    _blob(),
    _text("predictor"),
    _text("figures", info=JSON),
    sa.Column("state", sa.String(16), nullable=False),
    _time(),
    _name("made_by"),
    sa.UniqueConstraint("sha256"),
    _among("state", MAP_STATES),
)
map_reading_set = _table("map_reading_set", _id(), _of("map"), _of("reading_set"))
map_reading_set.append_constraint(sa.UniqueConstraint(map_reading_set.c.map_id, map_reading_set.c.reading_set_id))
program = _table(
    "program",
    _id(),
    _of("robot"),
    _name(),
    sa.Column("key", _NAME, nullable=False),
    _blob(),
    _text("language", null=True),
    _time(),
    _name("made_by"),
)
program.append_constraint(sa.UniqueConstraint(program.c.robot_id, program.c.key, program.c.sha256))
correction = _table(
    "correction",
    _id(),
    _of("program"),
    _of("map"),
    _text("options", info=JSON),
    _blob("output_sha256"),
    _blob("record_sha256"),
    _whole("targets"),
    _whole("corrected"),
    _whole("refused"),
    sa.Column("draft", sa.Boolean(), nullable=False),
    _time(),
    _name("made_by"),
)
correction.append_constraint(
    sa.UniqueConstraint(correction.c.program_id, correction.c.map_id, correction.c.record_sha256)
)
position = _table(  # by which a copy of a corrected program is recognised; made from the records
    "position",
    sa.Column("hash", _INTEGER, primary_key=True, autoincrement=False),
    sa.Column("correction_id", _INTEGER, sa.ForeignKey("correction.id"), primary_key=True, autoincrement=False),
)
acceptance = _table(  # what was accepted by name for a correction, such as the map of another robot
    "acceptance",
    _id(),
    _of("correction"),
    _name("kind"),
    _text("reason"),
    _time(),
    _name("made_by"),
)
acceptance.append_constraint(sa.UniqueConstraint(acceptance.c.correction_id, acceptance.c.kind))
verification = _table(
    "verification",
    _id(),
    _of("map", null=True),
    _of("correction", null=True),
    _of("reading_set", null=True),
    _name("kind"),
    _blob("record_sha256", null=True),
    _text("figures", info=JSON),
    _time(),
    _name("made_by"),
)
release = _table(
    "release",
    _id(),
    _name("object"),
    _whole("object_id"),
    _of("user"),
    _of("user", "second_user_id", null=True),
    _text("meaning"),
    _text("reason", null=True),
    _time(),
)
job = _table(
    "job",
    _id(),
    _name("kind"),
    sa.Column("state", sa.String(16), nullable=False),
    _text("options", info=JSON),
    _text("result", null=True, info=JSON),
    _time(),
    _time("ended", null=True),
    _name("made_by"),
    _among("state", JOB_STATES),
)
audit = _table(
    "audit",
    sa.Column("sequence", _INTEGER, primary_key=True, autoincrement=False),
    _time("time"),
    _name("user"),
    sa.Column("action", sa.String(64), nullable=False),
    sa.Column("object", sa.String(64), nullable=False),
    sa.Column("object_id", _INTEGER, nullable=True),
    _text("payload", info=JSON),
    sa.Column("previous", _SHA, nullable=False),
    sa.Column("hash", _SHA, nullable=False, unique=True),
)
for _columns in (
    (audit.c.object, audit.c.object_id, audit.c.sequence),
    (correction.c.map_id, correction.c.id),
    (correction.c.output_sha256, correction.c.id),
    (verification.c.map_id, verification.c.id),
    (verification.c.correction_id, verification.c.id),
    (map.c.cell_id, map.c.id),
    (release.c.object, release.c.object_id, release.c.id),
):
    sa.Index(None, *_columns)

AUDITED: Final = tuple(table for table in metadata.sorted_tables if table not in (blob, position, audit))
"""The tables whose rows have entries in the audit trail, each after those that it refers to."""
