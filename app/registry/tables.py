"""The tables. What must always hold is held by the database: keys, references, checks."""

from __future__ import annotations

import re
from datetime import UTC, datetime

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    CheckConstraint,
    Column,
    DateTime,
    Dialect,
    Double,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Table,
    Text,
    TypeDecorator,
    UniqueConstraint,
)

_UNHELD = re.compile("[\0\ud800-\udfff]")


class Instant(TypeDecorator[datetime]):
    """An aware time in UTC; SQLite, which knows no time zones, keeps it naive."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        """Turn the time to UTC."""
        return None if value is None else value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        """Return the time in UTC."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


class Words(TypeDecorator[str]):
    """Text that every database can hold: NUL and lone surrogates become the replacement character."""

    impl = Text
    cache_ok = True

    @property
    def python_type(self) -> type[str]:
        """What a value of it is in Python."""
        return str

    def process_bind_param(self, value: str | None, _dialect: Dialect) -> str | None:
        """Replace what cannot be held."""
        return None if value is None else _UNHELD.sub("\ufffd", value)


def now() -> datetime:
    """Return the time of this moment in UTC."""
    return datetime.now(UTC)


metadata = MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "ck": "ck_%(table_name)s_%(constraint_name)s",
    }
)

Json = JSON(none_as_null=True)
Counting = BigInteger().with_variant(Integer, "sqlite")
"""A key that counts up by itself: rows in order of arrival."""

models = Table(
    "models",
    metadata,
    Column("name", Words, primary_key=True),
    Column("objects", Json, nullable=False),
    Column("table_height_m", Double, nullable=False),
    Column("description", Words),
    Column("features", Json, nullable=False),
    Column("revision", Words, nullable=False),
    Column("created_at", Instant, nullable=False),
    Column("updated_at", Instant, nullable=False),
)

version_numbers = Table(  # last: given out last to a model of this name, also to one that was deleted
    "version_numbers",
    metadata,
    Column("model", Words, primary_key=True),
    Column("last", Integer, nullable=False),
)

demonstrations = Table(
    "demonstrations",
    metadata,
    Column("position", Counting, primary_key=True, autoincrement=True),
    Column("id", Words, nullable=False, unique=True),
    Column("model", ForeignKey("models.name", ondelete="CASCADE"), nullable=False),
    Column("action", Words, nullable=False),
    Column("digest", Words, nullable=False),
    Column("n_frames", Integer, nullable=False),
    Column("duration_s", Double, nullable=False),
    Column("objects", Json, nullable=False),
    Column("table_height_m", Double, nullable=False),
    Column("meta", Json, nullable=False),
    Column("created_at", Instant, nullable=False),
    UniqueConstraint("model", "digest"),
    Index(None, "model", "position"),
)

versions = Table(
    "versions",
    metadata,
    Column("model", ForeignKey("models.name", ondelete="CASCADE"), primary_key=True),
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("artifact_digest", Words, nullable=False),
    Column("actions", Json, nullable=False),
    Column("options", Json, nullable=False),
    Column("seed", BigInteger),
    Column("demonstrations", Json, nullable=False),
    Column("base", Integer),
    Column("library_versions", Json, nullable=False),
    Column("evaluation", Json),
    Column("job_id", Words, unique=True),
    Column("created_at", Instant, nullable=False),
    ForeignKeyConstraint(["model", "base"], ["versions.model", "versions.number"]),
    CheckConstraint("number > 0", name="counts_from_one"),
    CheckConstraint("base < number", name="base_is_older"),
)

aliases = Table(
    "aliases",
    metadata,
    Column("model", ForeignKey("models.name", ondelete="CASCADE"), primary_key=True),
    Column("alias", Words, primary_key=True),
    Column("version", Integer, nullable=False),
    Column("updated_at", Instant, nullable=False),
    ForeignKeyConstraint(["model", "version"], ["versions.model", "versions.number"]),
)

