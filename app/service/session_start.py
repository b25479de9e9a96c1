"""What a session is asked to be when it starts, and what it is pinned to then."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from app.motion.errors import InvalidRequest, RoleMissing
from app.motion.model import Model
from app.motion.recogniser import Recogniser
from app.motion.trajectory import FARTHEST_M, Scene
from app.registry.records import SessionRecord
from app.service.frames import Encoding, Layout
from app.service.geometry import Geometry, Goals
from app.service.session import Pinned
from app.service.session_errors import StartRefused


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
            [metres] = self.geometry.to_metres(np.array([place]))
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
class Ticket:
    """What a client comes back with: the last event it has, and the start it says again."""

    session_id: str
    token: str
    last_event: int
    wish: Wish


def pinned_to(session_id: str, wish: Wish, model: Model, number: int, height: float) -> Pinned:
    """Return what a new session is pinned to; height: of the model's table [m]. Raises StartRefused."""
    layout = wish.layout(model.features.objects)
    return Pinned(
        session_id=session_id,
        model=wish.model,
        version=number,
        roles=model.features.objects,
        actions=model.names,
        layout=layout,
        scene=wish.scene or Scene(height),
        goals=wish.places(layout.objects),
        warnings=_warnings(wish, model),
    )


def start_of(wish: Wish, pinned: Pinned) -> dict[str, Any]:
    """Return what is kept of a start beside the columns of its own."""
    return {
        "version": wish.version,
        "rate_hz": wish.rate_hz,
        "objects": None if wish.objects is None else list(wish.objects),
        "table_height_m": pinned.scene.table_height,
        "goals": {name: list(place) for name, place in pinned.goals.items()},
        "encoding": wish.encoding,
    }


def pinned_before(record: SessionRecord, model: Model) -> Pinned:
    """Return what a session was pinned to when it started; inverts ``start_of``."""
    start: Mapping[str, Any] = record.start
    roles = model.features.objects
    objects = roles if start["objects"] is None else tuple(start["objects"])
    goals = start.get("goals", {})
    return Pinned(
        session_id=record.id,
        model=record.model,
        version=record.version,
        roles=roles,
        actions=model.names,
        layout=Layout(objects, Geometry(**record.geometry), start["rate_hz"], start["encoding"]),
        scene=Scene(start["table_height_m"]),
        goals={name: tuple(place) for name, place in goals.items()},
    )


def check_same(pinned: Pinned, n_events: int, ticket: Ticket) -> None:
    """Raise StartRefused unless a client comes back to what it started; n_events: that there are so far."""
    wish = ticket.wish
    layout = replace(wish.layout(pinned.roles), encoding=pinned.layout.encoding)
    wanted = wish.model, layout, wish.scene or pinned.scene, wish.places(layout.objects)
    if wanted != (pinned.model, pinned.layout, pinned.scene, pinned.goals):
        detail = "model, geometry, rate_hz, objects, scene and goals must be those of the first start"
        raise StartRefused("resume_mismatch", detail)
    if ticket.last_event >= n_events:
        detail = f"`last_event` {ticket.last_event} has not been: {n_events} events have"
        raise StartRefused("resume_mismatch", detail)


def recogniser_of(model: Model, pinned: Pinned) -> Recogniser:
    """Return what recognises the stream. Raises StartRefused where its objects cannot fill the roles."""
    layout = pinned.layout
    places = {name: np.array(place) for name, place in pinned.goals.items()}
    try:
        return Recogniser(model, pinned.scene, rate=layout.rate_hz, objects=layout.objects, goals=places)
    except RoleMissing as error:
        raise StartRefused("role_missing", str(error)) from error
    except InvalidRequest as error:
        raise StartRefused("objects_ambiguous", str(error)) from error


def _warnings(wish: Wish, model: Model) -> tuple[tuple[str, str], ...]:
    rate = model.features.rate
    if wish.rate_hz is None or wish.rate_hz >= rate:
        return ()
    return (("low_rate", f"{wish.rate_hz:g} Hz is less than the {rate:g} Hz the model works at"),)
