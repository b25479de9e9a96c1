"""Artifacts: what is written reads back bit for bit, and nothing that is no artifact is read."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.motion.model import N_SHAPE, ActionModel, Background, Familiarity, FeatureSpecification, Model, Rest
from app.motion.trajectory import Demonstration, Floats, Scene, Trajectory
from app.registry.artifacts import (
    AXES,
    dump_demonstration,
    dump_model,
    load_demonstration,
    load_model,
)
from app.registry.errors import ArtifactInvalid

few = settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
names = st.text(max_size=8)


def numbers(shape: tuple[int, ...], low: float, high: float) -> st.SearchStrategy[Floats]:
    return arrays(np.float64, shape, elements=st.floats(low, high))


@st.composite
def models(draw: st.DrawFn) -> Model:
    roles = draw(st.lists(names, max_size=2, unique=True))
    features = FeatureSpecification(tuple(roles), draw(st.floats(1.0, 1000.0)))
    width = features.n_features
    bounds = {"variances": (1e-12, 1e6), "stay": (0.0, 1.0), "weights": (0.0, 1e9)}
    bounds |= {"durations": (1e-3, 600.0), "starts": (-1e2, 1e2), "ways": (1e-3, 1e2), "shapes": (-1e2, 1e2)}

    def action(name: str) -> ActionModel:
        sizes = {
            "states": draw(st.integers(1, 3)),
            "features": width,
            "demonstrations": draw(st.integers(1, 3)),
            "space": 3,
            "shape": N_SHAPE,
        }
        tables = {
            name: draw(numbers(tuple(sizes[axis] for axis in axes), *bounds.get(name, (-1e300, 1e300))))
            for name, axes in AXES.items()
        }
        return ActionModel(action=name, **tables, repetition=draw(st.floats(1.0, 1e3)))

    classes = draw(st.lists(names, min_size=1, max_size=3, unique=True))
    background = Background(draw(numbers((width,), 1e-9, 1e9)))
    typical, least = (draw(numbers((len(classes),), -1e300, 1e300)) for _ in range(2))
    rest = Rest(draw(st.floats(-1e300, 1e300)), draw(st.floats(1e-9, 1e9)))
    actions = tuple(action(name) for name in classes)
    return Model(features, actions, background, Familiarity(typical, least), rest)


@st.composite
def demonstrations(draw: st.DrawFn) -> Demonstration:
    steps = draw(st.lists(st.floats(1e-3, 10.0), min_size=1, max_size=6))

    def track() -> Floats:
        positions = draw(numbers((len(steps), 3), -100.0, 100.0)).copy()
        positions[draw(numbers((len(steps),), 0, 1)) > 0.7] = np.nan
        return positions

    objects = {name: track() for name in draw(st.lists(names, max_size=2, unique=True))}
    trajectory = Trajectory(np.cumsum(steps), track(), objects)
    return Demonstration(draw(names), trajectory, Scene(draw(st.floats(-2, 2))))


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal to the last bit."""
    if isinstance(one, np.ndarray):
        return bool(one.shape == other.shape) and one.tobytes() == other.tobytes()
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if hasattr(one, "__dataclass_fields__"):
        return all(same(getattr(one, part.name), getattr(other, part.name)) for part in fields(one))
    return bool(one == other)


@few
@given(models())
def test_a_model_reads_back_bit_for_bit(model: Model) -> None:
    data = dump_model(model)
    loaded = load_model(data)
    assert same(model, loaded)
    assert dump_model(loaded) == data
    assert not loaded.actions[0].means.flags.writeable


@few
@given(demonstrations())
def test_a_demonstration_reads_back_bit_for_bit(demonstration: Demonstration) -> None:
    data = dump_demonstration(demonstration)
    loaded = load_demonstration(data)
    former, latter = demonstration.trajectory, loaded.trajectory
    assert (loaded.action, loaded.scene) == (demonstration.action, demonstration.scene)
    assert same(former.times, latter.times)
    for one, other in [
        (former.hand, latter.hand),
        *((former.objects[k], latter.objects[k]) for k in former.objects),
    ]:
        np.testing.assert_array_equal(one, other)
    assert latter.objects.keys() == former.objects.keys()
    assert dump_demonstration(loaded) == data


