"""Competitive spotting by a garbage model (reference [5] of the paper).

After M. Elmezain, A. Al-Hamadi and B. Michaelis, *Hand trajectory-based gesture spotting and recognition
using HMM*, ICIP 2009. The direction of the hand's motion is quantised; each class is a discrete left-right
HMM. The garbage model has the states of all classes with what they emit and how long they stay, each leading
to all others alike. In a window that slides over the stream the log-likelihood of the best class less that
of the garbage model is the *differential*: an action starts when it becomes positive, ends when it becomes
negative, and is of the class that has been likeliest since its start.

The original's directions are of the plane; here they are those of space to the 26 neighbours of a cube, and
one more symbol says that the hand stands still.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from hmmlearn.hmm import CategoricalHMM
from numpy.typing import NDArray
from scipy.linalg import block_diag

from app.motion.evaluation import evaluate
from app.motion.trajectory import Demonstration, Floats, Segment, Trajectory
from benchmarks.joined_hmm import FEW, left_right
from benchmarks.points import RATE, Span, points, streams

N_STATES = 6
"""Of each class."""

N_ITERATIONS = 10
"""Of Baum-Welch."""

WINDOWS = (8, 12, 16, 24, 32, 48, 64)
"""Lengths of the sliding window that are tried on the demonstrations [points]."""

STILL = 0.05
"""A slower hand stands still [m/s]."""

RARE = 0.01
"""Least probability of a symbol in a state; it and N_STATES are chosen in favour of this method."""

Symbols = NDArray[np.int64]


def _codebook() -> Floats:
    """Return the (26, 3) unit vectors to the neighbours of a cube."""
    cells = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    ways = cells[np.any(cells != 0.0, axis=1)]
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))


CODEBOOK = _codebook()
N_SYMBOLS = len(CODEBOOK) + 1


def symbols(velocities: Floats) -> Symbols:
    """Return the (n_points,) directions of the hand's motion, as numbers in CODEBOOK or the one for still.

    velocities: (n_points, n_tracks, 3), the hand's first [m/s].
    """
    velocity = velocities[:, 0]
    moving = np.linalg.norm(velocity, axis=1) >= STILL
    return np.where(moving, (velocity @ CODEBOOK.T).argmax(axis=1), len(CODEBOOK))


class GarbageModel:
    """Recognises by the differential between the classes and the garbage model.

    The last of the competitors is the garbage model. start: (n_states,) of all competitors, each summing to
    1; transitions: (n_states, n_states), from one competitor to another there are none; emissions:
    (n_states, N_SYMBOLS).
    """

    def __init__(self, demonstrations: Sequence[Demonstration]) -> None:
        self._names = sorted({each.action for each in demonstrations})
        shown = [
            [
                symbols(points(each.trajectory, ()).velocities)
                for each in demonstrations
                if each.action == name
            ]
            for name in self._names
        ]
        chains = [_chain(sequences) for sequences in shown]
        garbage = _ergodic(chains)
        first, anywhere = np.eye(N_STATES)[0], np.full(len(garbage.emissions), 1.0 / len(garbage.emissions))
        self._start = np.concatenate([*[first] * len(chains), anywhere])
        self._transitions = block_diag(*(each.transitions for each in (*chains, garbage)))
        self._emissions = np.concatenate([each.emissions for each in (*chains, garbage)])
        self._first = np.arange(len(chains) + 1) * N_STATES
        self._window = self._best_window(demonstrations)

    def __call__(self, trajectory: Trajectory) -> list[Segment]:
        """Return what is spotted from start to end of a recording."""
        seen = points(trajectory, ())
        return seen.segments(self._spot(symbols(seen.velocities), self._window))

    def _best_window(self, demonstrations: Sequence[Demonstration]) -> int:
        """Return the length of window that spots joined demonstrations best."""
        joined = [(symbols(each.velocities), each.truth) for each in streams(demonstrations, ())]

        def f1(window: int) -> float:
            found = [
                (
                    np.arange(len(motion)) / RATE,
                    truth,
                    [Segment(*span) for span in self._spot(motion, window)],
                )
                for motion, truth in joined
            ]
            return evaluate(found).f1_50 or 0.0

        return max(WINDOWS, key=f1)

    def _spot(self, motion: Symbols, window: int) -> list[Span]:
        found: list[Span] = []
        starts = np.flatnonzero(self._openings(motion, window) > 0.0)
        at = 0
        while len(later := starts[starts >= at]):
            start = int(later[0])
            end, best = self._follow(motion, start, window)
            if end - start >= window:
                found.append((start, end, self._names[best]))
            at = max(end, start + 1)
        return found

    def _openings(self, motion: Symbols, window: int) -> Floats:
        """Return the (n_windows,) differentials of windows in which an action would start [nat]."""
        if len(motion) < window:
            return np.zeros(0)
        windows = np.lib.stride_tricks.sliding_window_view(motion, window)
        forward = self._start * self._emissions[:, windows[:, 0]].T
        for step in range(1, window):
            forward = (forward @ self._transitions) * self._emissions[:, windows[:, step]].T
        likelihoods = np.log(np.add.reduceat(forward, self._first, axis=1))
        return np.asarray(likelihoods[:, :-1].max(axis=1) - likelihoods[:, -1])

    def _follow(self, motion: Symbols, start: int, window: int) -> tuple[int, int]:
        """Return where the action that starts there ends, and which class it is."""
        forward, total = self._start, np.zeros((len(motion) - start + 1, len(self._first)))
        sizes = np.diff(np.append(self._first, len(self._start)))
        best = 0
        for at, symbol in enumerate(motion[start:].tolist(), 1):
            forward = (forward if at == 1 else forward @ self._transitions) * self._emissions[:, symbol]
            shares = np.add.reduceat(forward, self._first)
            total[at] = total[at - 1] + np.log(shares)
            forward = forward / np.repeat(shares, sizes)
            best = int(total[at, :-1].argmax())
            if (
                at > window
                and total[at, best] - total[at - window, best] < total[at, -1] - total[at - window, -1]
            ):
                return start + at - window // 2, best
        return len(motion), best


class Chain(NamedTuple):
    """A discrete left-right HMM; transitions: (n_states, n_states), what is left of the last row leads out.

    emissions: (n_states, N_SYMBOLS).
    """

    transitions: Floats
    emissions: Floats


def _chain(sequences: Sequence[Symbols]) -> Chain:
    """Return the discrete left-right HMM of one class, trained with Baum-Welch.

    Each sequence is followed by one more symbol of one more state, to which only the last state leads.
    """
    marked = [np.append(sequence, N_SYMBOLS) for sequence in sequences]
    parts = [
        np.concatenate(part)
        for part in zip(*(np.array_split(each, N_STATES) for each in sequences), strict=True)
    ]
    counts = np.zeros((N_STATES + 1, N_SYMBOLS + 1))
    counts[:-1, :-1] = _probabilities(np.array([np.bincount(part, minlength=N_SYMBOLS) for part in parts]))
    counts[-1, -1] = 1.0
    hmm = CategoricalHMM(
        N_STATES + 1,
        init_params="",
        params="te",
        n_iter=N_ITERATIONS,
        n_features=N_SYMBOLS + 1,
        transmat_prior=FEW,
    )
    hmm.startprob_ = np.eye(N_STATES + 1)[0]
    hmm.transmat_ = left_right([len(part) / len(sequences) for part in parts])
    hmm.emissionprob_ = counts
    hmm.fit(np.concatenate(marked)[:, None], [len(each) for each in marked])
    return Chain(hmm.transmat_[:-1, :-1], _probabilities(hmm.emissionprob_[:-1, :-1]))


def _probabilities(counts: Floats) -> Floats:
    shares = np.maximum(counts / counts.sum(axis=1, keepdims=True), RARE)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def _ergodic(chains: Sequence[Chain]) -> Chain:
    """Return the garbage model: all states, from each to all others alike."""
    staying = np.concatenate([np.diagonal(chain.transitions) for chain in chains])
    n_states = len(staying)
    others = (1.0 - staying)[:, None] / (n_states - 1)
    transitions = np.diag(staying) + others * (1.0 - np.eye(n_states))
    return Chain(transitions, np.concatenate([chain.emissions for chain in chains]))
