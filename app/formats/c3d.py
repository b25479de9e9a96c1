"""C3D, read by ezc3d: points of which the camera saw nothing (residual -1) are gaps.

The length unit is in POINT:UNITS. The file may say in POINT:Y_SCREEN which axis points up on a screen: that
is up where the caller declares nothing else. What a program computed and filed among the points (angles,
forces, …) is left out.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ezc3d
import numpy as np

from app.formats.capture import Capture, Declared, UpAxis, distinct, resolve, timeline, unit_of
from app.formats.errors import NotRead, read_by

NAME, TITLE = "c3d", "C3D"

MIPS = 86
"""The number of the processor of Silicon Graphics machines, most significant byte first."""
BLOCK = 512
UP_ON_SCREEN: dict[str, UpAxis] = {"+Z": "z", "Z": "z", "+Y": "y", "Y": "y"}
NO_PLACES = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Parameters that list the labels of points that are none."""


def read(path: Path, declared: Declared) -> Capture:
    """Return the recording in a file. Raises FormatError."""
    _refuse_mips(path)
    with read_by("ezc3d"):
        return _capture(ezc3d.c3d(str(path)), declared)


def _capture(file: Any, declared: Declared) -> Capture:
    parameters, points = file["parameters"]["POINT"], file["data"]["points"]
    residuals = file["data"]["meta_points"]["residuals"]
    positions = np.where(residuals[0] < 0, np.nan, points[:3]).transpose(2, 1, 0)
    names = [str(name) for name in _value(parameters, "LABELS")][: positions.shape[1]]
    names = distinct(names + [""] * (positions.shape[1] - len(names)))
    computed = {str(name).strip() for key in NO_PLACES for name in _value(parameters, key)}
    units = [str(unit) for unit in _value(parameters, "UNITS") if str(unit).strip()]
    screen = [UP_ON_SCREEN.get(str(axis).strip().upper()) for axis in _value(parameters, "Y_SCREEN")]
    up_axis = next(iter(screen), None) if declared.up_axis is None else None
    geometry = resolve(
        TITLE,
        declared,
        unit_of(units[0], "POINT:UNITS") if units else None,
        up_axis,
    )
    header = file["header"]["points"]
    frames = np.arange(len(positions)) + int(header["first_frame"]) + 1
    rate = float(header["frame_rate"])
    metres = geometry.to_metres(positions)
    return Capture(
        NAME,
        timeline(frames, rate, None, first=1),
        frames,
        {name: metres[:, at] for at, name in enumerate(names) if name not in computed},
        rate,
        notes=(
            *([f"up axis {up_axis}, as POINT:Y_SCREEN has it"] if up_axis else ()),
            *_notes(file, sorted(computed & set(names))),
        ),
    )


def _refuse_mips(path: Path) -> None:
    with path.open("rb") as file:
        start = (file.read(1) or b"\0")[0]
        file.seek((start - 1) * BLOCK + 3 if start else 0)
        processor = file.read(1)
    if processor == bytes([MIPS]):
        raise NotRead(
            "this C3D file was written on an SGI machine (processor type MIPS), which ezc3d does not read; "
            "save it again in Intel format"
        )


def _value(parameters: Any, key: str) -> list[Any]:
    return list(parameters[key]["value"]) if key in parameters else []


def _notes(file: Any, computed: list[str]) -> tuple[str, ...]:
    events = file["header"]["events"]
    pairs = zip(events["events_label"], events["events_time"], strict=False)
    told = [f"event {label.strip()} at {time:g} s" for label, time in pairs if label.strip()]
    return (*told, *([f"no positions, not read: {', '.join(computed)}"] if computed else ()))