def test_the_order_of_objects_does_not_change_the_content() -> None:
    line = np.linspace([0.0, 0, 0], [0.3, 0, 0], 5)
    there, back = {"a": line, "b": line + 1}, {"b": line + 1, "a": line}
    one, other = (Demonstration("reach", Trajectory(np.arange(5.0), line, o)) for o in (there, back))
    assert dump_demonstration(one) == dump_demonstration(other)


def test_every_array_of_an_action_model_has_its_axes_checked() -> None:
    assert set(AXES) == {part.name for part in fields(ActionModel)} - {"action", "repetition"}


def a_model() -> dict[str, Any]:
    features = FeatureSpecification(("object",))
    sizes = {"states": 2, "features": features.n_features, "demonstrations": 3, "space": 3, "shape": N_SHAPE}
    tables = {name: np.full([sizes[axis] for axis in axes], 0.5) for name, axes in AXES.items()}
    action = ActionModel(action="reach", **tables, repetition=2.0)
    background, familiarity = Background(np.ones(features.n_features)), Familiarity(np.ones(1), np.zeros(1))
    model = Model(features, (action,), background, familiarity, Rest(-2.5, 0.3))
    found: dict[str, Any] = json.loads(dump_model(model))
    return found


def at(*path: str | int, to: Any = None) -> Callable[[dict[str, Any]], None]:
    """Return a change of the value at a path; ``to`` a type: the key is taken away."""

    def change(value: Any) -> None:
        for step in path[:-1]:
            value = value[step]
        if isinstance(to, type):
            del value[path[-1]]
        else:
            value[path[-1]] = to

    return change


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (at("format", to="other"), "format"),
        (at("format_version", to=1), "format_version"),
        (at("format_version", to=2), "format_version"),
        (at("format_version", to=True), "format_version"),
        (at("background", to=object), "background"),
        (at("extra", to=1), "extra"),
        (at("actions", 0, "surprise", to=1), "actions[0].surprise"),
        (at("actions", 0, "stay", to=object), "actions[0].stay"),
        (at("actions", to=[]), "actions"),
        (at("actions", to={}), "actions"),
        (at("actions", 0, to=3), "actions[0]"),
        (at("actions", 0, "action", to=3), "actions[0].action"),
        (at("actions", 0, "means", 1, to=[1.0]), "actions[0].means"),
        (at("actions", 0, "means", to=[]), "actions[0].means"),
        (at("actions", 0, "means", to=0.5), "actions[0].means"),
        (at("actions", 0, "means", 1, 2, to="0.5"), "actions[0].means[1][2]"),
        (at("actions", 0, "means", 1, 2, to=None), "actions[0].means[1][2]"),
        (at("actions", 0, "means", 1, 2, to=[[0.5]]), "actions[0].means[1][2]"),
        (at("actions", 0, "means", 1, 2, to=10**400), "actions[0].means[1][2]"),
        (at("actions", 0, "variances", 1, 2, to=0.0), "actions[0].variances"),
        (at("actions", 0, "stay", 0, to=1.5), "actions[0].stay"),
        (at("actions", 0, "weights", 0, to=-1), "actions[0].weights"),
        (at("actions", 0, "durations", to=[]), "actions[0].durations"),
        (at("features", "still", to=0), "features.still"),
        (at("features", "still", to=-1), "features.still"),
        (at("features", "rate", to=0), "features.rate"),
        (at("features", "rate", to=1e9), "features.rate"),
        (at("actions", 0, "durations", 0, to=1e12), "actions[0].durations"),
        (at("features", "rate", to=True), "features.rate"),
        (at("features", "objects", to=["a", "a"]), "features.objects"),
        (at("features", "objects", to=["a", "b"]), "actions[0].means"),
        (at("features", "objects", 0, to=1), "features.objects[0]"),
        (at("background", "width", 2, to=0), "background.width"),
        (at("background", "width", to=[1.0]), "background.width"),
        (at("background", "scale", to=[1.0]), "background.scale"),
        (at("familiarity", to=object), "familiarity"),
        (at("familiarity", "typical", to=object), "familiarity.typical"),
        (at("familiarity", "typical", to=[1.0, 1.0]), "familiarity.typical"),
        (at("familiarity", "least", to=[]), "familiarity.least"),
        (at("familiarity", "least", 0, to=None), "familiarity.least[0]"),
        (at("familiarity", "most", to=[1.0]), "familiarity.most"),
        (at("rest", to=object), "rest"),
        (at("rest", "pace", to=object), "rest.pace"),
        (at("rest", "pace", to="slow"), "rest.pace"),
        (at("rest", "spread", to=0.0), "rest"),
        (at("rest", "spread", to=-1.0), "rest"),
        (at("rest", "speed", to=1.0), "rest.speed"),
        (at("actions", 0, "ways", to=[[0.3, 0.0, 0.0]]), "actions[0].ways"),
        (at("actions", 0, "ways", 1, to=[0.0, 0.0, 0.0]), "actions[0].ways"),
        (at("actions", 0, "starts", 2, 0, to=1e9), "actions[0].starts"),
        (at("actions", 0, "shapes", 0, 7, to=-1e9), "actions[0].shapes"),
        (at("actions", 0, "repetition", to=0.5), "actions[0].repetition"),
        (at("actions", 0, "repetition", to="2"), "actions[0].repetition"),
    ],
)
def test_the_field_that_is_wrong_is_named(change: Callable[[dict[str, Any]], None], field: str) -> None:
    artifact = a_model()
    load_model(json.dumps(artifact).encode())
    change(artifact)
    with pytest.raises(ArtifactInvalid) as raised:
        load_model(json.dumps(artifact).encode())
    assert raised.value.field == field


