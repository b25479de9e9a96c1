"""Motion as the wire carries it."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Message = dict[str, Any]
Encoding = Literal["json", "f32", "f64"]
Floats = NDArray[np.float64]
METRES = {"length_unit": "m", "up_axis": "z"}
SUBPROTOCOL = "gesta.v1"
HEADER = struct.Struct("<QII")


def trajectory(times: ArrayLike, hand: ArrayLike, objects: Mapping[str, ArrayLike] | None = None) -> Message:
    """Return a trajectory as JSON values; a position with NaN becomes null, a dropout.

    times: (n_frames,) [s]; hand and each object: (n_frames, 3) in the unit of the upload.
    """
    tracks = {name: positions(track) for name, track in (objects or {}).items()}
    return {"t": np.asarray(times, float).tolist(), "hand": positions(hand), "objects": tracks}


def positions(track: ArrayLike) -> list[list[float] | None]:
    """Return positions (n, 3) as JSON values."""
    rows = np.asarray(track, float)
    missing = np.isnan(rows).any(axis=1)
    return [None if lost else row for row, lost in zip(rows.tolist(), missing.tolist(), strict=True)]


def json_frames(first_seq: int, times: Floats | None, tracks: Mapping[str, Floats]) -> str:
    """Return a ``frames`` message; times: (n,) [s], None where ``start`` gave ``rate_hz``."""
    objects = {name: positions(track) for name, track in tracks.items() if name != "hand"}
    message: Message = {"type": "frames", "first_seq": first_seq, "hand": positions(tracks["hand"])}
    message |= {"objects": objects} | ({} if times is None else {"t": times.tolist()})
    return json.dumps(message, separators=(",", ":"))


def binary_frames(
    first_seq: int,
    times: Floats | None,
    tracks: Mapping[str, Floats],
    channels: Iterable[str],
    encoding: Encoding,
) -> bytes:
    """Return a binary message; its columns are ``started.channels``."""
    names = dict.fromkeys(channel.rpartition(".")[0] for channel in channels if channel != "t")
    columns = [*([] if times is None else [times[:, None]]), *(tracks[name] for name in names)]
    rows = np.concatenate(columns, axis=1)
    return HEADER.pack(first_seq, *rows.shape) + rows.astype("<f4" if encoding == "f32" else "<f8").tobytes()
