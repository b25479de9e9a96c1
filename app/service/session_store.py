"""Sessions in the database, and what is asked of them when they start."""

from __future__ import annotations

import secrets
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any
from uuid import uuid4

import numpy as np

from app.motion.errors import InvalidRequest, RoleMissing
from app.motion.model import Model
from app.motion.recogniser import Recogniser
from app.motion.trajectory import FARTHEST_M, Scene
from app.registry import models, sessions
from app.registry.errors import ArtifactInvalid, OutOfOrder
from app.registry.records import SessionRecord, SessionState, StoredEvent
from app.service.frames import Encoding, Layout
from app.service.geometry import Geometry, Goals, to_metres
from app.service.journal import Entry
from app.service.lab import Lab, Version
from app.service.messages import as_json
from app.service.session import Pinned
from app.service.session_errors import SessionGone, StartRefused, WriteFailed
from app.service.tokens import digest_of

MOST_EVENTS = 1000
"""Events read at once."""
PAGE = 500
"""Sessions looked at at once."""
ATTEMPTS = 5
"""How often the end of a session is tried while another process adds to it."""


@dataclass(frozen=True)
class Wish:
    """What a session is asked to be; None leaves it to the model.

    table_height [m]; rate_hz [Hz]; goals: in the geometry's unit.
    """

    model: str
    geometry: Geometry
    version: str | None = None
    rate_hz: float | None = None
    objects: tuple[str, ...] | None = None
    table_height: float | None = None
    goals: Goals = field(default_factory=dict)
    name: str | None = None
    encoding: Encoding = "json"

    def layout(self, roles: tuple[str, ...]) -> Layout:
        """Return what a frame holds; roles: of the model. Raises StartRefused."""
        objects = roles if self.objects is None else self.objects
        if len(set(objects)) < len(objects) or not {"t", "hand"}.isdisjoint(objects):
            detail = "objects need names of their own, other than `t` and `hand`"
            raise StartRefused("objects_invalid", detail)
        if self.encoding == "f32" and self.rate_hz is None:
            raise StartRefused("f32_needs_rate", "f32 cannot carry times: give `rate_hz`, or use f64")
        return Layout(objects, self.geometry, self.rate_hz, self.encoding)

    def places(self, objects: tuple[str, ...]) -> dict[str, tuple[float, ...]]:
        """Return the goals in metres, Z up; objects: of the stream. Raises StartRefused."""
        found = {}
        if not self.goals.keys().isdisjoint(objects):
            detail = "goals need names of their own, other than those of the objects, which are goals as well"
            raise StartRefused("goals_invalid", detail)
        for name, place in self.goals.items():
            [metres] = to_metres(np.array([place]), self.geometry)
            if (np.abs(metres) > FARTHEST_M).any():
                detail = f"goal {name!r} lies over {FARTHEST_M:g} m away: a wrong length unit?"
                raise StartRefused("wrong_unit", detail)
            found[name] = tuple(metres.tolist())
        return found

    @property
    def scene(self) -> Scene | None:
        """What stands still, None: as the model says."""
        return None if self.table_height is None else Scene(self.table_height)


@dataclass(frozen=True)
class Opened:
    """A session just created: what it is pinned to, its recogniser, its resume token."""

    pinned: Pinned
    recogniser: Recogniser
    token: str


