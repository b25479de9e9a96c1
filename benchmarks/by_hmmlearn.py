"""The log-likelihood ratios of the core, written with hmmlearn: what anybody would write first."""

from __future__ import annotations

import numpy as np
from hmmlearn.hmm import GaussianHMM
from numpy.typing import NDArray

from app.motion.features import encode
from app.motion.model import ActionModel, Background, Model
from app.motion.trajectory import Floats

Indices = NDArray[np.int64]


class Chain(GaussianHMM):  # type: ignore[misc]
    """An action model as hmmlearn knows it; a path ends by leaving its last state.

    What is left of the last state's transitions leads to one more state, which explains nothing.
    """

    def __init__(self, action: ActionModel) -> None:
        super().__init__(action.n_states + 1, "diag", init_params="")
        self.startprob_ = np.eye(action.n_states + 1)[0]
        self.transmat_ = np.diag([*action.stay, 1.0]) + np.diag(1.0 - action.stay, 1)
        self.means_ = np.pad(action.means, ((0, 1), (0, 0)))
        self.covars_ = np.pad(action.variances, ((0, 1), (0, 0)), constant_values=1.0)
        self.leaving = float(np.log1p(-action.stay[-1]))

    def _compute_log_likelihood(self, features: Floats) -> Floats:
        log_densities: Floats = super()._compute_log_likelihood(features)
        log_densities[:, -1] = -np.inf
        log_densities[-1, :-2] = -np.inf
        return log_densities


class Ratios:
    """``ratios(segments)`` for ``app.motion.search.Search``: one ``decode`` per segment and class.

    hand: (n_frames, 3) [m]; objects: (n_objects, n_frames, 3) [m]; table_height [m].
    """

    def __init__(self, model: Model, hand: Floats, objects: Floats, table_height: float) -> None:
        self._chains = [Chain(action) for action in model.actions]
        self._background = model.background
        self._hand, self._objects, self._table_height = hand, objects, table_height

    def __call__(self, segments: Indices) -> Floats:
        """Return (n_segments, n_classes) log-likelihood ratios to the background [nat]."""
        return np.array([self._of_segment(start, goal) for start, goal in segments.tolist()])

    def _of_segment(self, start: int, goal: int) -> list[float]:
        part = slice(start, goal + 1)
        features = encode(self._hand[part], self._objects[:, part], self._table_height)
        nothing = _background(features, self._background)
        return [chain.decode(features)[0] + chain.leaving - nothing for chain in self._chains]


def _background(features: Floats, background: Background) -> float:
    z = (features - background.location) / background.scale
    return -float(np.log(np.pi * background.scale * (1.0 + z * z)).sum())
