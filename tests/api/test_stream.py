"""The stream of the real server: what a client sends becomes what offline recognition finds."""

from __future__ import annotations

import pytest

from app.motion.model import Model
from app.motion.simulation import recording
from tests.serving import Server
from tests.talking import expected, talking

MOTION = recording(5, 5).trajectory


@pytest.mark.usefixtures("table_top")
class TestStream:
    @pytest.mark.parametrize("chunk", [1, 10, 500])
    def test_segments_are_those_of_offline_recognition(
        self, server: Server, trained: Model, chunk: int
    ) -> None:
        with talking(server) as talk:
            talk.start()
            talk.frames(MOTION, chunk=chunk)
            talk.say("end", last_seq=len(MOTION) - 1)
            talk.rest()
            durable = [message for message in talk.heard if "event" in message]
            assert durable[:-1] == expected(trained, MOTION)
            assert durable[-1] == {"type": "ended", "event": 4, "segments": 4, "frames": len(MOTION)}
            assert talk.closed_with == 1000
            print(talk.heard)
