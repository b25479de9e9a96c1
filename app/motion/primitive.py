"""A movement primitive: an action model made ready to generate.

A demonstration is remembered as its *task*, where it went in how much time, and its shape. The shape for a
new task is predicted from those by Gaussian process regression with three parts: a constant, the mean shape
of the class, which reaches everywhere; a part that falls off with the difference of tasks; and what is left
to chance. What of a task the shape hangs on, and whether it grows with the length of the movement, is chosen
by leaving each demonstration out in turn; where that shows nothing, the mean shape is all there is, and it
is what remains of the prediction far from everything demonstrated.

What is left to chance has a covariance, estimated from the same residuals, each in units of what the
regression itself makes of its doubt: so doubt grows with the distance to the demonstrations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import NamedTuple, Self

import numpy as np

from app.motion.model import N_COEFFICIENTS, ActionModel
from app.motion.trajectory import Floats

CONSTANT = np.array([2.0, 0.5, 2.0])
"""Variance of the mean shape along each aligned axis, in that of the part that hangs on the task.

To which side a path swerves differs between people more than how high it arches: of the second axis less is
taken for granted."""

CHANCE = 2.0
"""Variance of what is left to chance, likewise: twice as much as what the task says."""

REACH = {"length": 0.5, "rise": 0.5, "tempo": 0.5, "ahead": 0.7, "aside": 0.7}
"""By how much two tasks differ where one says little of the other: logarithms of lengths and durations, the
angle of ascent [rad], components of the direction."""

CHOICES: tuple[tuple[str, ...], ...] = (
    (),
    ("length", "rise"),
    ("length", "rise", "tempo"),
    ("length", "rise", "tempo", "ahead", "aside"),
)
"""What the shape may hang on."""

GROWTHS = (0.0, 0.5, 1.0)
"""Powers of the length that shapes may grow with."""

STRENGTHS = {1.0: 0.97, 8.0: 0.8}
"""Variances of the part of a shape that hangs on the task, in those of CONSTANT, and the share of the squared
error of something simpler that a choice with it may leave at most."""

MOST = 300
"""Demonstrations that are compared; of more, so many are taken at regular intervals."""

SMOOTH = 1.5
"""Over how many neighbouring coefficients chance is taken to be alike before there is evidence."""

LEAST_STD = 2e-4
"""Of each coefficient [m]: nobody repeats a movement better."""

KEPT = 256


@dataclass(frozen=True, eq=False)
class Primitive:
    """Everything of an action model that does not hang on where a movement shall go.

    hangs_on: what of a task the shape hangs on; growth: the power of the length that it grows with; tempos:
    extremes of the logarithms of durations [s]; regression: of the shapes where they do not grow;
    covariances: (3, N_COEFFICIENTS, N_COEFFICIENTS) of what is left to chance there [m^2].
    """

    hangs_on: tuple[str, ...]
    growth: float
    tempos: tuple[float, float]
    regression: _Regression
    covariances: Floats

    def shape(self, way: Floats, duration: float) -> tuple[Floats, Floats]:
        """Return the mean (3, N_COEFFICIENTS) [m] and the covariances [m^2] of the shape for a task.

        way: (3,) from start to goal [m]; duration [s], as far as it is not beyond those demonstrated.
        """
        tempo = np.clip(np.log(duration), *self.tempos)
        mean, doubt = self.regression.predict(_tasks(way[None], tempo[None], self.hangs_on))
        size = float(np.linalg.norm(way)) ** self.growth
        return size * mean, size**2 * doubt[:, None, None] * self.covariances


@lru_cache(KEPT)
def primitive_of(action: ActionModel) -> Primitive:
    """Return the primitive of an action model, made once."""
    taken = np.unique(np.linspace(0, action.n_demonstrations - 1, MOST).round().astype(int))
    ways, tempos = action.ways[taken], np.log(action.durations[taken])
    shapes = action.shapes[taken].reshape(len(taken), 3, N_COEFFICIENTS).transpose(1, 0, 2)
    choices = [
        _Choice.of(hangs_on, growth, strength, ways, tempos, shapes)
        for strength, hangs_on, growth in product(STRENGTHS, CHOICES, GROWTHS)
    ]
    chosen = choices[0]
    for choice in choices:
        if choice.error < STRENGTHS[choice.regression.strength] * chosen.error:
            chosen = choice
    covariances = np.stack([_covariance(missed) for missed in chosen.regression.surprises])
    return Primitive(
        chosen.hangs_on, chosen.growth, (tempos.min(), tempos.max()), chosen.regression, covariances
    )


class _Choice(NamedTuple):
    """What a shape may hang on, and the squared error that it leaves where it does."""

    hangs_on: tuple[str, ...]
    growth: float
    regression: _Regression
    error: float

    @classmethod
    def of(
        cls,
        hangs_on: tuple[str, ...],
        growth: float,
        strength: float,
        ways: Floats,
        tempos: Floats,
        shapes: Floats,
    ) -> Self:
        """Return the choice, tried on ways (n, 3), tempos (n,) and shapes (3, n, N_COEFFICIENTS)."""
        sizes = np.linalg.norm(ways, axis=1)[:, None] ** growth
        regression = _Regression.of(_tasks(ways, tempos, hangs_on), shapes / sizes, strength)
        return cls(hangs_on, growth, regression, float(np.sum((sizes * regression.missed) ** 2)))


def _tasks(ways: Floats, tempos: Floats, hangs_on: Sequence[str]) -> Floats:
    """Return (n, len(hangs_on)) what shapes may hang on, in units of REACH; ways: (n, 3); tempos: (n,)."""
    level = np.hypot(ways[:, 0], ways[:, 1])
    length = np.hypot(level, ways[:, 2])
    all_there_is = {
        "length": np.log(length),
        "rise": np.arctan2(ways[:, 2], level),
        "tempo": tempos,
        "ahead": ways[:, 0] / length,
        "aside": ways[:, 1] / length,
    }
    columns = [all_there_is[name] / REACH[name] for name in hangs_on]
    return np.column_stack(columns) if columns else np.empty((len(ways), 0))


@dataclass(frozen=True, eq=False)
class _Regression:
    """Gaussian process regression of shapes on tasks, one for each aligned axis.

    strength: of STRENGTHS; tasks: (n, n_columns); inverses: (3, n, n) of the kernel matrices; weights:
    (3, n, N_COEFFICIENTS).
    """

    strength: float
    tasks: Floats
    inverses: Floats
    weights: Floats

    @classmethod
    def of(cls, tasks: Floats, shapes: Floats, strength: float) -> Self:
        """Return the regression of shapes (3, n, N_COEFFICIENTS)."""
        known = CONSTANT[:, None, None] + strength * _likeness(tasks, tasks)
        noisy = known + CHANCE * np.eye(len(tasks))
        inverses = np.asarray(np.linalg.inv(noisy), dtype=np.float64)
        return cls(strength, tasks, inverses, inverses @ shapes)

    def predict(self, task: Floats) -> tuple[Floats, Floats]:
        """Return the mean (3, N_COEFFICIENTS) for a task (1, n_columns), and its variance (3,) in CHANCE."""
        near = CONSTANT[:, None] + self.strength * _likeness(task, self.tasks)
        itself = CONSTANT + self.strength * _likeness(task, task)[0]
        row = near[:, None, :]
        known = (row @ self.inverses @ near[:, :, None])[:, 0, 0]
        return (row @ self.weights)[:, 0], 1.0 + (itself - known) / CHANCE

    @property
    def missed(self) -> Floats:
        """(3, n, N_COEFFICIENTS): each shape less what all others predict (Rasmussen and Williams, 5.12)."""
        return self.weights / self._precisions

    @property
    def surprises(self) -> Floats:
        """The same in units of the standard deviation that was predicted."""
        return self.weights / np.sqrt(self._precisions / CHANCE)

    @property
    def _precisions(self) -> Floats:
        return np.diagonal(self.inverses, axis1=1, axis2=2)[:, :, None]


def _likeness(tasks: Floats, others: Floats) -> Floats:
    """Return (n, n_others) how much tasks say of others, 0..1: all where shapes hang on nothing."""
    likeness: Floats = np.exp(-0.5 * np.sum((tasks[:, None] - others[None]) ** 2, axis=2))
    return likeness


def _covariance(surprises: Floats) -> Floats:
    """Return the (N_COEFFICIENTS, N_COEFFICIENTS) covariance of what was missed, (n, N_COEFFICIENTS).

    It is shrunk towards one of neighbours that are alike, as if as many demonstrations as there are
    coefficients had shown that.
    """
    n = len(surprises)
    at = np.arange(N_COEFFICIENTS)
    alike = np.exp(-0.5 * ((at[:, None] - at) / SMOOTH) ** 2)
    sampled = surprises.T @ surprises / n
    std = np.sqrt(np.diag(sampled) + LEAST_STD**2)
    expected = alike * np.outer(std, std)
    covariance: Floats = (n * sampled + N_COEFFICIENTS * expected) / (n + N_COEFFICIENTS)
    return covariance
