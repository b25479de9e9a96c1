"""Generation of movements between end points that nobody demonstrated (Sec. III-D of the paper).

The shape comes from the class's primitive, for the task that is asked for; the inverse of the alignment lays
it between start and goal. A movement starts and ends at rest, exactly at the asked points, and is stretched
evenly in time until it keeps the limits: that changes neither its path nor the form of its speed, which are
what was learned. The paper's plain method is there for comparison; it does not rest at its ends.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from app.motion.asked import ANY, MAX_STEPS, MAX_VIA, Limits, Method, Step, Via
from app.motion.course import Course
from app.motion.errors import InvalidRequest
from app.motion.feasibility import Notice, Violation, passes, remoteness, rests
from app.motion.features import BLEND, alignment, decode
from app.motion.keypoints import PlainCourse, plain_course_of
from app.motion.model import ActionModel, Model
from app.motion.primitive import primitive_of
from app.motion.timing import (
    MAX_FRAMES,
    check_duration,
    count_periods,
    expected_duration,
    least_duration,
)
from app.motion.trajectory import FARTHEST_M, Floats

OF_A_STEP = ("goal", "duration", "via")
"""Arguments that each step has for itself."""


@dataclass(frozen=True, eq=False)
class GeneratedMotion:
    """A movement at a constant rate: its first frame is the start, its last the goal, at rest in both.

    times (n,) from 0 [s]; positions [m], velocities [m/s], accelerations [m/s^2] (n, 3); std (n, 3):
    standard deviation of the demonstrated movements along the world's axes [m], zero at both ends; notices:
    what is to be known about it; violations: what it was asked for and does not do.
    """

    times: Floats
    positions: Floats
    velocities: Floats
    accelerations: Floats
    std: Floats
    notices: tuple[Notice, ...] = ()
    violations: tuple[Violation, ...] = ()


def generate(
    model: Model,
    action: str,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    rate: float = 100.0,
    duration: float | None = None,
    method: Method = "default",
    via: Sequence[Via] = (),
    limits: Limits = ANY,
) -> GeneratedMotion:
    """Return a movement of a class from start to goal, (3,) each [m], at a rate [Hz].

    duration [s], by default what the demonstrations took for such a length, is rounded up to whole periods,
    and longer where the limits ask for it; method: ``paper`` for the plain one, which knows no via. Raises
    UnknownAction, and InvalidRequest, which names the argument.
    """
    chain = model.action(action)
    here, there = _point("start", start), _point("goal", goal)
    length = float(np.linalg.norm(there - here))
    if length < BLEND:
        raise InvalidRequest("goal", f"lies {length:.3g} m from the start, needs to lie {BLEND:g} m away")
    wanted = expected_duration(chain, length) if duration is None else check_duration(duration)
    notices = list(remoteness(chain, here, there - here))
    course: Course | PlainCourse
    fractions, points, stds = _vias(here, there, via)
    if method == "paper":
        if via:
            raise InvalidRequest("via", "the plain method of the paper passes no points; leave one out")
        course = plain_course_of(chain).of_length(length)
    else:
        course = Course.of(length, *primitive_of(chain).shape(there - here, wanted))
        course = course.passing(fractions, points, stds) if via else course
        notices += _shape_notices(chain)
    least = least_duration(course, limits)
    if least > wanted:
        notices.append(Notice("slowed", f"the limits ask for {least:.3g} s instead of {wanted:.3g} s"))
    motion = _sampled(course, here, there, count_periods(rate, max(wanted, least)), rate)
    at = fractions * motion.times[-1]
    missed = passes(at, course.derivative(fractions, 0), points, stds)
    violations = (*rests(motion.times, motion.velocities), *missed)
    return replace(motion, notices=tuple(notices), violations=violations)


def generate_task(
    model: Model,
    start: ArrayLike,
    steps: Sequence[Step],
    *,
    rate: float = 100.0,
    method: Method = "default",
    limits: Limits = ANY,
) -> tuple[GeneratedMotion, Floats]:
    """Return one movement through all steps, and (n_steps,) times at which they end [s].

    Raises UnknownAction, and InvalidRequest, which names the argument: ``steps.1.goal``.
    """
    if not 1 <= len(steps) <= MAX_STEPS:
        raise InvalidRequest("steps", f"are {len(steps)}, must be 1 to {MAX_STEPS}")
    motions, here, n_frames = [], start, 0
    for number, step in enumerate(steps):
        try:
            motion = generate(
                model,
                step.action,
                here,
                step.goal,
                rate=rate,
                duration=step.duration,
                method=method,
                via=step.via,
                limits=limits,
            )
        except InvalidRequest as error:
            if error.field.partition(".")[0] not in OF_A_STEP:
                raise
            raise InvalidRequest(f"steps.{number}.{error.field}", error.detail) from error
        motions.append(motion)
        here, n_frames = step.goal, n_frames + len(motion.times) - 1
        if n_frames >= MAX_FRAMES:
            raise InvalidRequest("rate", f"all steps at {rate:g} Hz are over {MAX_FRAMES} frames")
    ends = np.cumsum([len(motion.times) - 1 for motion in motions]) / rate
    return join(motions, rate), ends


def join(motions: Sequence[GeneratedMotion], rate: float) -> GeneratedMotion:
    """Return one movement of several at a rate [Hz], each of which starts where the one before it ends."""
    first, *others = motions

    def all_of(name: str) -> Floats:
        return np.concatenate([getattr(first, name), *(getattr(other, name)[1:] for other in others)])

    positions = all_of("positions")
    begins = np.cumsum([0.0, *(motion.times[-1] for motion in motions[:-1])])
    return GeneratedMotion(
        times=np.arange(len(positions)) / rate,
        positions=positions,
        velocities=all_of("velocities"),
        accelerations=all_of("accelerations"),
        std=all_of("std"),
        notices=tuple(
            Notice(notice.code, f"step {number}: {notice.detail}")
            for number, motion in enumerate(motions)
            for notice in motion.notices
        ),
        violations=tuple(
            replace(violation, time=float(begin) + violation.time)
            for begin, motion in zip(begins, motions, strict=True)
            for violation in motion.violations
        ),
    )


def _sampled(
    course: Course | PlainCourse,
    start: Floats,
    goal: Floats,
    n_periods: int,
    rate: float,
) -> GeneratedMotion:
    """Return the frames of a course between start and goal that takes so many periods of a rate [Hz]."""
    phase, rotation, seconds = np.linspace(0.0, 1.0, n_periods + 1), alignment(start, goal), n_periods / rate
    deviation = course.derivative(phase, 0)
    deviation[:, 0] -= course.length * phase
    return GeneratedMotion(
        times=np.arange(n_periods + 1) / rate,
        positions=decode(deviation, start, goal),
        velocities=course.derivative(phase, 1) @ rotation / seconds,
        accelerations=course.derivative(phase, 2) @ rotation / seconds**2,
        std=np.sqrt(course.std(phase) ** 2 @ rotation**2),
    )


def _vias(start: Floats, goal: Floats, via: Sequence[Via]) -> tuple[Floats, Floats, Floats]:
    """Return (m,) fractions, (m, 3) points in aligned axes from the start [m], and (m,) std [m].

    Raises InvalidRequest for one that is none.
    """
    if len(via) > MAX_VIA:
        raise InvalidRequest("via", f"are {len(via)}, may be {MAX_VIA} at most")
    for at, each in enumerate(via):
        for name, value, most in (("fraction", each.fraction, 1.0), ("std", each.std, FARTHEST_M)):
            if not 0.0 < value < most:
                detail = f"must lie between 0 and {most:g}, neither included, is {value:g}"
                raise InvalidRequest(f"via.{at}.{name}", detail)
    points = [_point(f"via.{at}.position", each.position) for at, each in enumerate(via)]
    fractions, stds = (np.array([getattr(each, name) for each in via]) for name in ("fraction", "std"))
    return fractions, (np.reshape(points, (-1, 3)) - start) @ alignment(start, goal).T, stds


def _shape_notices(chain: ActionModel) -> Iterator[Notice]:
    """Yield a notice where the demonstrations do not say what the shape hangs on."""
    if not primitive_of(chain).hangs_on:
        n_shown, action = chain.n_demonstrations, chain.action
        detail = f"{n_shown} demonstrations of {action} do not show what its shape hangs on: it is their mean"
        yield Notice("mean_shape", detail)


def _point(name: str, value: ArrayLike) -> Floats:
    try:
        point = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidRequest(name, "must be three numbers") from error
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InvalidRequest(name, "must be three finite numbers")
    if np.abs(point).max() > FARTHEST_M:
        raise InvalidRequest(name, f"lies over {FARTHEST_M:g} m away: a wrong length unit?")
    return point
