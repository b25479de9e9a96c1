"""The first tables."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

COUNTING = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    """Make the tables."""
    _models()
    _demonstrations()
    _versions()
    _aliases()
    _alias_changes()
    _jobs()
    _sessions()
    _session_frames()
    _session_events()


def downgrade() -> None:
    """Drop them, those that others refer to last."""
    for name in (
        "session_events",
        "session_frames",
        "sessions",
        "jobs",
        "alias_changes",
        "aliases",
        "versions",
        "demonstrations",
        "models",
    ):
        op.drop_table(name)


def _models() -> None:
    op.create_table(
        "models",
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("objects", sa.JSON(), nullable=False),
        sa.Column("table_height_m", sa.Double(), nullable=False),
        sa.Column("description", sa.Text(), nullable=True),
        sa.Column("features", sa.JSON(), nullable=False),
        sa.Column("revision", sa.Text(), nullable=False),
        sa.Column("last_version", sa.Integer(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("updated_at", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("name", name="pk_models"),
    )


def _demonstrations() -> None:
    op.create_table(
        "demonstrations",
        sa.Column("position", COUNTING, autoincrement=True, nullable=False),
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("model", sa.Text(), nullable=False),
        sa.Column("action", sa.Text(), nullable=False),
        sa.Column("digest", sa.Text(), nullable=False),
        sa.Column("n_frames", sa.Integer(), nullable=False),
        sa.Column("duration_s", sa.Double(), nullable=False),
        sa.Column("objects", sa.JSON(), nullable=False),
        sa.Column("table_height_m", sa.Double(), nullable=False),
        sa.Column("meta", sa.JSON(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["model"], ["models.name"], name="fk_demonstrations_model", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("position", name="pk_demonstrations"),
        sa.UniqueConstraint("id", name="uq_demonstrations_id"),
        sa.UniqueConstraint("model", "digest", name="uq_demonstrations_model_digest"),
    )
    op.create_index("ix_demonstrations_model_position", "demonstrations", ["model", "position"])


def _versions() -> None:
    op.create_table(
        "versions",
        sa.Column("model", sa.Text(), nullable=False),
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("artifact_digest", sa.Text(), nullable=False),
        sa.Column("actions", sa.JSON(), nullable=False),
        sa.Column("options", sa.JSON(), nullable=False),
        sa.Column("seed", sa.BigInteger(), nullable=True),
        sa.Column("demonstrations", sa.JSON(), nullable=False),
        sa.Column("base", sa.Integer(), nullable=True),
        sa.Column("library_versions", sa.JSON(), nullable=False),
        sa.Column("evaluation", sa.JSON(), nullable=True),
        sa.Column("job_id", sa.Text(), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint("base < number", name=op.f("ck_versions_base_is_older")),
        sa.CheckConstraint("number > 0", name=op.f("ck_versions_counts_from_one")),
        sa.ForeignKeyConstraint(
            ["model", "base"], ["versions.model", "versions.number"], name="fk_versions_model_base"
        ),
        sa.ForeignKeyConstraint(["model"], ["models.name"], name="fk_versions_model", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("model", "number", name="pk_versions"),
        sa.UniqueConstraint("job_id", name="uq_versions_job_id"),
    )


def _aliases() -> None:
    op.create_table(
        "aliases",
        sa.Column("model", sa.Text(), nullable=False),
        sa.Column("alias", sa.Text(), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("updated_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["model", "version"], ["versions.model", "versions.number"], name="fk_aliases_model_version"
        ),
        sa.ForeignKeyConstraint(["model"], ["models.name"], name="fk_aliases_model", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("model", "alias", name="pk_aliases"),
    )


def _alias_changes() -> None:
    op.create_table(
        "alias_changes",
        sa.Column("position", COUNTING, autoincrement=True, nullable=False),
        sa.Column("model", sa.Text(), nullable=False),
        sa.Column("alias", sa.Text(), nullable=False),
        sa.Column("version", sa.Integer(), nullable=True),
        sa.Column("previous", sa.Integer(), nullable=True),
        sa.Column("by", sa.Text(), nullable=True),
        sa.Column("at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(
            ["model", "previous"],
            ["versions.model", "versions.number"],
            name="fk_alias_changes_model_previous",
        ),
        sa.ForeignKeyConstraint(
            ["model", "version"], ["versions.model", "versions.number"], name="fk_alias_changes_model_version"
        ),
        sa.ForeignKeyConstraint(
            ["model"], ["models.name"], name="fk_alias_changes_model", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("position", name="pk_alias_changes"),
    )
    op.create_index("ix_alias_changes_model_alias_position", "alias_changes", ["model", "alias", "position"])


def _jobs() -> None:
    op.create_table(
        "jobs",
        sa.Column("position", COUNTING, autoincrement=True, nullable=False),
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("model", sa.Text(), nullable=True),
        sa.Column("request", sa.JSON(), nullable=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("done", sa.BigInteger(), nullable=False),
        sa.Column("total", sa.BigInteger(), nullable=False),
        sa.Column("message", sa.Text(), nullable=False),
        sa.Column("result", sa.JSON(), nullable=True),
        sa.Column("error", sa.JSON(), nullable=True),
        sa.Column("cancel_requested", sa.Boolean(), nullable=False),
        sa.Column("scope", sa.Text(), nullable=False),
        sa.Column("idempotency_key", sa.Text(), nullable=True),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("updated_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint(
            "state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')", name=op.f("ck_jobs_state")
        ),
        sa.PrimaryKeyConstraint("position", name="pk_jobs"),
        sa.UniqueConstraint("id", name="uq_jobs_id"),
        sa.UniqueConstraint("scope", "idempotency_key", name="uq_jobs_scope_idempotency_key"),
    )
    op.create_index("ix_jobs_model_position", "jobs", ["model", "position"])
    op.create_index("ix_jobs_state_position", "jobs", ["state", "position"])


def _sessions() -> None:
    op.create_table(
        "sessions",
        sa.Column("position", COUNTING, autoincrement=True, nullable=False),
        sa.Column("id", sa.Text(), nullable=False),
        sa.Column("name", sa.Text(), nullable=True),
        sa.Column("model", sa.Text(), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.Column("token_hash", sa.Text(), nullable=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("geometry", sa.JSON(), nullable=False),
        sa.Column("channels", sa.JSON(), nullable=False),
        sa.Column("start", sa.JSON(), nullable=False),
        sa.Column("n_frames", sa.BigInteger(), nullable=False),
        sa.Column("n_events", sa.BigInteger(), nullable=False),
        sa.Column("n_segments", sa.BigInteger(), nullable=False),
        sa.Column("frames_kept", sa.Boolean(), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("last_seen_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint("state IN ('active', 'ended', 'expired')", name=op.f("ck_sessions_state")),
        sa.PrimaryKeyConstraint("position", name="pk_sessions"),
        sa.UniqueConstraint("id", name="uq_sessions_id"),
    )
    op.create_index("ix_sessions_name_position", "sessions", ["name", "position"])
    op.create_index("ix_sessions_state_position", "sessions", ["state", "position"])


def _session_frames() -> None:
    op.create_table(
        "session_frames",
        sa.Column("session_id", sa.Text(), nullable=False),
        sa.Column("first_seq", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("n_frames", sa.Integer(), nullable=False),
        sa.Column("rows", sa.LargeBinary(), nullable=False),
        sa.CheckConstraint("n_frames > 0", name=op.f("ck_session_frames_not_empty")),
        sa.ForeignKeyConstraint(
            ["session_id"], ["sessions.id"], name="fk_session_frames_session_id", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("session_id", "first_seq", name="pk_session_frames"),
    )


def _session_events() -> None:
    op.create_table(
        "session_events",
        sa.Column("session_id", sa.Text(), nullable=False),
        sa.Column("event", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("type", sa.Text(), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("segment", sa.BigInteger(), nullable=True),
        sa.ForeignKeyConstraint(
            ["session_id"], ["sessions.id"], name="fk_session_events_session_id", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("session_id", "event", name="pk_session_events"),
        sa.UniqueConstraint("session_id", "segment", name="uq_session_events_session_id_segment"),
    )
