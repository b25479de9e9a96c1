"""A seeded simulator of the paper's table-top protocol (Sec. IV-A): 100 Hz, one hand, one object.

A movement runs straight from start to goal in a minimum-jerk profile; an arch lifts it, a bow swings it
sideways, slow random modes bend it, and the sensor adds noise. The object stands at the goal of a grasp,
goes with the hand while it is displaced or pushed, and stays where it was left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from app.motion.errors import InvalidRequest
from app.motion.trajectory import Demonstration, Floats, Recording, Segment, Trajectory

RATE = 100.0
"""Of the simulated motion capture [Hz]."""

ANGLES = (-0.9, 0.0, 0.9)
DISTANCES = (0.25, 0.40)
"""The six trained points: to the left, in front and to the right [rad], near and far [m]."""

UNTRAINED_ANGLE = 1.0
UNTRAINED_DISTANCES = (0.22, 0.42)
"""Recordings go to places within this angle to either side [rad], between these distances [m]."""

NEAREST = 0.1
"""An object is moved at least this far [m]."""

REST_POINT = np.array([0.0, 0.0, 0.02])
"""Where the hand rests, in front of the demonstrator [m]."""

UP = np.array([0.0, 0.0, 1.0])
GRIP = np.array([0.0, 0.0, 0.04])
"""From the object's marker to the hand that holds it [m]."""

MODES = 4
MODE_SIZE = 0.006
"""Standard deviation of the first of the slow sine modes; that of mode k is a k-th of it [m]."""


@dataclass(frozen=True)
class Style:
    """The shape of a class: height of its arch and width of its bow [m], how far its modes lift it (share).

    via: (3,) further offset at the middle of the movement, in (along, sideways, up) [m].
    """

    arch: float
    bow: float
    lift: float = 1.0
    via: tuple[float, float, float] = (0.0, 0.0, 0.0)


STYLES = {
    "grasp": Style(arch=0.06, bow=0.025),
    "displace": Style(arch=0.13, bow=0.01),
    "push": Style(arch=0.0, bow=0.008, lift=0.15),
    "retract": Style(arch=0.05, bow=-0.03),
}


@dataclass(frozen=True)
class Conditions:
    """What makes the motion harder to recognise.

    noise: of the sensor, standard deviation [m]; outlier_share: of the frames, thrown off by outlier_size
    [m]; gap_share: of the actions, losing the hand for gap_length [s] in their middle; rest: shortest and
    longest rest between actions [s]; sweep: factor on bow and modes; styles: of the classes, which
    ``{**STYLES, **further_styles(seed, n)}`` extends.
    """

    noise: float = 0.0005
    outlier_share: float = 0.0
    outlier_size: float = 0.10
    gap_share: float = 0.0
    gap_length: float = 0.3
    rest: tuple[float, float] = (0.0, 0.2)
    sweep: float = 1.0
    styles: Mapping[str, Style] = field(default_factory=lambda: STYLES)


def demonstrations(seed: int, conditions: Conditions = Conditions()) -> tuple[Demonstration, ...]:
    """Return the paper's training set: grasp and retract ten times for each of the six points.

    All other classes go five times from two of the points to all others.
    """
    rng = np.random.default_rng(seed)
    points = [_grip_above(distance, angle) for angle in ANGLES for distance in DISTANCES]
    moves = {
        "grasp": [(REST_POINT, point) for point in points for _ in range(10)],
        "retract": [(point, REST_POINT) for point in points for _ in range(10)],
    }
    between = [(a, b) for a in (points[0], points[3]) for b in points if a is not b for _ in range(5)]
    return tuple(
        Demonstration(action, _sensed(rng, _tracks(rng, action, start, goal, conditions), conditions))
        for action in conditions.styles
        for start, goal in moves.get(action, between)
    )


def recording(seed: int, n_actions: int = 3, conditions: Conditions = Conditions()) -> Recording:
    """Return a labelled sequence at untrained places: a grasp, movements of the object, a retraction.

    All classes but grasp and retract move the object, in random order; places lie at 0.22-0.42 m within
    1 rad to either side. The rest between two actions belongs to no segment. Raises InvalidRequest for
    fewer than two actions.
    """
    if n_actions < 2:
        raise InvalidRequest("n_actions", f"a sequence has a grasp and a retraction, {n_actions} is too few")
    rng = np.random.default_rng(seed)
    itinerary = _itinerary(rng, n_actions, conditions)
    pieces = [np.stack([REST_POINT, itinerary[0][1]])[:, None]]
    segments: list[Segment] = []
    frame, start = 0, REST_POINT
    for action, goal in itinerary:
        if segments:
            n_rest = round(rng.uniform(*conditions.rest) * RATE)
            pieces.append(np.repeat(pieces[-1][:, -1:], n_rest, axis=1))
            frame += n_rest
        moved = _tracks(rng, action, start, goal, conditions)[:, 1:]
        segments.append(Segment(frame, frame + moved.shape[1], action))
        pieces.append(moved)
        frame, start = segments[-1].end, goal
    sensed = _sensed(rng, np.concatenate(pieces, axis=1), conditions)
    return Recording(_with_gaps(rng, sensed, segments, conditions), tuple(segments))


