"""Change points, then classes: boundaries where the directions of hand and objects change.

Optimal piecewise constant approximation with a penalty per change (Killick, Fearnhead and Eckley, JASA 2012,
PELT; C. Truong, L. Oudre and N. Vayatis, Signal Processing 2020, ``ruptures``). Each piece is of the class
that the criterion of our models finds best, and no action where the criterion prefers rest.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import ruptures
from ruptures.metrics import precision_recall

from app.motion.conditioning import condition
from app.motion.criterion import Criterion
from app.motion.evaluation import TOLERANCE
from app.motion.model import Model
from app.motion.resampling import resample, stack
from app.motion.roles import fillings
from app.motion.trajectory import Demonstration, Floats, Segment, Trajectory
from benchmarks.points import RATE, points, streams

SLOW = 0.05
"""Speed below which a direction shrinks to nothing [m/s]."""

PENALTIES = np.geomspace(0.5, 100.0, 24)
"""Penalties that are tried on joined demonstrations."""

SHORTEST = round(0.2 * RATE)
"""Of a piece [points]."""


class ChangePoints:
    """Recognises by change points and a model's criterion."""

    def __init__(self, demonstrations: Sequence[Demonstration], model: Model) -> None:
        self._model, self._roles = model, model.features.objects
        joined = streams(demonstrations, self._roles)

        def f1(penalty: float) -> float:
            pairs = [
                precision_recall(
                    [each.end for each in stream.truth],
                    changes(stream.velocities, penalty),
                    margin=round(TOLERANCE * RATE) + 1,
                )
                for stream in joined
            ]
            precision, recall = np.mean(pairs, axis=0)
            return float(2.0 * precision * recall / max(precision + recall, 1e-9))

        self.penalty = max(PENALTIES.tolist(), key=f1)

    def __call__(self, trajectory: Trajectory) -> list[Segment]:
        """Return the pieces between changes, each with its class."""
        seen = points(trajectory, self._roles)
        borders = [0, *changes(seen.velocities, self.penalty)]
        pieces = itertools.pairwise(borders)
        found = seen.segments([(start, end, None) for start, end in pieces])
        return classify(self._model, trajectory, found)


def changes(velocities: Floats, penalty: float) -> list[int]:
    """Return where directions change, and the end; velocities: (n_points, n_tracks, 3) [m/s]."""
    speed = np.linalg.norm(velocities, axis=2, keepdims=True)
    directions = (velocities / np.maximum(speed, SLOW)).reshape(len(velocities), -1)
    if len(directions) < 2 * SHORTEST:
        return [len(directions)]
    search = ruptures.KernelCPD(kernel="linear", min_size=SHORTEST).fit(directions)
    return list(search.predict(pen=penalty))


def classify(model: Model, trajectory: Trajectory, pieces: Sequence[Segment]) -> list[Segment]:
    """Return the pieces that are actions by the criterion, each with its best class."""
    features = model.features
    even = resample(trajectory, features.rate)
    motion = condition(stack(even, features.objects), features)
    there = np.flatnonzero(~np.isnan(motion.hand).any(axis=1))
    ends = trajectory.times[[[each.start, min(each.end, len(trajectory) - 1)] for each in pieces]]
    nearest = np.abs(even.times[there] - ends[..., None]).argmin(axis=2)
    spans = there[nearest]
    criterion = Criterion(model, 0.0, fillings(features.objects, features.objects))
    rest = np.cumsum(np.append(0.0, criterion.rest(motion.pace)))
    real = spans[:, 0] < spans[:, 1]
    values = criterion(motion, spans[real]).criterion
    kept = [piece for piece, is_real in zip(pieces, real, strict=True) if is_real]
    return [
        Segment(piece.start, piece.end, model.names[int(of_piece.argmax())])
        for piece, (start, end), of_piece in zip(kept, spans[real].tolist(), values, strict=True)
        if of_piece.max() > rest[end] - rest[start]
    ]
