"""The unit of length does not matter: neither to recognition nor to training."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.motion.model import N_OF_MOVEMENT, N_OF_ROLE, PACE, PHASE, FeatureSpecification, Model
from app.motion.recogniser import Event, SegmentEvent, recognise
from app.motion.simulation import demonstrations, recording
from app.motion.training import PHASE_FLOOR, TrainingOptions, fit_model
from app.motion.trajectory import Trajectory

SHOWN = recording(11, 5)


def scaled(motion: Trajectory, unit: float) -> Trajectory:
    objects = {name: unit * track for name, track in motion.objects.items()}
    return Trajectory(motion.times, unit * motion.hand, objects)


def in_unit(model: Model, unit: float) -> Model:
    """Return a model of lengths in a unit of which a metre has so many; paces and phases are none."""
    units = np.full(model.features.n_features, unit)
    units[[PACE, PHASE]] = units[N_OF_MOVEMENT + 1 :: N_OF_ROLE] = 1.0
    actions = tuple(
        replace(
            action,
            means=units * action.means,
            variances=units**2 * action.variances,
            starts=unit * action.starts,
            ways=unit * action.ways,
            shapes=unit * action.shapes,
        )
        for action in model.actions
    )
    return replace(
        model,
        features=replace(model.features, still=unit * model.features.still),
        actions=actions,
        background=replace(model.background, width=units * model.background.width),
    )


def segments_of(events: list[Event]) -> list[SegmentEvent]:
    return [event for event in events if isinstance(event, SegmentEvent)]


def spans(events: list[Event]) -> list[tuple[str | None, int, int]]:
    return [(event.action, event.start, event.end) for event in segments_of(events)]


@pytest.mark.parametrize("unit", [10.0, 39.37])
def test_the_unit_of_length_does_not_matter(trained: Model, unit: float) -> None:
    events = recognise(in_unit(trained, unit), scaled(SHOWN.trajectory, unit))
    wanted = recognise(trained, SHOWN.trajectory)
    assert len(wanted) == len(SHOWN.segments)
    assert spans(events) == spans(wanted)
    for event, same in zip(segments_of(events), segments_of(wanted), strict=True):
        assert event.log_likelihoods == pytest.approx(same.log_likelihoods, rel=1e-6)
        assert event.novelty == pytest.approx(same.novelty, abs=1e-6)


@pytest.fixture(scope="module")
def in_decimetres() -> tuple[Model, Model]:
    """Models trained on the same demonstrations, in metres and as if a decimetre were one."""
    shown, floor, plain = demonstrations(1)[::4], 0.0075, FeatureSpecification(("object",))
    bigger = [replace(each, trajectory=scaled(each.trajectory, 10.0)) for each in shown]
    metres, decimetres = (
        fit_model(
            of,
            replace(plain, still=unit * plain.still),
            TrainingOptions(n_states=4, deviation_floor=unit * floor),
        )
        for of, unit in ((shown, 1.0), (bigger, 10.0))
    )
    return metres, decimetres


def test_training_and_recognition_know_no_unit(in_decimetres: tuple[Model, Model]) -> None:
    metres, decimetres = in_decimetres
    bigger = scaled(SHOWN.trajectory, 10.0)
    assert spans(recognise(decimetres, bigger)) == spans(recognise(metres, SHOWN.trajectory))
    assert decimetres.evidence == pytest.approx(metres.evidence)
    assert decimetres.rest.pace == pytest.approx(metres.rest.pace)
    assert np.sqrt(decimetres.actions[0].variances[:, PHASE]).min() >= PHASE_FLOOR
