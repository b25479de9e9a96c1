"""What a frame costs: against plain numba and the paper's steps, with many classes, for an hour."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from scipy.ndimage import gaussian_filter1d

from app.motion import window
from app.motion.model import FeatureSpecification, Model
from app.motion.recogniser import Method, Recogniser, SegmentEvent
from app.motion.resampling import stack
from app.motion.simulation import RATE, Conditions, demonstrations, recording
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration, Floats, Trajectory
from benchmarks import page, plots
from benchmarks.by_numba import NumbaCriterion

TRAINING_SEED, SEED = 0, 1
N_ACTIONS, N_PAUSED, ABOUT_S = 40, 15, 40.0
PAUSES = (0.5, 3.0)
OF_CLASSES, OF_OBJECTS = (4, 8, 16, 32, 64), (1, 2, 4, 8)
N_STATES = 8
ASIDE = 0.15
"""Further classes swerve by up to so much more [m]."""
REPETITIONS = 5
PLAIN_FRAMES = 1500
MOST_US, OF_STEPS, OF_MOST = 100.0, 3.0, 8.0
HOUR_S, TIMES_REAL = 3600.0, 150.0

IMAGE = "images/speed-frame.svg"

TEXT = """\
A model of {classes} classes and one object, trained on the simulated demonstrations of the paper's
protocol; frames at {rate:g} Hz, one at a time, `Recogniser.take`: everything from the position to the
event, the time of the thread. *Plain numba* is the same recogniser with the criterion as one would write it
with numba first, one segment and class after the other (`benchmarks/by_numba.py`), on the first {plain}
frames; it finds the same segments. *Steps 1-3* is the paper's search on the same features and kernels. Mean
over the motion, median of {n} runs in turn."""

GROWTH = """\
The mean cost of a frame of the actions, {n_states} states a class: with more classes, made of the four by
swerves of their own of up to {aside:g} m; with more objects, of which any may be the one that the model
knows."""

HOUR = """\
{seconds:.0f} s of simulated actions at {rate:g} Hz in parts of {part} frames, on one core, as a
segmentation runs it."""


@dataclass(frozen=True)
class Motion:
    """Frames (n,), (n, n_tracks, 3) as the recogniser takes them."""

    times: Floats
    positions: Floats

    def part(self, n_frames: int) -> Motion:
        """Return the first frames."""
        return Motion(self.times[:n_frames], self.positions[:n_frames])


def _motion(of: Trajectory) -> Motion:
    return Motion(of.times, stack(of, tuple(of.objects)))


def motions() -> dict[str, Motion]:
    """Return what is recognised."""
    about = np.random.default_rng(SEED).normal(size=(int(ABOUT_S * RATE), 3))
    way = gaussian_filter1d(about, RATE / 4.0, axis=0)
    hand = 0.15 * way / way.std() + [0.4, 0.0, 0.2]
    cup = np.tile([0.4, 0.1, 0.05], (len(hand), 1))
    return {
        "actions": _motion(recording(SEED, N_ACTIONS).trajectory),
        "actions with pauses": _motion(recording(SEED, N_PAUSED, Conditions(rest=PAUSES)).trajectory),
        "moving about": Motion(np.arange(len(hand)) / RATE, np.stack([hand, cup], axis=1)),
    }


def _model(n_classes: int, options: TrainingOptions) -> Model:
    """Return a model of so many classes, the simulator's and swerving ones like them."""
    rng, shown = np.random.default_rng(SEED), list(demonstrations(TRAINING_SEED))
    for number in range(1, n_classes // 4):
        aside = {action: rng.uniform(-ASIDE, ASIDE, 3) for action in {each.action for each in shown}}
        shown += [_swerving(each, number, aside[each.action]) for each in demonstrations(TRAINING_SEED)]
    return fit_model(shown, FeatureSpecification(("object",)), options)


def _swerving(shown: Demonstration, number: int, aside: Floats) -> Demonstration:
    motion = shown.trajectory
    bump = np.sin(np.pi * np.linspace(0.0, 1.0, len(motion)))[:, None] * aside
    moved = {name: track + bump for name, track in motion.objects.items()}
    return replace(
        shown,
        action=f"{shown.action}-{number}",
        trajectory=Trajectory(motion.times, motion.hand + bump, moved),
    )


def cost(
    model: Model,
    motion: Motion,
    method: Method = "viterbi",
    objects: tuple[str, ...] | None = None,
    chunk: int = 1,
) -> tuple[float, list[tuple[int, int, str | None]]]:
    """Return what a frame costs [us] and what is found."""
    recogniser, events = Recogniser(model, method=method, objects=objects), []
    begin = time.thread_time()
    for at in range(0, len(motion.times), chunk):
        events += recogniser.take(motion.times[at : at + chunk], motion.positions[at : at + chunk])
    events += recogniser.finish()
    spent = (time.thread_time() - begin) / len(motion.times) * 1e6
    return spent, [(each.start, each.end, each.action) for each in events if isinstance(each, SegmentEvent)]


def _middle(runs: Sequence[float]) -> float:
    return float(np.median(runs))


def costs(model: Model, motion: Motion) -> list[float]:
    """Return the cost of a frame [us]: ours, ours and plain numba on the first frames, Steps 1-3, greedy."""
    runs = []
    for _ in range(REPETITIONS):
        short = motion.part(PLAIN_FRAMES)
        ours, found = cost(model, short)
        with patch.object(window, "Criterion", NumbaCriterion):
            plain, others = cost(model, short)
        if found != others:
            raise RuntimeError("plain numba finds other segments")
        runs.append([cost(model, motion)[0], ours, plain, *(cost(model, motion, of)[0] for of in _PAPERS)])
    return [_middle(column) for column in np.array(runs).T]


_PAPERS: tuple[Method, ...] = ("steps", "greedy")


def section(images: Path | None) -> tuple[str, list[page.Goal]]:
    """Return the sections on frames, growth and an hour, and whether what is asked for is met."""
    model = _model(4, TrainingOptions())
    frames, goals = _frames(model)
    hour, more = _hour(model)
    growth, most = _growth(images)
    return "\n".join([frames, growth, hour]), [*goals, *most, *more]


def _frames(model: Model) -> tuple[str, list[page.Goal]]:
    rows, worst, against = [], 0.0, 0.0
    for title, motion in motions().items():
        page.tell(title)
        ours, ours_first, plain, steps, greedy = costs(model, motion)
        figures = [f"{value:.0f}" for value in (ours, ours_first, plain, steps, greedy)]
        rows.append([title, str(len(motion.times)), *figures, f"{plain / ours_first:.1f}"])
        worst, against = max(worst, ours), max(against, ours / steps)
    text = TEXT.format(classes=4, rate=RATE, plain=PLAIN_FRAMES, n=REPETITIONS)
    names = ["motion", "frames", "ours", "the first", "plain numba", "Steps 1-3", "greedy", "plain / ours"]
    goals = [
        page.Goal(
            f"≤ {MOST_US:g} us a frame, exact, everything included", f"{worst:.0f} us", worst <= MOST_US
        ),
        page.Goal(f"≤ {OF_STEPS:g} times Steps 1-3", f"{against:.2f}", against <= OF_STEPS),
    ]
    return f"## Cost of a frame [us]\n\n{text}\n\n{page.table(names, rows)}", goals


def _growth(images: Path | None) -> tuple[str, list[page.Goal]]:
    motion = motions()["actions"]
    models = [_model(n, TrainingOptions(n_states=N_STATES)) for n in OF_CLASSES]
    by_classes = [_middle([cost(model, motion)[0] for _ in range(REPETITIONS)]) for model in models]
    by_objects = []
    for n in OF_OBJECTS:
        page.tell(f"{n} objects")
        among, names = _among(motion, n), tuple(f"thing-{index}" for index in range(n))
        runs = [cost(models[0], among, objects=names)[0] for _ in range(REPETITIONS)]
        by_objects.append(_middle(runs))
    rows = [
        [f"{n} classes", f"{of:.0f}", f"{of / by_classes[0]:.2f}"]
        for n, of in zip(OF_CLASSES, by_classes, strict=True)
    ]
    rows += [
        [f"{n} objects", f"{of:.0f}", f"{of / by_objects[0]:.2f}"]
        for n, of in zip(OF_OBJECTS, by_objects, strict=True)
    ]
    if images is not None:
        plots.curves(
            {"classes": (OF_CLASSES, by_classes), "objects": (OF_OBJECTS, by_objects)},
            "classes, objects",
            "cost of a frame [us]",
            images / IMAGE,
            logarithmic=True,
        )
    times = by_classes[-1] / by_classes[0]
    goals = [
        page.Goal(
            f"{OF_CLASSES[-1]} classes ≤ {OF_MOST:g} times the cost of {OF_CLASSES[0]}",
            f"{times:.1f}",
            times <= OF_MOST,
        )
    ]
    text = GROWTH.format(n_states=N_STATES, aside=ASIDE)
    table = page.table(["", "us a frame", "times the first"], rows)
    return f"## Growth\n\n{text}\n\n{table}\n![How a frame grows]({IMAGE})\n", goals


def _among(motion: Motion, n_objects: int) -> Motion:
    """Return the motion with more objects that lie about, the one that is handled the last."""
    away = np.random.default_rng(SEED).uniform([0.0, -0.5, -0.5], [1.0, 0.5, 0.5], (n_objects - 1, 1, 3))
    lying = [np.broadcast_to(place, (len(motion.times), 3)) for place in away]
    return Motion(motion.times, np.stack([motion.positions[:, 0], *lying, motion.positions[:, 1]], axis=1))


def _hour(model: Model) -> tuple[str, list[page.Goal]]:
    part = 3000
    once = recording(SEED, int(HOUR_S / 0.8)).trajectory
    n_frames = min(int(HOUR_S * RATE), len(once))
    motion = _motion(once).part(n_frames)
    spent = _middle([cost(model, motion, chunk=part)[0] for _ in range(3)])
    times = 1e6 / RATE / spent
    rows = [[f"{n_frames / RATE:.0f}", f"{spent * n_frames / 1e6:.1f}", f"{times:.0f}"]]
    table = page.table(["of motion [s]", "takes [s]", "times faster than real time"], rows, n_words=0)
    goals = [
        page.Goal(
            f"an hour ≥ {TIMES_REAL:g} times faster than real time", f"{times:.0f}", times >= TIMES_REAL
        )
    ]
    return f"## An hour\n\n{HOUR.format(seconds=n_frames / RATE, rate=RATE, part=part)}\n\n{table}", goals