alias_changes = Table(
    "alias_changes",
    metadata,
    Column("position", Counting, primary_key=True, autoincrement=True),
    Column("model", ForeignKey("models.name", ondelete="CASCADE"), nullable=False),
    Column("alias", Words, nullable=False),
    Column("version", Integer),
    Column("previous", Integer),
    Column("by", Words),
    Column("at", Instant, nullable=False),
    ForeignKeyConstraint(["model", "version"], ["versions.model", "versions.number"]),
    ForeignKeyConstraint(["model", "previous"], ["versions.model", "versions.number"]),
    Index(None, "model", "alias", "position"),
)

jobs = Table(  # attempt: counts who has taken it on, worker: who did so last
    "jobs",
    metadata,
    Column("position", Counting, primary_key=True, autoincrement=True),
    Column("id", Words, nullable=False, unique=True),
    Column("kind", Words, nullable=False),
    Column("model", Words),
    Column("request", Json, nullable=False),
    Column("state", Words, nullable=False),
    Column("done", BigInteger, nullable=False),
    Column("total", BigInteger, nullable=False),
    Column("message", Words, nullable=False),
    Column("result", Json),
    Column("error", Json),
    Column("cancel_requested", Boolean, nullable=False),
    Column("attempt", Integer, nullable=False, server_default="0"),
    Column("worker", Words),
    Column("scope", Words, nullable=False),
    Column("idempotency_key", Words),
    Column("created_at", Instant, nullable=False),
    Column("updated_at", Instant, nullable=False),
    UniqueConstraint("scope", "idempotency_key"),
    CheckConstraint("state IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')", name="state"),
    Index(None, "state", "position"),
    Index(None, "model", "position"),
)

workers = Table(  # beats: counts up for as long as the worker lives
    "workers",
    metadata,
    Column("id", Words, primary_key=True),
    Column("beats", BigInteger, nullable=False),
    Column("started_at", Instant, nullable=False),
)

sessions = Table(  # epoch: counts the processes that have taken it on; the last of them alone may write
    "sessions",
    metadata,
    Column("position", Counting, primary_key=True, autoincrement=True),
    Column("id", Words, nullable=False, unique=True),
    Column("name", Words),
    Column("model", Words, nullable=False),
    Column("version", Integer, nullable=False),
    Column("artifact_digest", Words),
    Column("epoch", BigInteger, nullable=False, server_default="0"),
    Column("token_hash", Words, nullable=False),
    Column("state", Words, nullable=False),
    Column("geometry", Json, nullable=False),
    Column("channels", Json, nullable=False),
    Column("start", Json, nullable=False),
    Column("n_frames", BigInteger, nullable=False),
    Column("n_events", BigInteger, nullable=False),
    Column("n_segments", BigInteger, nullable=False),
    Column("frames_kept", Boolean, nullable=False),
    Column("created_at", Instant, nullable=False),
    Column("last_seen_at", Instant, nullable=False),
    CheckConstraint("state IN ('active', 'ended', 'expired')", name="state"),
    Index(None, "state", "position"),
    Index(None, "name", "position"),
)

session_checkpoints = Table(  # state: of its recogniser after so many frames and events
    "session_checkpoints",
    metadata,
    Column("session_id", ForeignKey("sessions.id", ondelete="CASCADE"), primary_key=True),
    Column("n_frames", BigInteger, nullable=False),
    Column("n_events", BigInteger, nullable=False),
    Column("n_segments", BigInteger, nullable=False),
    Column("state", LargeBinary, nullable=False),
)

session_frames = Table(
    "session_frames",
    metadata,
    Column("session_id", ForeignKey("sessions.id", ondelete="CASCADE"), primary_key=True),
    Column("first_seq", BigInteger, primary_key=True, autoincrement=False),
    Column("n_frames", Integer, nullable=False),
    Column("rows", LargeBinary, nullable=False),
    CheckConstraint("n_frames > 0", name="not_empty"),
)

session_events = Table(  # segment: number of the segment, for events that are one
    "session_events",
    metadata,
    Column("session_id", ForeignKey("sessions.id", ondelete="CASCADE"), primary_key=True),
    Column("event", BigInteger, primary_key=True, autoincrement=False),
    Column("type", Words, nullable=False),
    Column("text", Words, nullable=False),
    Column("segment", BigInteger),
    UniqueConstraint("session_id", "segment"),
)