def test_two_classes_of_one_name_are_refused() -> None:
    artifact = a_model()
    artifact["actions"] *= 2
    with pytest.raises(ArtifactInvalid, match="different classes"):
        load_model(json.dumps(artifact).encode())


def test_nothing_that_would_be_refused_is_written() -> None:
    model = load_model(json.dumps(a_model()).encode())
    for field, broken in (
        ("background.width", {"background": Background(np.full(model.features.n_features, np.nan))}),
        ("familiarity.typical", {"familiarity": Familiarity(np.array([np.inf]), np.zeros(1))}),
        ("familiarity.least", {"familiarity": Familiarity(np.ones(1), np.array([np.nan]))}),
        ("rest", {"rest": Rest(np.nan, 0.3)}),
        ("rest", {"rest": Rest(-2.5, np.inf)}),
    ):
        with pytest.raises(ArtifactInvalid) as raised:
            dump_model(replace(model, **broken))
        assert raised.value.field == field


def test_features_are_six_of_the_movement_and_two_of_each_role() -> None:
    artifact = a_model()
    assert np.shape(artifact["actions"][0]["means"]) == (2, 8)
    assert len(artifact["background"]["width"]) == 8


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff",
        b"[]",
        b"3",
        b"[" * 100_000,
        b'{"format":"gesta-model","format":"gesta-model"}',
        b'{"a":NaN}',
    ],
)
@pytest.mark.parametrize("load", [load_model, load_demonstration])
def test_what_is_not_a_json_object_is_refused(load: Callable[[bytes], Any], data: bytes) -> None:
    with pytest.raises(ArtifactInvalid):
        load(data)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (at("t", 1, to=0.0), "t"),
        (at("t", 1, to="1"), "t[1]"),
        (at("t", to=[]), "t"),
        (at("hand", 1, to=[1, 2]), "hand[1]"),
        (at("hand", to=None), "hand"),
        (at("hand", 1, 2, to=101.0), "hand"),
        (at("objects", "object", to=[]), "objects.object"),
        (at("objects", to=[]), "objects"),
        (at("action", to=None), "action"),
        (at("table_height_m", to="0"), "table_height_m"),
        (at("more", to=1), "more"),
    ],
)
def test_the_field_of_a_demonstration_that_is_wrong_is_named(
    change: Callable[[dict[str, Any]], None], field: str
) -> None:
    line = np.linspace([0.0, 0, 0], [0.3, 0, 0], 3)
    artifact = json.loads(
        dump_demonstration(Demonstration("reach", Trajectory(np.arange(3.0), line, {"object": line})))
    )
    change(artifact)
    with pytest.raises(ArtifactInvalid) as raised:
        load_demonstration(json.dumps(artifact).encode())
    assert raised.value.field == field
