"""A mapping proposed for a recording, with reasons: by names first, then by what moves with the hand.

It is a proposal, for people to look at: names are words of a few languages, and motion is a rule of thumb.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from app.formats.capture import Capture
from app.formats.errors import InvalidMapping
from app.formats.mapping import TrackMapping
from app.motion.trajectory import Flags, Floats

OBJECT = "object"
"""What the only object is called, as in the models of the demo."""

HANDS = [
    re.compile(pattern, re.IGNORECASE)
    for pattern in (
        r"hand$|(^|[^a-z])hand([^a-z]|$)",
        r"hand(?!le)",
        r"palm|glove|wrist",
        r"gripper|(^|[^a-z])(tcp|ee|eef)([^a-z]|$)",
        r"(^|[^a-z])[lr]?(fin|wr[ab])([^a-z]|$)|finger|index|thumb",
    )
]
"""Names of a hand, the surest first."""
THINGS = re.compile(
    r"obj|box|boite|cube|block|brick|cup|mug|bottle|ball|pillow|tool|handle|(^|[^a-z])peg", re.IGNORECASE
)

SEPARATOR = re.compile(r"[ _.:/-]")

WINDOW_S = 0.1
"""Velocities are taken over this time [s]."""
STILL_M_S, MOVING_M_S = 0.03, 0.1
"""Slower is still, faster moves [m/s]."""
SHARE_WITH = 0.5
"""A thing is carried where its velocity differs from the hand's by less than this share of the hand's."""
RARELY, MOSTLY = 0.02, 0.5
"""Shares of frames."""


class Proposal(NamedTuple):
    """A mapping, and why it is so, a sentence each."""

    mapping: TrackMapping
    reasons: tuple[str, ...]


def propose(capture: Capture) -> Proposal:
    """Return which tracks may be the hand and the objects.

    Raises InvalidMapping where none is named like a hand.
    """
    hand, *reasons = _hand(capture)
    system = capture.systems.get(hand)
    others = [
        name
        for name in capture.tracks
        if not any(pattern.search(name) for pattern in HANDS) and capture.systems.get(name) == system
    ]
    groups: dict[str, list[str]] = {}
    for name in others:
        if THINGS.search(name):
            groups.setdefault(_thing(name), []).append(name)
    objects = {}
    for thing, names in groups.items():
        role = OBJECT if len(groups) == 1 else thing
        objects[role] = (best := min(names, key=lambda name: _gaps(capture, name)),)
        of_several = f"; of {len(names)} tracks named so it has the fewest dropouts" if len(names) > 1 else ""
        reasons.append(f"objects.{role}: {best!r}, by its name{of_several}")
    if not objects and (carried := _carried(capture, hand, others)):
        objects[OBJECT] = (carried,)
        reasons.append(
            f"objects.{OBJECT}: {carried!r}, since it moves with {hand!r} at times and rests at others"
        )
    if not objects:
        reasons.append("objects: none, since no track is named like a thing or is carried")
    return Proposal(TrackMapping((hand,), objects), tuple(reasons))


def _hand(capture: Capture) -> tuple[str, str]:
    for pattern in HANDS:
        if names := [name for name in capture.tracks if pattern.search(name)]:
            hand = min(names, key=lambda name: (round(_gaps(capture, name), 2), -_extent(capture, name)))
            others = [repr(name) for name in names if name != hand]
            besides = f"; others are {', '.join(others[:5])}{', …' * (len(others) > 5)}" if others else ""
            return hand, f"hand: {hand!r}, by its name{besides}"
    raise InvalidMapping(
        "hand", f"no track is named like a hand; there are {', '.join(list(capture.tracks)[:20])}"
    )


def _thing(name: str) -> str:
    """Return what a marker is on: of ``boite:front_left`` the ``boite``, of ``red_box_1`` the ``red_box``."""
    found = THINGS.search(name)
    end = SEPARATOR.search(name, found.end() if found else len(name))
    return name[: end.start() if end else len(name)].strip(" _.:/-")


def _gaps(capture: Capture, name: str) -> float:
    return float(np.isnan(capture.tracks[name][:, 0]).mean())


def _extent(capture: Capture, name: str) -> float:
    """Return how far a track spreads: root mean square about its middle [m]."""
    seen = capture.tracks[name][~np.isnan(capture.tracks[name][:, 0])]
    return float(np.sqrt(((seen - seen.mean(axis=0)) ** 2).sum(axis=1).mean())) if len(seen) else 0.0


def _carried(capture: Capture, hand: str, names: list[str]) -> str | None:
    """Return what moves with the hand when it moves, and rests while the hand moves without it."""
    reach = max(1, round(WINDOW_S / capture.period)) if capture.period else len(capture)
    if reach >= len(capture):
        return None
    hands = _velocity(capture, hand, reach)
    speed = np.linalg.norm(hands, axis=1)
    shares = {}
    for name in names:
        velocity = _velocity(capture, name, reach)
        own = np.linalg.norm(velocity, axis=1)
        with_hand = np.linalg.norm(velocity - hands, axis=1) < SHARE_WITH * speed
        rests = _share(own < STILL_M_S, speed > MOVING_M_S)
        moves = float((own > MOVING_M_S).mean())
        together = _share(with_hand, own > MOVING_M_S)
        if moves > RARELY and rests > RARELY and together > MOSTLY:
            shares[name] = together * rests
    return max(shares, key=lambda name: shares[name]) if shares else None


def _velocity(capture: Capture, name: str, reach: int) -> Floats:
    """Return (n - reach, 3) [m/s], NaN where an end is missing."""
    track, times = capture.tracks[name], capture.times
    velocity: Floats = (track[reach:] - track[:-reach]) / (times[reach:] - times[:-reach])[:, None]
    return velocity


def _share(of: Flags, among: Flags) -> float:
    return float(of[among].mean()) if among.any() else 0.0
