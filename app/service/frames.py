"""Frames as a stream carries them, and what they become: checked times and positions in metres, Z up.

A *layout* says what one frame of a stream holds. Frames reach it as columns of lists (JSON) or as rows of
little-endian numbers (binary) and leave it as one array of rows ``t, hand.x, hand.y, hand.z, object.x, …``,
the same numbers whatever way they came.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from app.motion.trajectory import FARTHEST_M, Floats, is_sound
from app.service.geometry import Geometry
from app.service.session_errors import Code, FramesRefused, MessageMalformed

Encoding = Literal["json", "f32", "f64"]
HEADER = struct.Struct("<QII")
"""first_seq, n_frames, n_channels of a binary message."""
NO_TIMES: Floats = np.empty(0)
NEEDS_FINITE = "needs three finite coordinates, or none for a dropout"
LAST_SEQ = 2**53
"""No stream is longer: beyond it a JSON number is no longer exact."""
LARGEST = 2**1023
"""A whole number beyond this fits no float."""
FARTHEST_S = 1e11
"""A time farther out than this, over 3000 years, is in a wrong unit [s]."""


@dataclass(frozen=True)
class Layout:
    """What one frame of a stream holds: times unless ``rate_hz`` [Hz] gives them, a hand, named objects."""

    objects: tuple[str, ...]
    geometry: Geometry
    rate_hz: float | None = None
    encoding: Encoding = "json"

    @cached_property
    def tracks(self) -> tuple[str, ...]:
        """The fields of positions, in the order of the columns."""
        return ("hand", *(f"objects.{name}" for name in self.objects))

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """The columns of a binary message."""
        time = () if self.rate_hz is not None else ("t",)
        return time + tuple(f"{track}.{axis}" for track in ("hand", *self.objects) for axis in "xyz")


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of one message, as sent: ``first_seq`` counts frames of the stream from 0.

    times: (n_frames,) [s], empty where the layout has a rate; positions: (n_frames, n_tracks, 3) in the
    unit of the layout.
    """

    first_seq: int
    times: Floats
    positions: Floats

    def __len__(self) -> int:
        return len(self.positions)


def from_binary(layout: Layout, payload: bytes) -> Frames:
    """Read one binary message. Raises MessageMalformed where the header and the bytes do not agree."""
    if layout.encoding == "json":
        raise MessageMalformed(
            "binary_not_declared", "a binary message needs `encoding` f32 or f64 in `start`"
        )
    if len(payload) < HEADER.size:
        raise MessageMalformed(
            "binary_cut_short", f"{len(payload)} bytes are less than the {HEADER.size} of a header"
        )
    first_seq, n_frames, n_channels = HEADER.unpack_from(payload)
    if n_channels != len(layout.channels):
        raise MessageMalformed(
            "wrong_channels", f"the header says {n_channels} channels, the stream has {len(layout.channels)}"
        )
    dtype = np.dtype("<f4" if layout.encoding == "f32" else "<f8")
    wanted = HEADER.size + n_frames * n_channels * dtype.itemsize
    if len(payload) != wanted:
        code: Code = "binary_cut_short" if len(payload) < wanted else "binary_too_long"
        raise MessageMalformed(
            code,
            f"{n_frames} frames of {n_channels} {layout.encoding} channels take {wanted} bytes, "
            f"got {len(payload)}",
        )
    rows = np.frombuffer(payload, dtype, offset=HEADER.size).reshape(n_frames, n_channels).astype(np.float64)
    times = rows[:, 0] if layout.rate_hz is None else NO_TIMES
    positions = rows[:, n_channels - 3 * len(layout.tracks) :].reshape(n_frames, len(layout.tracks), 3)
    return _frames(first_seq, times, positions)


def from_columns(layout: Layout, first_seq: Any, times: Any, hand: Any, objects: Any) -> Frames:
    """Read the parsed fields of one JSON message. Raises MessageMalformed, which names the field."""
    if type(first_seq) is not int or not 0 <= first_seq <= LAST_SEQ:
        raise MessageMalformed("malformed", "`first_seq` must be a whole number, 0 or more")
    if (times is None) != (layout.rate_hz is not None):
        detail = (
            "is needed, `start` gave no `rate_hz`"
            if times is None
            else "is not sent where `start` gave `rate_hz`"
        )
        raise MessageMalformed("malformed", f"`t` {detail}")
    if not isinstance(objects, dict) or objects.keys() != set(layout.objects):
        raise MessageMalformed(
            "wrong_objects", f"`objects` must hold exactly {', '.join(layout.objects) or 'none'}"
        )
    values = (hand, *(objects[name] for name in layout.objects))
    tracks = [_track(*pair, first_seq) for pair in zip(layout.tracks, values, strict=True)]
    column = NO_TIMES if times is None else _times(times, first_seq)
    lengths = {len(track) for track in tracks} | (set() if times is None else {len(column)})
    if len(lengths) > 1:
        raise MessageMalformed("malformed", "`t`, `hand` and every object need the same number of frames")
    return _frames(first_seq, column, np.stack(tracks, axis=1))


