"""The methods that are compared: each learns from demonstrations and finds segments in a trajectory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from app.motion.model import FeatureSpecification, Model
from app.motion.recogniser import Method, SegmentEvent, recognise
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration, Segment, Trajectory
from benchmarks.change_points import ChangePoints
from benchmarks.garbage_model import GarbageModel
from benchmarks.joined_hmm import train_positions, train_velocities

Find = Callable[[Trajectory], list[Segment]]

OURS = "ours"


@dataclass(frozen=True)
class Core:
    """Recognises with the core; method None: as it does if nothing else is asked for."""

    model: Model
    method: Method | None = None

    def __call__(self, trajectory: Trajectory) -> list[Segment]:
        """Return the segments of the events; an action that is not known has no class."""
        return [Segment(each.start, each.end, each.action) for each in self.events(trajectory)]

    def events(self, trajectory: Trajectory) -> list[SegmentEvent]:
        """Return the events of segments."""
        if self.method is None:
            events = recognise(self.model, trajectory)
        else:
            events = recognise(self.model, trajectory, method=self.method)
        return [each for each in events if isinstance(each, SegmentEvent)]


def model_of(demonstrations: Sequence[Demonstration]) -> Model:
    """Return the core's model with all its defaults; every object of the demonstrations is a role."""
    features = FeatureSpecification(tuple(demonstrations[0].trajectory.objects))
    return fit_model(demonstrations, features, TrainingOptions())


def train(demonstrations: Sequence[Demonstration], model: Model) -> dict[str, Find]:
    """Return every method by name, each trained on the same; model: of these demonstrations."""
    return {
        OURS: Core(model),
        "Steps 1-3": Core(model, "steps"),
        "greedy": Core(model, "greedy"),
        "one HMM, positions": train_positions(demonstrations),
        "one HMM, velocities": train_velocities(demonstrations),
        "change points": ChangePoints(demonstrations, model),
        "garbage model": GarbageModel(demonstrations),
    }
