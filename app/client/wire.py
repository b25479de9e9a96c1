"""Motion as the wire carries it: JSON trajectories, and the state of a stream without its socket."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Message = dict[str, Any]
Encoding = Literal["json", "f32", "f64"]
METRES = {"length_unit": "m", "up_axis": "z"}
SUBPROTOCOL = "gesta.v1"
HEADER = struct.Struct("<QII")


def trajectory(times: ArrayLike, hand: ArrayLike, objects: Mapping[str, ArrayLike] | None = None) -> Message:
    """Return a trajectory as JSON values; a position with NaN becomes null, a dropout.

    times: (n_frames,) [s]; hand and each object: (n_frames, 3) in the unit of the upload.
    """
    tracks = {name: _positions(track) for name, track in (objects or {}).items()}
    return {"t": np.asarray(times, float).tolist(), "hand": _positions(hand), "objects": tracks}


class StreamState:
    """What a client keeps of one stream: the frames sent, those accepted, the last durable event.

    ``started`` is empty until the server has answered ``start``.
    """

    def __init__(self, start: Message) -> None:
        self.start = start
        self.started: Message = {}
        self.next_seq = 0
        self.through_seq = -1
        self.durable_seq = -1
        self.last_event = -1
        self.error: Message | None = None
        self.ended: Message | None = None

    @property
    def full(self) -> bool:
        """Whether so many frames are under way that the next must wait; none is sent before ``started``."""
        limit = self.started["limits"]["max_unacked_frames"] if self.started else 0
        return self.next_seq - 1 - self.through_seq >= limit

    def read(self, text: str | bytes) -> Message:
        """Return a message of the server and note what it tells."""
        message: Message = json.loads(text)
        kind = message["type"]
        if kind == "started":
            self.started = message
            self.next_seq = message["next_seq"]
            self.through_seq = message["next_seq"] - 1
        elif kind == "accepted":
            self.through_seq, self.durable_seq = message["through_seq"], message["durable_seq"]
        elif kind == "error":
            self.error = message
        elif kind == "ended":
            self.ended = message
        self.last_event = message.get("event", self.last_event)
        return message

    def frames(
        self, times: ArrayLike | None, hand: ArrayLike, objects: Mapping[str, ArrayLike]
    ) -> Iterator[str | bytes]:
        """Yield the messages that carry these frames, each counted as sent when it is asked for.

        times: (n,) [s], None where ``start`` gave ``rate_hz``; hand and each object: (n, 3).
        """
        tracks = {
            "hand": np.asarray(hand, float),
            **{name: np.asarray(objects[name], float) for name in objects},
        }
        stamps = None if times is None else np.asarray(times, float)
        most, n_frames = self.started["limits"]["max_frames_per_message"], len(tracks["hand"])
        most = min(most, self.started["limits"]["max_frame_bytes"] // (80 * len(tracks)))
        encode = self._json if self.start.get("encoding", "json") == "json" else self._binary
        for first in range(0, n_frames, most):
            part = slice(first, first + most)
            block = {name: track[part] for name, track in tracks.items()}
            message = encode(None if stamps is None else stamps[part], block)
            self.next_seq += len(block["hand"])
            yield message

    def _json(self, times: NDArray[np.float64] | None, tracks: Mapping[str, NDArray[np.float64]]) -> str:
        objects = {name: _positions(track) for name, track in tracks.items() if name != "hand"}
        message = {"type": "frames", "first_seq": self.next_seq, "hand": _positions(tracks["hand"])}
        message |= {"objects": objects} | ({} if times is None else {"t": times.tolist()})
        return json.dumps(message, separators=(",", ":"))

    def _binary(self, times: NDArray[np.float64] | None, tracks: Mapping[str, NDArray[np.float64]]) -> bytes:
        channels: Sequence[str] = self.started["channels"]
        names = dict.fromkeys(channel.rpartition(".")[0] for channel in channels if channel != "t")
        columns = [*([] if times is None else [times[:, None]]), *(tracks[name] for name in names)]
        rows = np.concatenate(columns, axis=1)
        dtype = "<f4" if self.start["encoding"] == "f32" else "<f8"
        return HEADER.pack(self.next_seq, *rows.shape) + rows.astype(dtype).tobytes()


def _positions(track: ArrayLike) -> list[list[float] | None]:
    rows = np.asarray(track, float)
    return [
        None if missing else row
        for row, missing in zip(rows.tolist(), np.isnan(rows).any(axis=1), strict=True)
    ]
