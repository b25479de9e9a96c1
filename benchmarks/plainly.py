"""The criterion of the core, one segment after the other: what the fast one is held against."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from app.motion.conditioning import Tracks
from app.motion.criterion import Criterion, Scores
from app.motion.trajectory import Floats, Indices


class Plainly(Criterion, ABC):
    """The criterion, by ratios that are found for each whole movement on its own."""

    def __call__(self, tracks: Tracks, segments: Indices) -> Scores:
        """Return the scores of segments; (n_segments, 2)."""
        way = np.linalg.norm(tracks.hand[segments[:, 1]] - tracks.hand[segments[:, 0]], axis=1)
        terms, shape = self._terms, (len(segments), len(self._terms.nearest))
        scores = Scores(np.full(shape, -np.inf), np.full(shape, -np.inf), np.zeros(shape, dtype=np.int64))
        for row in np.flatnonzero(way >= terms.nearest.min()).tolist():
            start, goal = segments[row].tolist()
            part = tracks.part(start, goal + 1)
            of_fillings = np.array([self._ratios(part, filling) for filling in self._fillings.tolist()])
            ratios = of_fillings.max(axis=0)
            slow = (np.log(goal - start) - terms.tempo[:, 0]) / terms.tempo[:, 1]
            counted = terms.evidence * ratios - 0.5 * slow**2
            scores.criterion[row] = np.where(way[row] < terms.nearest, -np.inf, counted)
            scores.ratio[row], scores.filling[row] = ratios / len(part.pace), of_fillings.argmax(axis=0)
        return scores

    def best(
        self, tracks: Tracks, segments: Indices, _bounds: Floats, _before: Floats, least: Floats
    ) -> Floats:
        """Return (n_segments,) values of the best class, whatever lies before."""
        values: Floats = np.maximum(self(tracks, segments).criterion.max(axis=1), least)
        return values

    @abstractmethod
    def _ratios(self, part: Tracks, filling: list[int]) -> list[float]:
        """Return the (n_classes,) log-likelihood ratios to the background of a whole movement [nat]."""
