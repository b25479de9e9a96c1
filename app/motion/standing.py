"""What a model's own demonstrations say of it: how well it explains them, and where rest begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.motion.conditioning import Tracks
from app.motion.model import Familiarity, Model, Rest
from app.motion.scoring import score_segments, states_of
from app.motion.trajectory import Floats

SHARPER = 0.5
"""Rest ends more sharply than the ends of demonstrations scatter, which are cut by hand: by this factor."""

REST_SPREAD = 0.1
"""Least spread of the pace at which rest ends."""


def rest_of(demonstrations: Sequence[Tracks]) -> Rest:
    """Return the pace that hands have where demonstrations begin and end, and how sharp that is."""
    ends = np.array([tracks.pace[at] for tracks in demonstrations for at in (0, -1)])
    return Rest(float(np.median(ends)), max(SHARPER * float(ends.std()), REST_SPREAD))


def familiarity_of(model: Model, demonstrations: Sequence[tuple[Tracks, float, str]]) -> Familiarity:
    """Return how well the classes explain their own demonstrations and those of the others.

    demonstrations: conditioned, with the height of the table [m] and the class. A movement is of a class
    if the class explains it better than it does most movements of other classes; but what gets half of what
    is typical always is, and what the background explains better never.
    """
    ratios = _ratios(model, demonstrations)
    actions = np.array([action for _, _, action in demonstrations])
    typical, least = np.empty(len(model.names)), np.zeros(len(model.names))
    for k, name in enumerate(model.names):
        own = ratios[actions == name, k]
        typical[k] = own[np.isfinite(own)].mean() if np.isfinite(own).any() else 0.0
        others = ratios[actions != name, k]
        if len(others):
            least[k] = np.clip(np.median(others), 0.0, max(typical[k] / 2.0, 0.0))
    return Familiarity(typical, least)


def _ratios(model: Model, demonstrations: Sequence[tuple[Tracks, float, str]]) -> Floats:
    """Return (n_demonstrations, n_classes) log-likelihood ratios to the background [nat per frame]."""
    states, roles = states_of(model), np.arange(len(model.features.objects))[None]
    ratios = np.empty((len(demonstrations), len(model.names)))
    for row, (tracks, table_height, _) in zip(ratios, demonstrations, strict=True):
        whole = np.array([[0, len(tracks.pace) - 1]])
        row[:] = score_segments(tracks, table_height, whole, states, roles)[0][0] / len(tracks.pace)
    return ratios