def settle(layout: Layout, frames: Frames, skip: int, last_time: float) -> Floats:
    """Return frames ``skip`` and later as (n, 1 + 3 n_tracks) rows: times [s] and positions [m], Z up.

    last_time: time of the frame before them [s]. Raises FramesRefused, which names the field, the frame's
    place in the message and its number in the stream.
    """
    first_seq = frames.first_seq + skip
    times = frames.times[skip:]
    if layout.rate_hz is not None:
        with np.errstate(over="ignore"):
            times = np.arange(first_seq, frames.first_seq + len(frames)) / layout.rate_hz
    positions = layout.geometry.to_metres(frames.positions[skip:])
    rows = np.empty((len(times), 1 + 3 * len(layout.tracks)))
    rows[:, 0], rows[:, 1:] = times, positions.reshape(len(times), -1)
    if not is_sound(rows, last_time) or max(abs(times[0]), abs(times[-1])) > FARTHEST_S:
        _refuse(layout, times, positions, last_time, _Check(first_seq, skip))
    return rows


def _refuse(layout: Layout, times: Floats, positions: Floats, last_time: float, check: _Check) -> None:
    """Raise FramesRefused for what is wrong with frames."""
    check.none(~np.isfinite(times), "t", "non_finite", "is not a finite number of seconds")
    late = np.diff(times, prepend=last_time) <= 0
    check.none(late, "t", "times_not_increasing", "must be later than the frame before it")
    far = np.abs(times) > FARTHEST_S
    check.none(far, "t", "wrong_unit", f"lies over {FARTHEST_S:g} s from 0: a wrong unit of time?")
    for index, field in enumerate(layout.tracks):
        check.track(positions[:, index], field)


def _frames(first_seq: int, times: Floats, positions: Floats) -> Frames:
    if len(positions) == 0:
        raise MessageMalformed("malformed", "a `frames` message needs at least one frame")
    if first_seq > LAST_SEQ:
        raise MessageMalformed("malformed", f"`first_seq` {first_seq} is beyond any stream")
    return Frames(first_seq, times, positions)


def _track(field: str, values: Any, first_seq: int) -> Floats:
    """Null is a dropout; NaN, which some writers of JSON let through, is not."""
    rows: list[Any] = []
    for index, value in enumerate(_list(field, values)):
        if not (value is None or (type(value) is list and len(value) == 3 and all(map(_is_number, value)))):
            raise _malformed(field, index, first_seq, "a position [x, y, z], or null for a dropout")
        rows.append([0.0, 0.0, 0.0] if value is None else value)
    track = np.array(rows, dtype=np.float64).reshape(-1, 3)
    _Check(first_seq).none(~np.isfinite(track).all(axis=1), field, "non_finite", NEEDS_FINITE)
    return np.where([[value is None] for value in values], np.nan, track)


def _times(values: Any, first_seq: int) -> Floats:
    for index, value in enumerate(_list("t", values)):
        if not _is_number(value):
            raise _malformed("t", index, first_seq, "a number of seconds")
    return np.array(values, dtype=np.float64)


def _list(field: str, values: Any) -> list[Any]:
    if type(values) is not list or not values:
        raise MessageMalformed("malformed", f"`{field}` must be a list with an entry for each frame")
    return values


def _is_number(value: Any) -> bool:
    """Plain JSON numbers only: numpy would also take texts and booleans for numbers."""
    return type(value) is float or (type(value) is int and abs(value) <= LARGEST)


def _malformed(field: str, index: int, first_seq: int, wanted: str) -> MessageMalformed:
    detail = f"{field}, frame {index}: must be {wanted}"
    return MessageMalformed("malformed", detail, at_seq=first_seq + index)


@dataclass(frozen=True)
class _Check:
    """Refuses frames by name; the first one looked at has these numbers in the stream and in its message."""

    seq: int
    place: int = 0

    def none(self, bad: NDArray[np.bool_] | np.bool_, field: str, code: Code, detail: str) -> None:
        """Raise FramesRefused if any frame is bad; bad: (n_frames,)."""
        if bad.any():
            frame = int(np.argmax(bad))
            raise FramesRefused(
                code, f"{field}, frame {self.place + frame}: {detail}", at_seq=self.seq + frame
            )

    def track(self, positions: Floats, field: str) -> None:
        """Raise FramesRefused if a position is none; positions: (n_frames, 3) [m]."""
        missing = np.isnan(positions)
        broken = np.isinf(positions).any(axis=1) | (missing.any(axis=1) & ~missing.all(axis=1))
        self.none(broken, field, "non_finite", NEEDS_FINITE)
        far = (np.abs(positions) > FARTHEST_M).any(axis=1)
        self.none(far, field, "wrong_unit", f"lies over {FARTHEST_M:g} m away: a wrong length unit?")
