"""Lines from datagrams where nobody takes them, and a server that is told that somebody is still there."""

from __future__ import annotations

import socket
import threading
import time
from typing import Any, cast

import numpy as np
import pytest

from app.client import Stream
from app.commands import frame_sources, live
from app.commands.frame_sources import lines_of_datagrams
from app.commands.live import Block


def test_datagrams_that_find_no_room_are_counted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(frame_sources, "N_WAITING", 2)
    lines = lines_of_datagrams("127.0.0.1:0", threading.Event())
    assert next(lines) == []
    port = int(capsys.readouterr().err.rpartition(":")[2])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number in range(5):
            sender.sendto(b"%d\n" % number, ("127.0.0.1", port))
    time.sleep(0.1)
    assert next(lines) == [b"0", b"1"]
    lines.close()
    assert "3 datagrams found no room" in capsys.readouterr().err


class Noting:
    """A stream that notes what it is asked to do."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *_: self.asked.append(name)


def test_a_server_is_told_that_we_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    def block(n_frames: int) -> Block:
        return Block(np.zeros(n_frames), np.zeros((n_frames, 3)), {})

    for silence_s, asked in ((1000.0, ["send", "end"]), (-1.0, ["flush", "send", "flush", "end"])):
        monkeypatch.setattr(live, "SILENCE_S", silence_s)
        stream = Noting()
        live._feed(cast(Stream, stream), [block(0), block(2), block(0)])
        assert stream.asked == asked
