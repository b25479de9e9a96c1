"""Sessions that any process can go on with, jobs that any worker can adopt, numbers that never come back."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

NEVER_BACK = "'version numbers never go back'"
IMMUTABLE = "'versions are immutable'"
NEXT_ONLY = "'a version has the number given out last'"
REFUSED = "USING ERRCODE = 'integrity_constraint_violation'"

SQLITE = (
    "CREATE TRIGGER version_numbers_grow BEFORE UPDATE ON version_numbers WHEN NEW.last < OLD.last "
    "BEGIN SELECT RAISE(ABORT, " + NEVER_BACK + "); END",
    "CREATE TRIGGER version_numbers_stay BEFORE DELETE ON version_numbers "
    "BEGIN SELECT RAISE(ABORT, " + NEVER_BACK + "); END",
    "CREATE TRIGGER versions_stay BEFORE UPDATE ON versions BEGIN SELECT RAISE(ABORT, "
    + IMMUTABLE
    + "); END",
    "CREATE TRIGGER versions_follow BEFORE INSERT ON versions "  # noqa: S608 (made of constants alone)
    "WHEN NEW.number IS NOT (SELECT last FROM version_numbers WHERE model = NEW.model) "
    "BEGIN SELECT RAISE(ABORT, " + NEXT_ONLY + "); END",
)

POSTGRESQL = (
    "CREATE FUNCTION refuse() RETURNS trigger LANGUAGE plpgsql AS "
    "$$ BEGIN RAISE EXCEPTION '%', TG_ARGV[0] " + REFUSED + "; END $$",
    "CREATE FUNCTION follow() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN "  # noqa: S608 (likewise)
    "IF NEW.number IS DISTINCT FROM (SELECT last FROM version_numbers WHERE model = NEW.model) THEN "
    "RAISE EXCEPTION " + NEXT_ONLY + " " + REFUSED + "; END IF; RETURN NEW; END $$",
    "CREATE TRIGGER version_numbers_grow BEFORE UPDATE ON version_numbers FOR EACH ROW "
    "WHEN (NEW.last < OLD.last) EXECUTE FUNCTION refuse(" + NEVER_BACK + ")",
    "CREATE TRIGGER version_numbers_stay BEFORE DELETE ON version_numbers FOR EACH ROW "
    "EXECUTE FUNCTION refuse(" + NEVER_BACK + ")",
    "CREATE TRIGGER versions_stay BEFORE UPDATE ON versions FOR EACH ROW "
    "EXECUTE FUNCTION refuse(" + IMMUTABLE + ")",
    "CREATE TRIGGER versions_follow BEFORE INSERT ON versions FOR EACH ROW EXECUTE FUNCTION follow()",
)

TRIGGERS = {
    "version_numbers_grow": "version_numbers",
    "version_numbers_stay": "version_numbers",
    "versions_stay": "versions",
    "versions_follow": "versions",
}


def upgrade() -> None:
    """Add what resuming, adopting and counting need."""
    _sessions()
    _jobs()
    _numbers()
    for statement in SQLITE if _is_sqlite() else POSTGRESQL:
        op.execute(statement)


def downgrade() -> None:
    """Take it away again; sessions and jobs stay."""
    for trigger, table in TRIGGERS.items():
        op.execute(f"DROP TRIGGER {trigger}" + ("" if _is_sqlite() else f" ON {table}"))
    if not _is_sqlite():
        op.execute("DROP FUNCTION refuse")
        op.execute("DROP FUNCTION follow")
    op.add_column("models", sa.Column("last_version", sa.Integer(), nullable=False, server_default="0"))
    op.execute(
        "UPDATE models SET last_version = "
        "(SELECT last FROM version_numbers WHERE version_numbers.model = models.name)"
    )
    op.drop_table("version_numbers")
    op.drop_table("session_checkpoints")
    op.drop_table("workers")
    for table, columns in (("sessions", ("epoch", "artifact_digest")), ("jobs", ("attempt", "worker"))):
        for column in columns:
            op.drop_column(table, column)


def _is_sqlite() -> bool:
    return op.get_bind().dialect.name == "sqlite"


def _sessions() -> None:
    op.add_column("sessions", sa.Column("epoch", sa.BigInteger(), nullable=False, server_default="0"))
    op.add_column("sessions", sa.Column("artifact_digest", sa.Text(), nullable=True))
    op.create_table(
        "session_checkpoints",
        sa.Column("session_id", sa.Text(), nullable=False),
        sa.Column("n_frames", sa.BigInteger(), nullable=False),
        sa.Column("n_events", sa.BigInteger(), nullable=False),
        sa.Column("n_segments", sa.BigInteger(), nullable=False),
        sa.Column("state", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["session_id"], ["sessions.id"], name="fk_session_checkpoints_session_id", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("session_id", name="pk_session_checkpoints"),
    )


def _jobs() -> None:
    op.add_column("jobs", sa.Column("attempt", sa.Integer(), nullable=False, server_default="0"))
    op.add_column("jobs", sa.Column("worker", sa.Text(), nullable=True))
    op.create_table(
        "workers",
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("beats", sa.BigInteger(), nullable=False),
        sa.Column("started_at", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_workers"),
    )


def _numbers() -> None:
    op.create_table(
        "version_numbers",
        sa.Column("model", sa.Text(), nullable=False),
        sa.Column("last", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("model", name="pk_version_numbers"),
    )
    op.execute("INSERT INTO version_numbers (model, last) SELECT name, last_version FROM models")
    op.drop_column("models", "last_version")