def further_styles(seed: int, n_classes: int) -> dict[str, Style]:
    """Return the styles of further classes, ``action_5`` and on: arch, bow and via point drawn by seed."""
    rng = np.random.default_rng(seed)
    styles = {}
    for index in range(n_classes):
        along, sideways, up = rng.uniform((-0.05, -0.08, 0.0), (0.05, 0.08, 0.1)).tolist()
        arch, bow = rng.uniform(0.0, 0.2), rng.uniform(-0.08, 0.08)
        styles[f"action_{len(STYLES) + 1 + index}"] = Style(arch, bow, via=(along, sideways, up))
    return styles


def _itinerary(rng: np.random.Generator, n_actions: int, conditions: Conditions) -> list[tuple[str, Floats]]:
    """Return the actions of a recording, each with its goal (3,) [m]."""
    middle = [action for action in conditions.styles if action not in ("grasp", "retract")]
    result = [("grasp", _place(rng))]
    for action in rng.choice(middle, n_actions - 2).tolist():
        goal = _place(rng)
        while np.linalg.norm(goal - result[-1][1]) < NEAREST:
            goal = _place(rng)
        result.append((action, goal))
    return [*result, ("retract", REST_POINT)]


def _tracks(
    rng: np.random.Generator, action: str, start: Floats, goal: Floats, conditions: Conditions
) -> Floats:
    """Return the (2, n_frames, 3) true positions of the hand and of the grip of the object [m]."""
    hand = _movement(rng, conditions.styles[action], start, goal, conditions.sweep)
    if action == "grasp":
        return np.stack([hand, np.broadcast_to(goal, hand.shape)])
    if action == "retract":
        return np.stack([hand, np.broadcast_to(start, hand.shape)])
    return np.stack([hand, hand])


def _movement(rng: np.random.Generator, style: Style, start: Floats, goal: Floats, sweep: float) -> Floats:
    """Return the (n_frames, 3) path of one movement at RATE, both ends included [m]."""
    distance = float(np.linalg.norm(goal - start))
    duration = (0.45 + 1.1 * distance) * rng.lognormal(0.0, 0.15)
    n_frames = max(round(duration * RATE), 2) + 1
    time = np.linspace(0.0, 1.0, n_frames) ** rng.lognormal(0.0, 0.08)
    fraction = 10 * time**3 - 15 * time**4 + 6 * time**5
    hump = np.sin(np.pi * fraction)
    along = (goal - start) / distance
    sideways = np.cross(UP, along)
    axes = np.array([along, sideways / np.linalg.norm(sideways), UP])
    bow = style.bow * rng.lognormal(0.0, 0.4) * sweep
    arch = style.arch * rng.lognormal(0.0, 0.25)
    offset = hump[:, None] * (np.array([0.0, bow, arch]) + np.array(style.via) * hump[:, None])
    for mode in range(1, MODES + 1):
        size = rng.normal(0.0, MODE_SIZE / mode, 3) * sweep * np.array([1.0, 1.0, style.lift])
        offset += np.sin(np.pi * mode * fraction)[:, None] * size
    path: Floats = start + fraction[:, None] * (goal - start) + offset @ axes
    return path


def _sensed(rng: np.random.Generator, tracks: Floats, conditions: Conditions) -> Trajectory:
    """Return what the sensor makes of the (2, n_frames, 3) true positions of hand and grip [m]."""
    hand, markers = tracks + rng.normal(0.0, conditions.noise, tracks.shape) - [[[0.0, 0.0, 0.0]], [GRIP]]
    thrown = np.flatnonzero(rng.random(len(hand)) < conditions.outlier_share)
    direction = rng.normal(size=(len(thrown), 3))
    hand[thrown] += conditions.outlier_size * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return Trajectory(np.arange(len(hand)) / RATE, hand, {"object": markers})


def _with_gaps(
    rng: np.random.Generator, trajectory: Trajectory, segments: Sequence[Segment], conditions: Conditions
) -> Trajectory:
    """Lose the hand in the middle of some actions, never at their ends."""
    hand = trajectory.hand.copy()
    half = round(conditions.gap_length * RATE / 2)
    for segment in segments:
        if rng.random() < conditions.gap_share:
            middle = (segment.start + segment.end) // 2
            hand[max(middle - half, segment.start + 1) : min(middle + half, segment.end)] = np.nan
    return replace(trajectory, hand=hand)


def _place(rng: np.random.Generator) -> Floats:
    return _grip_above(rng.uniform(*UNTRAINED_DISTANCES), rng.uniform(-UNTRAINED_ANGLE, UNTRAINED_ANGLE))


def _grip_above(distance: float, angle: float) -> Floats:
    """Return where the hand holds an object that stands on the table there [m]."""
    return GRIP + distance * np.array([np.sin(angle), np.cos(angle), 0.0])
