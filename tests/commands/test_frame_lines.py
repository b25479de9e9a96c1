"""Lines of JSON become frames; what is none says why."""

from __future__ import annotations

import json

import numpy as np
import pytest

from app.commands.frame_lines import TOLD, BadLine, FrameLines

GOOD = {"t": 1.0, "hand": [1, 2, 3], "objects": {"cup": [4, 5, 6.5]}}


def test_lines_become_arrays_with_their_dropouts() -> None:
    lines = FrameLines(None, "m", None)
    texts = [
        json.dumps(GOOD),
        " ",
        '{"t": 2, "hand": null, "objects": {"cup": [NaN, 1, 2]}, "frame": 7}',
        '{"t": 3, "hand": [0, 0, 0]}',
    ]
    [block, empty] = lines.blocks([[text.encode() for text in texts], []])
    np.testing.assert_array_equal(block.times, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(block.hand, [[1, 2, 3], [np.nan] * 3, [0, 0, 0]])
    np.testing.assert_array_equal(block.objects["cup"], [[4, 5, 6.5], [np.nan] * 3, [np.nan] * 3])
    assert (empty.hand.shape, empty.objects["cup"].shape) == ((0, 3), (0, 3))
    assert (lines.n_lines, lines.n_bad) == (4, 0)


def test_at_a_rate_there_are_no_times() -> None:
    [block] = FrameLines(["cup"], "m", 100.0).blocks([[b'{"hand": [1, 2, 3]}'] * 2])
    assert block.times is None
    assert len(block.hand) == 2
    assert list(block.objects) == ["cup"]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"t": None}, "needs a t in seconds"),
        ({"t": True}, "needs a t"),
        ({"t": "1"}, "needs a t"),
        ({"t": float("nan")}, "is no time"),
        ({"t": 1e12}, "is no time"),
        ({"t": 10**400}, "t is too large"),
        ({"t": 0.0}, "not later than 0"),
        ({"hand": [1, 2]}, r"hand needs \[x, y, z\]"),
        ({"hand": "here"}, "hand needs"),
        ({"hand": [1, 2, "3"]}, "hand needs numbers"),
        ({"hand": [1, 2, float("inf")]}, "wrong unit"),
        ({"objects": {"cup": [0, 0, 101]}}, "cup is over 100 m away"),
        ({"objects": ["cup"]}, "`objects` needs the form"),
    ],
)
def test_what_is_no_frame_says_why(change: dict[str, object], why: str) -> None:
    lines = FrameLines(None, "m", None)
    list(lines.blocks([[b'{"t": 0, "hand": null}']]))
    with pytest.raises(BadLine, match=why):
        lines._row(json.dumps(GOOD | change).encode())


@pytest.mark.parametrize("text", ["", "{", "[1]", "7", '{"t": 1}', "\xff", "[" * 100_000])
def test_what_is_no_json_says_so(text: str) -> None:
    with pytest.raises(BadLine):
        FrameLines(None, "m", None)._row(text.encode("latin-1"))


def test_the_unit_counts_for_how_far_is_too_far() -> None:
    line = b'{"t": 1, "hand": [0, 0, 99000]}'
    [far, near] = [list(FrameLines(None, unit, None).blocks([[line]])) for unit in ("m", "mm")]
    assert (len(far[0].hand), len(near[0].hand)) == (0, 1)


def test_many_bad_lines_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    lines = FrameLines(None, "m", None)
    list(lines.blocks([[b"x"] * 100]))
    assert lines.n_bad == 100
    told = capsys.readouterr().err.splitlines()
    assert len(told) == TOLD
    assert told[-1] == f"line {TOLD}: is no JSON; further ones are counted"
