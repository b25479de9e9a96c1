"""Frames from somewhere go into a stream, and what is recognised is told as it comes.

Ctrl-C and SIGTERM end the stream: no more frames go in, the last segments are awaited. A second one leaves at
once. A connection that breaks is made anew by the stream itself.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NamedTuple

from app.client import GestaError, Message, Stream
from app.commands.terminal import show, show_json, tell

if TYPE_CHECKING:
    from app.client.wire import Floats

SILENCE_S = 20.0
"""After so long without a frame the server is told that we are there [s]; it waits for a minute."""


class Block(NamedTuple):
    """Frames: times (n,) [s], None where the stream has a rate; hand, each object (n, 3), NaN a dropout."""

    times: Floats | None
    hand: Floats
    objects: Mapping[str, Floats]


@contextmanager
def until_stopped() -> Iterator[threading.Event]:
    """Give an event that Ctrl-C and SIGTERM set; the second of them interrupts."""
    stopped = threading.Event()

    def stop(number: int, _: object) -> None:
        stopped.set()
        signal.signal(number, signal.default_int_handler)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run(stream: Stream, blocks: Iterable[Block], as_json: bool, stopped: threading.Event) -> None:
    """Send blocks and tell what comes back until all is decided. Raises StreamError.

    blocks end by themselves once ``stopped`` is set.
    """
    with ThreadPoolExecutor(1) as pool:
        feeding = pool.submit(_feed, stream, blocks)
        try:
            for message in stream:
                _tell(message, as_json)
        except BaseException:
            stopped.set()
            stream.close()
            with suppress(GestaError):  # the same, heard while sending
                feeding.result()
            raise
        stopped.set()
        feeding.result()


def _feed(stream: Stream, blocks: Iterable[Block]) -> None:
    """Send every block, and the end; a source that fails ends the stream, too."""
    heard_of = time.monotonic()
    try:
        for block in blocks:
            if len(block.hand):
                stream.send(block.times, block.hand, block.objects)
            elif time.monotonic() - heard_of > SILENCE_S:
                stream.flush()
            else:
                continue
            heard_of = time.monotonic()
    finally:
        stream.end()


def _tell(message: Message, as_json: bool) -> None:
    kind = message["type"]
    if kind == "warning":
        tell(f"{message['code']}: {message['detail']}", "yellow")
    elif kind == "going_away":
        tell("the server is about to stop: the stream goes on as soon as one answers", "yellow")
    elif kind == "started":
        tell(f"session {message['session_id']}, version {message['version']} of {message['model']}")
    elif "event" not in message:
        return
    elif as_json:
        show_json(message)
    elif kind == "segment":
        objects = ", ".join(f"{role}={name}" for role, name in message["objects"].items())
        show(
            f"{message['segment']:>4}  {message['t_start']:9.3f} {message['t_end']:9.3f}  "
            f"{message['action'] or 'unknown':<16} {objects}"
        )
    elif kind == "gap":
        tell(f"gap of {message['seconds']:.3f} s before frame {message['to_seq']}", "yellow")
    else:
        tell(f"{message['segments']} segments in {message['frames']} frames")
