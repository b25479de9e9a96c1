"""Pruned and unpruned search find the same: what is not looked at could not have won."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.motion.criterion import Criterion
from app.motion.model import FeatureSpecification, Model
from app.motion.recogniser import Event, recognise
from app.motion.simulation import Conditions, recording
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Floats, Indices, Trajectory
from app.motion.window import Window
from benchmarks.folders import known_folders, load_recordings, load_sequences, split
from tests.motion.drawn import TABLE, model_of, motion_of

LAW = settings(derandomize=True, deadline=None, max_examples=1000)

seeds = st.integers(0, 2**32 - 1)


def unpruned(window: Window, segments: Indices, _before: Floats, least: Floats) -> Floats:
    """Return what every class says of every segment."""
    return np.asarray(np.maximum(window.scores(segments).criterion.max(axis=1), least))


def events(model: Model, motion: Trajectory) -> list[Event]:
    return recognise(model, motion)


@LAW
@given(seeds, st.integers(1, 12), st.integers(0, 2), st.floats(0.0, 400.0))
def test_the_best_is_found_with_its_value(seed: int, n_classes: int, n_objects: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    model = model_of(rng, tuple(rng.integers(1, 9, n_classes)), n_objects)
    model = replace(model, actions=tuple(replace(each, ways=0.01 * each.ways) for each in model.actions))
    motion = motion_of(rng, 70, n_objects)
    motion.hand[rng.random(70) < 0.1] = np.nan
    seen = np.flatnonzero(~np.isnan(motion.hand[:, 0]))
    segments = np.array([(start, seen[-1]) for start in seen[:-1]])
    filling = np.array([rng.permutation(n_objects) for _ in range(2)], dtype=np.int64).reshape(2, -1)
    criterion = Criterion(model, TABLE, filling)
    most = [criterion.most(motion, frame) for frame in range(70)]
    bounds = np.cumsum([np.zeros(n_classes), *most], axis=0)
    before, least = rng.normal(0.0, spread, len(segments)), rng.normal(-100.0, 50.0, len(segments))
    every = np.maximum(criterion(motion, segments).criterion.max(axis=1), least)
    found = criterion.best(motion, segments, bounds, before, least)
    best = int((before + every).argmax())
    assert int((before + found).argmax()) == best
    assert found[best] == every[best]
    assert (found <= every).all()


@LAW
@given(seeds, st.integers(0, 2))
def test_no_class_explains_a_segment_better_than_its_bound(seed: int, n_objects: int) -> None:
    rng = np.random.default_rng(seed)
    model, motion = model_of(rng, (1, 4, 7), n_objects), motion_of(rng, 40, n_objects)
    motion.objects[rng.random((n_objects, 40)) < 0.2] = np.nan
    criterion = Criterion(model, TABLE, np.arange(n_objects)[None])
    most = np.array([criterion.most(motion, frame) for frame in range(40)])
    segments = np.array([(start, end) for start in range(0, 39, 5) for end in range(start + 1, 40, 3)])
    of_segments = criterion(motion, segments).ratio * (np.diff(segments, axis=1) + 1)
    for (start, end), of_segment in zip(segments.tolist(), of_segments, strict=True):
        assert (of_segment <= most[start : end + 1].sum(axis=0) + 1e-9).all()


@pytest.mark.parametrize(
    "conditions",
    [Conditions(), Conditions(noise=0.004), Conditions(gap_share=0.3), Conditions(rest=(0.0, 1.0))],
    ids=["clean", "noise", "gaps", "rest"],
)
def test_simulated_streams_give_the_same_events(
    trained: Model, conditions: Conditions, monkeypatch: pytest.MonkeyPatch
) -> None:
    motions = [recording(500 + seed, 4, conditions).trajectory for seed in range(20)]
    found = [events(trained, motion) for motion in motions]
    monkeypatch.setattr(Window, "best", unpruned)
    assert [events(trained, motion) for motion in motions] == found


def real() -> Iterator[tuple[Model, Sequence[Trajectory]]]:
    """Yield models of people with the sequences and recordings of those that they have not seen."""
    for folder in known_folders():
        for fold, longer in split(load_sequences(folder), load_recordings(folder)):
            shown = [each for known in fold.training for each in known.recording.demonstrations()]
            model = fit_model(shown, FeatureSpecification(("object",)), TrainingOptions())
            yield model, [each.recording.trajectory for each in (*fold.test, *longer.test)]


@pytest.mark.shared
def test_real_streams_give_the_same_events(monkeypatch: pytest.MonkeyPatch) -> None:
    streams = [(model, motion) for model, motions in real() for motion in motions]
    found = [events(model, motion) for model, motion in streams]
    assert sum(len(each) for each in found) > 100
    monkeypatch.setattr(Window, "best", unpruned)
    assert [events(model, motion) for model, motion in streams] == found
