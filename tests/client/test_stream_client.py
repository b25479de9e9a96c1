"""The streams of the client against the real server, over a way that breaks."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator

import numpy as np
import pytest

from app.client import AsyncGestaClient, AsyncStream, GestaClient, Stream, StreamError
from app.client.wire import Encoding
from app.motion.model import Model
from app.motion.simulation import recording
from tests.client.cutting import Wire, wire_to
from tests.serving import Server
from tests.talking import Message, checked, expected

MOTION = recording(5, 5).trajectory
pytestmark = pytest.mark.usefixtures("table_top")


@pytest.fixture
def wire(server: Server) -> Iterator[Wire]:
    with wire_to(server) as wire:
        yield wire


def push(stream: Stream, start: int, stop: int) -> None:
    part = MOTION.part(start, stop)
    stream.send(part.times, part.hand, part.objects)


async def push_async(stream: AsyncStream, start: int, stop: int) -> None:
    part = MOTION.part(start, stop)
    await stream.send(part.times, part.hand, part.objects)


def durable(messages: list[Message]) -> list[Message]:
    return [message for message in messages if "event" in message]


class TestStream:
    @pytest.mark.parametrize("encoding", ["json", "f64"])
    def test_streams(self, server: Server, trained: Model, encoding: Encoding) -> None:
        with GestaClient(server.url) as client, client.stream("table-top", encoding=encoding) as stream:
            push(stream, 0, len(MOTION))
            stream.flush("all")
            stream.end()
            messages = list(stream)
        assert durable(messages)[:-1] == expected(trained, MOTION)
        assert {"type": "flushed", "id": "all"} in messages
        assert messages[-1]["type"] == "ended"
        assert list(stream) == []
        for message in messages:
            checked(json.dumps(message))

    def test_goes_on_where_the_connection_was_cut(self, wire: Wire, trained: Model) -> None:
        with Stream(wire.url, "table-top", goals={"shelf": np.array([0.4, 0.2, 0.9])}) as stream:
            for start in range(0, 400, 50):
                push(stream, start, start + 50)
                if start % 100 == 0:
                    wire.cut()
            stream.flush(1)
            stream.end()
            wire.cut()
            push_on = [message for message in stream if message["type"] != "hypothesis"]
        assert durable(push_on)[:-1] == expected(trained, MOTION.part(0, 400))
        sessions = {message["session_id"] for message in push_on if message["type"] == "started"}
        assert len(sessions) == 1
        assert push_on[-1]["frames"] == 400

    def test_waits_until_the_server_can_be_reached_again(self, wire: Wire, trained: Model) -> None:
        with Stream(wire.url, "table-top") as stream:
            push(stream, 0, 200)
            with wire.broken():
                push(stream, 200, len(MOTION))
            stream.end()
            assert durable(list(stream))[:-1] == expected(trained, MOTION)

    def test_gives_up_where_it_must_not_reconnect(self, wire: Wire) -> None:
        with Stream(wire.url, "table-top", reconnect_s=0) as stream:
            push(stream, 0, 100)
            wire.cut()
            with pytest.raises(StreamError) as lost:
                list(stream)
            assert (lost.value.close_code, lost.value.code) == (1006, "connection_lost")
            with pytest.raises(StreamError):
                push(stream, 100, 200)

    def test_another_stream_goes_on_with_the_session(self, server: Server, trained: Model) -> None:
        with Stream(server.url, "table-top") as first:
            push(first, 0, 300)
            first.flush()
            heard = []
            for message in first:
                heard.append(message)
                if message["type"] == "flushed":
                    break
            resume = first.state.resume
        with Stream(server.url, "table-top", resume=resume) as second:
            assert second.state.next_seq == 300
            push(second, 300, len(MOTION))
            second.end()
            assert durable([*heard, *second])[:-1] == expected(trained, MOTION)

    def test_a_refused_start_raises(self, server: Server) -> None:
        with pytest.raises(StreamError) as refused, Stream(server.url, "unknown"):
            pass
        assert (refused.value.close_code, refused.value.code) == (4404, "model_not_found")

    def test_refused_frames_raise(self, server: Server) -> None:
        with Stream(server.url, "table-top") as stream:
            part = MOTION.part(0, 10)
            stream.send(part.times[::-1], part.hand, part.objects)
            with pytest.raises(StreamError) as refused:
                list(stream)
        assert refused.value.error is not None
        assert (refused.value.code, refused.value.error["at_seq"]) == ("times_not_increasing", 1)

    def test_a_stream_that_was_ended_by_another_takes_no_more(self, server: Server) -> None:
        with GestaClient(server.url) as client, client.stream("table-top") as stream:
            push(stream, 0, 50)
            client.end_session(stream.state.started["session_id"])
            assert list(stream)[-1]["type"] == "ended"
            with pytest.raises(StreamError, match="ended"):
                push(stream, 50, 100)

    def test_nobody_listens_at_that_address(self) -> None:
        with pytest.raises(OSError, match="refused"), Stream("http://127.0.0.1:9", "table-top"):
            pass

    def test_waits_while_too_many_frames_are_under_way(self, server: Server) -> None:
        motion = recording(7, 20).trajectory
        with Stream(server.url, "table-top", rate_hz=100, encoding="f32") as stream:
            stream.state.started["limits"]["max_unacked_frames"] = 400
            stream.state.started["limits"]["max_frames_per_message"] = 50
            stream.send(None, motion.hand, motion.objects)
            assert stream.state.through_seq >= len(motion) - 450
            stream.end()
            assert list(stream)[-1]["frames"] == len(motion)


class TestAsyncStream:
    def test_streams_and_goes_on_where_the_connection_was_cut(self, wire: Wire, trained: Model) -> None:
        async def run() -> list[Message]:
            async with AsyncGestaClient(wire.url) as client, client.stream("table-top") as stream:
                for start in range(0, 400, 50):
                    await push_async(stream, start, start + 50)
                    if start % 100 == 0:
                        wire.cut()
                await stream.flush(1)
                await stream.end()
                wire.cut()
                messages = [message async for message in stream]
                assert [message async for message in stream] == []
                return messages

        messages = asyncio.run(run())
        assert durable(messages)[:-1] == expected(trained, MOTION.part(0, 400))

    def test_waits_until_the_server_can_be_reached_again(self, wire: Wire, trained: Model) -> None:
        async def run() -> list[Message]:
            async with AsyncStream(wire.url, "table-top", encoding="json") as stream:
                await push_async(stream, 0, 200)
                with wire.broken():
                    await push_async(stream, 200, len(MOTION))
                await stream.end()
                return [message async for message in stream]

        assert durable(asyncio.run(run()))[:-1] == expected(trained, MOTION)

    def test_gives_up_where_it_must_not_reconnect(self, wire: Wire) -> None:
        async def run() -> None:
            async with AsyncStream(wire.url, "table-top", reconnect_s=0) as stream:
                await push_async(stream, 0, 100)
                wire.cut()
                with pytest.raises(StreamError):
                    async for _ in stream:
                        pass
                with pytest.raises(StreamError):
                    await push_async(stream, 100, 200)

        asyncio.run(run())

    def test_a_refused_start_raises(self, server: Server) -> None:
        async def run() -> None:
            async with AsyncStream(server.url, "unknown"):
                pass

        with pytest.raises(StreamError) as refused:
            asyncio.run(run())
        assert (refused.value.close_code, refused.value.code) == (4404, "model_not_found")

    def test_can_be_left_in_the_middle(self, wire: Wire) -> None:
        async def run() -> None:
            async with AsyncStream(wire.url, "table-top") as stream:
                await push_async(stream, 0, 100)
                with wire.broken():
                    await stream.close()

        asyncio.run(run())
