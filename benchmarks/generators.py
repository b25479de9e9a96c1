"""The methods of generation that are compared, all taught by the same movements of one class.

DMP and ProMP are those of ``movement_primitives``. Each is given twice: in the world, as the library has
it, and *aligned*, in our frame of start and goal, which frees it of place and direction. What they leave
open was chosen by what brought them closest to the test movements, all data together, which favours them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from movement_primitives.dmp import DMP
from movement_primitives.promp import ProMP

from app.motion.asked import Method
from app.motion.features import alignment
from app.motion.generation import generate
from app.motion.model import Model
from app.motion.shape import progress
from app.motion.trajectory import Demonstration, Floats
from benchmarks.likeness import N_PHASES, at_phases

OURS = "ours"
AS_THEY_ARE = ("DMP", "ProMP", "the paper's", "minimum-jerk line")
AT_THEIR_BEST = ("DMP, smooth", "DMP, aligned", "ProMP, least squares", "ProMP, aligned")
PEERS = (*AS_THEY_ARE, *AT_THEIR_BEST)
"""Those asked about, and what can be made of them with knowledge of the test."""

N_OF_DMP, N_OF_PROMP = 20, 15
"""Basis functions in each dimension."""

SPREAD = 1e-4
"""Added to the variance of every weight of a ProMP: a few demonstrations span too little [m^2]."""

EXACT = 1e-10
"""Variance of the end points on which a ProMP is conditioned; with none it is singular [m^2]."""


class Generated(NamedTuple):
    """Positions (n, 3) [m] at regular intervals and, if the method knows it, their standard deviation."""

    positions: Floats
    std: Floats | None = None


class Generate(Protocol):
    """A method that has learned a class."""

    def __call__(
        self, start: Floats, goal: Floats, duration: float, n_points: int = N_PHASES, /
    ) -> Generated:
        """Return a movement from start to goal, (3,) each [m], that takes so long [s]."""


@dataclass(frozen=True)
class Core:
    """Ours: the core, as it is if nothing else is asked for, or by the paper's plain method."""

    model: Model
    action: str
    method: Method = "default"

    def __call__(self, start: Floats, goal: Floats, duration: float, n_points: int = N_PHASES) -> Generated:
        """Return what the core generates."""
        rate = (n_points - 1) / duration
        motion = generate(
            self.model, self.action, start, goal, rate=rate, duration=duration, method=self.method
        )
        return Generated(motion.positions, motion.std)


def minimum_jerk_line(start: Floats, goal: Floats, _duration: float, n_points: int = N_PHASES) -> Generated:
    """Return the straight minimum-jerk movement, which has learned nothing."""
    share = progress(np.linspace(0.0, 1.0, n_points))[:, None]
    return Generated(start + share * (goal - start))


class Dynamic:
    """A dynamic movement primitive: the mean of the demonstrations, (n_phases, 3) each [m].

    smooth: it scales after Pastor et al. (2009), and so does not leave the start with a jerk. As the library
    has it, it runs a step ahead of its phase; steps ten times finer take ten times as long and bring it 0-4 %
    closer.
    """

    def __init__(self, shown: Sequence[Floats], smooth: bool) -> None:
        self._primitive = DMP(n_dims=3, n_weights_per_dim=N_OF_DMP, smooth_scaling=smooth)
        self._primitive.imitate(np.linspace(0.0, 1.0, len(shown[0])), np.mean(shown, axis=0))

    def __call__(self, start: Floats, goal: Floats, duration: float, n_points: int = N_PHASES) -> Generated:
        """Return the movement; it runs half a step short, or rounding may give it a point too many."""
        primitive, step = self._primitive, duration / (n_points - 1)
        primitive.execution_time_, primitive.dt_ = duration, step
        primitive.configure(start_y=start, goal_y=goal)
        return Generated(primitive.open_loop(run_t=duration - step / 2)[1])


class Probabilistic:
    """A probabilistic movement primitive of demonstrations, (n_phases, 3) each [m].

    By the library's expectation maximisation, or with weights that are distributed as those of the
    demonstrations by least squares, which does better, in the world by far.
    """

    def __init__(self, shown: Sequence[Floats], least_squares: bool, tells_std: bool = True) -> None:
        self._primitive, self._tells_std = ProMP(n_dims=3, n_weights_per_dim=N_OF_PROMP), tells_std
        phase = np.linspace(0.0, 1.0, len(shown[0]))
        if not least_squares:
            self._primitive.imitate([phase] * len(shown), list(shown))
            return
        weights = np.array([self._primitive.weights(phase, each) for each in shown])
        spread = np.cov(weights, rowvar=False) + SPREAD * np.eye(weights.shape[1])
        self._primitive.from_weight_distribution(weights.mean(axis=0), spread)

    def __call__(self, start: Floats, goal: Floats, _duration: float, n_points: int = N_PHASES) -> Generated:
        """Return the mean, given that it starts and ends there, and the standard deviation if it tells it."""
        exact, phase = EXACT * np.eye(3), np.linspace(0.0, 1.0, n_points)
        begun = self._primitive.condition_position(start, exact, t=0.0)
        bound = begun.condition_position(goal, exact, t=1.0)
        std = np.sqrt(bound.var_trajectory(phase)) if self._tells_std else None
        return Generated(bound.mean_trajectory(phase), std)


@dataclass(frozen=True)
class Aligned:
    """Another method in the aligned frame."""

    of: Generate

    def __call__(self, start: Floats, goal: Floats, duration: float, n_points: int = N_PHASES) -> Generated:
        """Return what the other makes of a movement from the origin along the first axis, laid back."""
        rotation = alignment(start, goal)
        made = self.of(np.zeros(3), rotation @ (goal - start), duration, n_points)
        std = None if made.std is None else np.sqrt(made.std**2 @ rotation**2)
        return Generated(start + made.positions @ rotation, std)


def shown_of(action: str, demonstrations: Sequence[Demonstration]) -> list[Floats]:
    """Return (N_PHASES, 3) positions of each demonstration of a class [m]."""
    return [at_phases(each.trajectory) for each in demonstrations if each.action == action]


def align(positions: Floats) -> Floats:
    """Return a movement, (n, 3), in the frame of its own start and goal [m]."""
    aligned: Floats = (positions - positions[0]) @ alignment(positions[0], positions[-1]).T
    return aligned


def teach(action: str, demonstrations: Sequence[Demonstration], model: Model) -> dict[str, Generate]:
    """Return every method by name, taught one class; model: of the same demonstrations."""
    shown = shown_of(action, demonstrations)
    aligned = [align(each) for each in shown]
    return {
        OURS: Core(model, action),
        "DMP": Dynamic(shown, smooth=False),
        "DMP, smooth": Dynamic(shown, smooth=True),
        "DMP, aligned": Aligned(Dynamic(aligned, smooth=True)),
        "ProMP": Probabilistic(shown, least_squares=False),
        "ProMP, least squares": Probabilistic(shown, least_squares=True),
        "ProMP, aligned": Aligned(Probabilistic(aligned, least_squares=True)),
        "the paper's": Core(model, action, "paper"),
        "minimum-jerk line": minimum_jerk_line,
    }
