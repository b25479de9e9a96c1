"""Frames as lines of JSON: ``{"t": 0.01, "hand": [x, y, z], "objects": {"cup": null}}``, null a dropout."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from app.commands.live import Block
from app.commands.terminal import tell

FARTHEST_M, FARTHEST_S = 100.0, 1e11
"""The server refuses a stream with positions or times beyond: a wrong unit."""
PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
TOLD = 20
"""Bad lines that are told one by one."""
MISSING = (math.nan, math.nan, math.nan)

Position = tuple[float, ...]


class BadLine(ValueError):
    """A line is no frame; says why."""


class Row(NamedTuple):
    """A frame: its time [s], the hand and the objects in the unit of the lines."""

    time: float
    hand: Position
    objects: dict[str, Position]


class FrameLines:
    """Makes frames of lines; what is none is told by its number and left out.

    objects: their names, None for those of the first frame; another that comes is told once and left out.
    rate: [Hz], None where lines have times.
    """

    def __init__(self, objects: Sequence[str] | None, unit: str, rate: float | None) -> None:
        self.n_lines = self.n_bad = 0
        self._objects = None if objects is None else tuple(objects)
        self._farthest = FARTHEST_M * PER_METRE[unit]
        self._rate = rate
        self._last = -math.inf
        self._left_out: set[str] = set()

    def blocks(self, batches: Iterable[Sequence[bytes]]) -> Iterator[Block]:
        """Yield the frames of each batch of lines, none where it has none."""
        for lines in batches:
            rows = [row for line in lines if (row := self._read(line)) is not None]
            if rows and self._objects is None:
                self._objects = tuple(rows[0].objects)
            yield self._block(rows)

    def _read(self, line: bytes) -> Row | None:
        self.n_lines += 1
        if not line.strip():
            return None
        try:
            row = self._row(line)
        except BadLine as error:
            self.n_bad += 1
            if self.n_bad <= TOLD:
                last = "; further ones are counted" if self.n_bad == TOLD else ""
                tell(f"line {self.n_lines}: {error}{last}", "yellow")
            return None
        self._last = row.time
        return row

    def _row(self, line: bytes) -> Row:
        try:
            value = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise BadLine("is no JSON") from error
        if not isinstance(value, dict) or "hand" not in value:
            raise BadLine('needs the form {"t": …, "hand": […], "objects": {…}}')
        objects = value.get("objects", {})
        if not isinstance(objects, dict):
            raise BadLine("`objects` needs the form {NAME: [x, y, z]}")
        time = 0.0 if self._rate else _number(value.get("t"), "t")
        if not self._rate and not abs(time) <= FARTHEST_S:
            raise BadLine(f"t {time:g} is no time in seconds")
        if not self._rate and time <= self._last:
            raise BadLine(f"t {time:g} is not later than {self._last:g}")
        places = {name: self._position(at, name) for name, at in objects.items()}
        return Row(time, self._position(value["hand"], "hand"), places)

    def _position(self, value: Any, name: str) -> Position:
        if value is None:
            return MISSING
        if not isinstance(value, list) or len(value) != 3:
            raise BadLine(f"{name} needs [x, y, z], or null for a dropout")
        position = tuple(_number(each, name) for each in value)
        if any(map(math.isnan, position)):
            return MISSING
        if max(map(abs, position)) > self._farthest:
            raise BadLine(f"{name} is over {FARTHEST_M:g} m away: a wrong unit?")
        return position

    def _block(self, rows: Sequence[Row]) -> Block:
        names = self._objects or ()
        for name in {name for row in rows for name in row.objects} - {*names} - self._left_out:
            tell(f"{name} was not in the first frame, it is left out: name it by --object", "yellow")
            self._left_out.add(name)
        objects = {
            name: np.array([row.objects.get(name, MISSING) for row in rows]).reshape(-1, 3) for name in names
        }
        times = None if self._rate else np.array([row.time for row in rows])
        return Block(times, np.array([row.hand for row in rows]).reshape(-1, 3), objects)


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadLine(f"{name} needs numbers" if name != "t" else "needs a t in seconds")
    try:
        return float(value)
    except OverflowError as error:
        raise BadLine(f"{name} is too large") from error
