"""What a recording promises, and what the numbers of a file mean."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.formats.capture import (
    Capture,
    Declared,
    Geometry,
    LengthUnit,
    UpAxis,
    distinct,
    resolve,
    timeline,
    unit_of,
)
from app.formats.errors import UndeclaredGeometry, Unreadable


def capture(**changed: Any) -> Capture:
    fields = {
        "format": "f",
        "times": np.arange(3.0),
        "frames": np.arange(3),
        "tracks": {"a": np.ones((3, 3))},
    }
    return Capture(**{**fields, **changed})


def test_arrays_are_their_own_and_read_only() -> None:
    track = np.ones((3, 3))
    kept = capture(tracks={"a": track})
    track[0] = 7.0
    assert (kept.tracks["a"] == 1.0).all()
    for array in (kept.times, kept.frames, kept.tracks["a"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"times": [], "frames": []}, "^has no frames$"),
        ({"tracks": {}}, "^has no positions$"),
        ({"times": [0.0, np.nan, 1.0], "frames": [7, 8, 9]}, "^frame 8: has no time$"),
        ({"times": [0.0, 1.0, 1.0], "frames": [7, 8, 9]}, "^frame 9: is not later"),
        ({"tracks": {"a": np.ones((2, 3))}}, r"^a: has shape \(2, 3\), needs \(3, 3\)$"),
        ({"tracks": {"a": np.full((3, 3), np.inf)}, "frames": [7, 8, 9]}, "^a, frame 7: is infinite$"),
    ],
)
def test_what_it_refuses(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(Unreadable, match=message):
        capture(**changed)


@given(
    unit=st.sampled_from(["m", "cm", "mm"]),
    up=st.sampled_from(["z", "y"]),
    position=st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3),
)
def test_metres_are_right_handed_and_z_is_up(unit: LengthUnit, up: UpAxis, position: list[float]) -> None:
    positions = np.array([position, [np.nan] * 3])
    x, y, z = np.array(position) / {"m": 1.0, "cm": 100.0, "mm": 1000.0}[unit]
    expected = [[x, y, z] if up == "z" else [x, -z, y], [np.nan] * 3]
    np.testing.assert_array_equal(Geometry(unit, up).to_metres(positions), expected)
    turned = np.linalg.det(Geometry(unit, up).to_metres(np.eye(3)))
    assert turned > 0.0, "right-handed stays right-handed"


UNITS = st.sampled_from([None, "m", "cm", "mm"])
AXES = st.sampled_from([None, "z", "y"])


@given(told=UNITS, said=UNITS, up_told=AXES, up_said=AXES)
def test_geometry_is_said_by_one_or_by_both_alike(
    told: LengthUnit | None, said: LengthUnit | None, up_told: UpAxis | None, up_said: UpAxis | None
) -> None:
    units, axes = {told, said} - {None}, {up_told, up_said} - {None}
    if len(units) == len(axes) == 1:
        assert resolve("F", Declared(told, up_told), said, up_said) == Geometry(units.pop(), axes.pop())  # type: ignore[arg-type]
    else:
        with pytest.raises(UndeclaredGeometry, match="F file"):
            resolve("F", Declared(told, up_told), said, up_said)


def test_names_of_units() -> None:
    assert [unit_of(name, "") for name in ("Meters", " MM", "centimetres")] == ["m", "mm", "cm"]
    with pytest.raises(Unreadable, match="Units: the length unit 'inches' is none of m, cm and mm"):
        unit_of("inches", "Units")


@given(
    rate=st.floats(1.0, 1000.0), first=st.integers(0, 5), begin=st.integers(0, 5000), digits=st.integers(4, 7)
)
def test_rounded_times_are_made_exact(rate: float, first: int, begin: int, digits: int) -> None:
    frames = np.arange(begin, begin + 50)
    exact = (frames - first) / rate
    np.testing.assert_array_equal(timeline(frames, rate, np.round(exact, digits), first), exact)
    shifted = timeline(frames, rate, exact + 100.0, first)
    np.testing.assert_allclose(shifted, exact + 100.0, rtol=0.0, atol=1e-9)


def test_times_count_where_they_disagree_with_the_rate() -> None:
    frames, column = np.arange(4), np.array([0.0, 0.1, 0.25, 0.3])
    assert timeline(frames, 10.0, column, 0).tolist() == column.tolist()
    assert timeline(frames, None, column, 0).tolist() == column.tolist()
    assert timeline(frames, 10.0, None, 0) == pytest.approx([0.0, 0.1, 0.2, 0.3])


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf"), None])
def test_a_rate_is_positive(rate: float | None) -> None:
    with pytest.raises(Unreadable, match="rate"):
        timeline(np.arange(3), rate, None, 0)


def test_names_become_distinct() -> None:
    assert distinct(["a", "", "a", " a ", ""]) == ["a", "*2", "a (2)", "a (3)", "*5"]


def test_errors_tell_file_place_and_reason() -> None:
    assert str(Unreadable("line 3", "is short", "a.csv")) == "a.csv: line 3: is short"
    assert str(Unreadable("", "is short")) == "is short"