class SessionStore:
    """Opens sessions and keeps them in the database; every method may wait for the disk."""

    def __init__(self, lab: Lab) -> None:
        self._lab = lab

    def open(self, wish: Wish) -> Opened:
        """Create a session on the version it asks for. Raises NotFound, StartRefused."""
        version = self._version(wish)
        model, number = version.model, version.record.number
        layout = wish.layout(model.features.objects)
        goals = wish.places(layout.objects)
        with self._lab.database.reading() as tx:
            scene = wish.scene or Scene(models.get(tx, wish.model).table_height_m)
        recogniser = _recogniser(model, scene, layout, goals)
        pinned = Pinned(
            session_id=uuid4().hex,
            model=wish.model,
            version=number,
            roles=model.features.objects,
            actions=model.names,
            layout=layout,
            scene=scene,
            goals=goals,
            warnings=_warnings(wish, model),
        )
        token = secrets.token_urlsafe(24)
        with self._lab.database.transaction() as tx:
            sessions.create(
                tx,
                id_=pinned.session_id,
                model=wish.model,
                version=number,
                token_hash=digest_of(token),
                geometry=vars(wish.geometry),
                channels=("t", *layout.channels) if layout.rate_hz else layout.channels,
                name=wish.name,
                start=_start(wish, pinned),
            )
        return Opened(pinned, recogniser, token)

    def write(self, entries: Sequence[Entry]) -> None:
        """Make what sessions add durable, all of it or nothing.

        Raises SessionGone for a session that was ended from outside meanwhile.
        """
        with self._lab.database.transaction() as tx:
            try:
                over = sessions.append_all(tx, [_addition(entry) for entry in entries])
            except OutOfOrder as error:
                raise SessionGone(error.session_id) from None
            for entry in entries:
                if entry.session_id in over and not entry.ended:
                    raise SessionGone(entry.session_id)

    def get(self, session_id: str) -> SessionRecord:
        """Return what is durable of a session. Raises NotFound."""
        with self._lab.database.reading() as tx:
            return sessions.get(tx, session_id)

    def events(self, session_id: str, after: int) -> tuple[StoredEvent, ...]:
        """Return the first ``MOST_EVENTS`` of the durable events after number ``after``. Raises NotFound."""
        with self._lab.database.reading() as tx:
            return sessions.events(tx, session_id, after=after, limit=MOST_EVENTS)

    def end(self, session_id: str) -> None:
        """End a session that lives elsewhere or nowhere any more. Raises NotFound."""
        self._close(session_id, "ended")

    def expire(self, last_seen_before: datetime, living: Collection[str]) -> int:
        """Expire active sessions that no process has seen since then; return how many.

        living: ids of those that live in this process.
        """
        token, ids = None, []
        while True:
            with self._lab.database.reading() as tx:
                page = sessions.page(tx, size=PAGE, after=token, state="active")
            ids += [record.id for record in page.records if record.last_seen_at < last_seen_before]
            if (token := page.next_token) is None:
                break
        return sum(self._close(id_, "expired", last_seen_before) for id_ in ids if id_ not in living)

    def drop_frames(self, last_seen_before: datetime) -> int:
        """Drop the frames of sessions that are over and were last seen before then; return how many."""
        with self._lab.database.transaction() as tx:
            return sessions.drop_frames(tx, last_seen_before=last_seen_before)

    def _version(self, wish: Wish) -> Version:
        try:
            return self._lab.version(wish.model, wish.version)
        except ArtifactInvalid as error:
            detail = f"what was trained cannot be read ({error}): train the model again"
            raise StartRefused("version_unusable", detail) from error

    def _close(self, session_id: str, state: SessionState, last_seen_before: datetime | None = None) -> bool:
        """End a session that this process does not feed; return whether it was active, and seen no later.

        What was open in its recogniser is lost; ``ended`` still becomes its last event. Another process may
        add to the session at the same moment: then once more from the start.
        """
        for _ in range(ATTEMPTS):
            with suppress(OutOfOrder), self._lab.database.transaction() as tx:
                record = sessions.get(tx, session_id)
                seen = last_seen_before is not None and record.last_seen_at >= last_seen_before
                if record.state != "active" or seen:
                    return False
                fields = {"segments": record.n_segments, "frames": record.n_frames}
                text = as_json({"type": "ended", "event": record.n_events, **fields})
                last = StoredEvent(record.n_events, "ended", text)
                sessions.append(tx, session_id, first_seq=record.n_frames, events=[last])
                sessions.end(tx, session_id, state)
                return True
        raise WriteFailed


def _recogniser(model: Model, scene: Scene, layout: Layout, goals: Goals) -> Recogniser:
    """Return what recognises the stream. Raises StartRefused where its objects cannot fill the roles."""
    places = {name: np.array(place) for name, place in goals.items()}
    try:
        return Recogniser(model, scene, rate=layout.rate_hz, objects=layout.objects, goals=places)
    except RoleMissing as error:
        raise StartRefused("role_missing", str(error)) from error
    except InvalidRequest as error:
        raise StartRefused("objects_ambiguous", str(error)) from error


def _addition(entry: Entry) -> sessions.Addition:
    rows = np.concatenate(entry.rows).astype("<f8").tobytes() if entry.rows else b""
    return sessions.Addition(entry.session_id, entry.first_seq, rows, entry.events, entry.ended)


def _warnings(wish: Wish, model: Model) -> tuple[tuple[str, str], ...]:
    rate = model.features.rate
    if wish.rate_hz is None or wish.rate_hz >= rate:
        return ()
    return (("low_rate", f"{wish.rate_hz:g} Hz is less than the {rate:g} Hz the model works at"),)


def _start(wish: Wish, pinned: Pinned) -> dict[str, Any]:
    return {
        "version": wish.version,
        "rate_hz": wish.rate_hz,
        "objects": None if wish.objects is None else list(wish.objects),
        "table_height_m": pinned.scene.table_height,
        "goals": {name: list(place) for name, place in pinned.goals.items()},
        "encoding": wish.encoding,
    }
