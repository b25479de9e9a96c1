"""What is done when, from a file beside the recording; JSON or CSV, by time or by frame.

JSON: a list of ``{"action", "start_s", "end_s"}`` or ``{"action", "start_frame", "end_frame"}``, or as
vMCI_segmentation writes it ``{"label", "start index", "end index"}``, which are frames. CSV: the same names
as columns. Frames are called by the numbers that the recording's file gives them. The end names the goal
frame; that may be the one after the last.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from io import StringIO
from typing import Any

import numpy as np

from app.formats.capture import Capture, Label
from app.formats.errors import InvalidLabels
from app.motion.trajectory import Segment, Trajectory

ACTIONS = ("action", "label")
FRAMES = (("start_frame", "end_frame"), ("start index", "end index"))
SECONDS = ("start_s", "end_s")

SLACK = 0.5
"""Of a period: so much may a time lie outside the recording."""


def read_labels(content: bytes, capture: Capture) -> tuple[Label, ...]:
    """Return the labels in the content of a file, in order of their start. Raises InvalidLabels."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidLabels("", f"needs UTF-8 text: {error}") from error
    rows = _json(text) if text.lstrip()[:1] in ("[", "{") else _csv(text)
    indices = {number: index for index, number in enumerate(capture.frames.tolist())}
    found = [_label(place, row, capture, indices) for place, row in rows]
    return tuple(sorted(found, key=lambda label: (label.start_s, label.end_s)))


def renamed(labels: Sequence[Label], actions: Mapping[str, str]) -> tuple[Label, ...]:
    """Return the labels under the names of their actions; those of other names are left out."""
    return tuple(
        Label(actions[label.action], label.start_s, label.end_s)
        for label in labels
        if label.action in actions
    )


def segments(labels: Sequence[Label], trajectory: Trajectory) -> tuple[Segment, ...]:
    """Return the segments of a trajectory, in order, at the frames nearest to the labels' times.

    Raises InvalidLabels where two overlap, or one has no frame of its own.
    """
    times = trajectory.times
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    times = np.append(times, times[-1] + period)
    found: list[Segment] = []
    free_from = 0
    for label in sorted(labels, key=lambda label: label.start_s):
        start, end = (int(np.abs(times - time).argmin()) for time in (label.start_s, label.end_s))
        if start >= end:
            raise InvalidLabels(_told(label), "is shorter than a frame")
        if start < free_from:
            raise InvalidLabels(
                _told(label), f"overlaps {found[-1].action!r}; leave out or rename one of them"
            )
        found.append(Segment(start, end, label.action))
        free_from = end
    return tuple(found)


def _json(text: str) -> list[tuple[str, dict[str, Any]]]:
    try:
        rows = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidLabels("", f"no JSON: {error}") from error
    if not isinstance(rows, list):
        raise InvalidLabels("", "needs a list of labels")
    for index, row in enumerate(rows):
        if not isinstance(row, dict):
            raise InvalidLabels(f"label {index}", "needs an object with action, start_s, end_s")
    return [(f"label {index}", row) for index, row in enumerate(rows)]


def _csv(text: str) -> list[tuple[str, dict[str, Any]]]:
    reader = csv.DictReader(StringIO(text, newline=""))
    try:
        return [(f"line {reader.line_num}", dict(row)) for row in reader]
    except csv.Error as error:
        raise InvalidLabels(f"line {reader.line_num}", f"no table: {error}") from error


def _label(place: str, row: Mapping[str, Any], capture: Capture, indices: Mapping[int, int]) -> Label:
    action = next((row[key] for key in ACTIONS if row.get(key)), None)
    if not isinstance(action, str):
        raise InvalidLabels(place, "has no action")
    frames = next((keys for keys in FRAMES if all(row.get(key) not in (None, "") for key in keys)), None)
    if frames:
        start, end = (_time(place, key, row[key], capture, indices) for key in frames)
    elif all(row.get(key) not in (None, "") for key in SECONDS):
        start, end = (_number(place, key, row[key]) for key in SECONDS)
    else:
        raise InvalidLabels(place, "needs start_s and end_s, or start_frame and end_frame")
    first, last = capture.times[0], capture.times[-1] + capture.period
    slack = SLACK * capture.period
    if not first - slack <= start < end <= last + slack:
        raise InvalidLabels(
            place,
            f"{action!r} from {start:g} to {end:g} s must start before its end and lie within "
            f"the recording, {first:g} to {last:g} s",
        )
    return Label(action, start, end)


def _time(place: str, key: str, value: object, capture: Capture, indices: Mapping[int, int]) -> float:
    """Return the time of a frame by its number [s]."""
    number = _number(place, key, value)
    first, last = int(capture.frames[0]), int(capture.frames[-1])
    if number == last + 1:
        return float(capture.times[-1]) + capture.period
    if number not in indices:
        raise InvalidLabels(place, f"{key}: the recording has no frame {value}; it has {first} to {last}")
    return float(capture.times[indices[int(number)]])


def _number(place: str, key: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number) or isinstance(value, bool):
        raise InvalidLabels(place, f"{key}: {value!r} is no number")
    return number


def _told(label: Label) -> str:
    return f"{label.action!r} from {label.start_s:g} to {label.end_s:g} s"
