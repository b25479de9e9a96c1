"""Bags: MCAP files, ROS 1 ``.bag`` files, ROS 2 bags (a ``.db3`` file, or the folder around its files).

Each topic has times of its own. Those of the topic with the most messages are the recording's; the others are
interpolated linearly between the two messages about each, and are missing where these are further than three
of the topic's periods apart. Times count from the first message's stamp.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mcap.reader import make_reader
from rosbags import rosbag1, rosbag2

from app.formats.capture import Capture, Declared, Geometry, resolve
from app.formats.errors import Unreadable, read_by
from app.formats.messages import NANOSECONDS, PLACES, Encoding, Stream, Streams

if TYPE_CHECKING:
    from app.motion.trajectory import Floats, Indices

MCAP, BAG, BAG2 = "mcap", "rosbag1", "rosbag2"

ENCODINGS: dict[str, Encoding] = {"cdr": "cdr", "ros1": "ros1"}
"""Of MCAP messages, those that are read."""

PERIODS = 3.0
"""A longer pause between two messages is a dropout."""


def read_mcap(path: Path, declared: Declared) -> Capture:
    """Return the recording in an MCAP file. Raises FormatError."""
    streams = Streams()
    with read_by("mcap"), path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(
            log_time_order=False
        ):
            encoding = ENCODINGS.get(channel.message_encoding)
            if schema and encoding:
                streams.add(channel.topic, schema.name, encoding, message.log_time, message.data)
            else:
                streams.topics[channel.topic] = f"{channel.message_encoding} messages"
        return _capture(MCAP, "MCAP", streams, declared)


def read_rosbag1(path: Path, declared: Declared) -> Capture:
    """Return the recording in a ROS 1 bag. Raises FormatError."""
    streams = Streams()
    with read_by("rosbags"), rosbag1.Reader(path) as reader:
        for connection, logged, content in reader.messages():
            streams.add(connection.topic, connection.msgtype, "ros1", logged, content)
        return _capture(BAG, "ROS 1 bag", streams, declared)


def read_rosbag2(path: Path, declared: Declared) -> Capture:
    """Return the recording in a ROS 2 bag. Raises FormatError."""
    streams = Streams()
    with read_by("rosbags"), rosbag2.Reader(path) as reader:
        for connection, logged, content in reader.messages():
            streams.add(connection.topic, connection.msgtype, "cdr", logged, content)
        return _capture(BAG2, "ROS 2 bag", streams, declared)


def _capture(name: str, title: str, streams: Streams, declared: Declared) -> Capture:
    geometry = resolve(title, declared, "m", "z")
    if not streams.of:
        there = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(streams.topics.items())) or "none"
        raise Unreadable("", f"has no topic with positions; topics are {there}; read are {', '.join(PLACES)}")
    notes = [f"{streams.n_unstamped} messages have no stamp: taken as of their log time"] * bool(
        streams.n_unstamped
    )
    turning = [name for name, stream in streams if len(stream.systems) > 1]
    notes += [f"{name} changes its coordinate system: not read" for name in turning]
    tracks = {
        name: _in_order(name, stream, geometry, notes) for name, stream in streams if name not in turning
    }
    if not tracks:
        raise Unreadable("", "; ".join(notes))
    base = max(tracks, key=lambda name: len(tracks[name][0]))
    stamps = tracks[base][0]
    others = [name for name, (own, _) in tracks.items() if not np.array_equal(own, stamps)]
    if others:
        notes.append(f"interpolated to the times of {base}: {', '.join(others)}")
    notes.append(f"times count from {stamps[0] / NANOSECONDS:.9f} s")
    return Capture(
        name,
        (stamps - stamps[0]) / NANOSECONDS,
        np.arange(len(stamps)),
        {name: _onto(stamps, *track) for name, track in tracks.items()},
        notes=tuple(notes),
        systems={name: next(iter(streams.of[name].systems)) for name in tracks},
    )


def _in_order(name: str, stream: Stream, geometry: Geometry, notes: list[str]) -> tuple[Indices, Floats]:
    """Return stamps (n,) [ns] and positions (n, 3) [m] in order of time, one each."""
    stamps, first = np.unique(np.array(stream.stamps, dtype=np.int64), return_index=True)
    if len(stamps) < len(stream.stamps):
        notes.append(f"{name}: {len(stream.stamps) - len(stamps)} messages of a stamp that was there already")
    return stamps, geometry.to_metres(np.array(stream.positions)[first])


def _onto(stamps: Indices, own: Indices, positions: Floats) -> Floats:
    """Return the positions (n, 3) at other stamps (m,) as (m, 3), NaN where there is nothing near."""
    if np.array_equal(own, stamps):
        return positions
    if len(own) < 2:
        return np.where((stamps == own[0])[:, None], positions[0], np.nan)
    after = np.clip(np.searchsorted(own, stamps), 1, len(own) - 1)
    pause = own[after] - own[after - 1]
    share = ((stamps - own[after - 1]) / pause)[:, None]
    between = positions[after - 1] * (1.0 - share) + positions[after] * share
    near = (stamps > own[0]) & (stamps < own[-1]) & (pause <= PERIODS * np.median(np.diff(own)))
    found = np.where(near[:, None], between, np.nan)
    _, at, at_own = np.intersect1d(stamps, own, assume_unique=True, return_indices=True)
    found[at] = positions[at_own]
    return found
