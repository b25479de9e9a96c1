"""``gesta bridge``: what a program sends by a pipe, by UDP or by LSL gives what the recogniser gives."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app.motion.model import Model
from app.motion.simulation import recording
from app.motion.trajectory import Trajectory
from tests.client.cutting import Wire
from tests.commands.conftest import MOTION, Run, Start, as_lines, until_taken
from tests.serving import ROOT, Server
from tests.talking import expected

JSONL = ("bridge", "jsonl", "--model", "table-top", "--json")
OUTLET = Path(__file__).with_name("outlet.py")
pytestmark = pytest.mark.usefixtures("table_top")


class TestInput:
    def test_lines_give_what_the_recogniser_gives(self, start: Start, trained: Model) -> None:
        process = start(*JSONL, "--name", "rig")
        process.write(as_lines(MOTION))
        told, beside = process.finished()
        assert told[:-1] == expected(trained, MOTION)
        assert told[-1]["frames"] == len(MOTION)
        assert "no frames" not in beside

    def test_lines_in_another_geometry_at_a_rate(self, start: Start, trained: Model) -> None:
        process = start(*JSONL, "--unit", "mm", "--up", "y", "--rate", 100)
        lines = (json.loads(line) for line in as_lines(MOTION).splitlines())

        def turned(at: list[float] | None) -> list[float] | None:
            return None if at is None else [1000 * at[0], 1000 * at[2], -1000 * at[1]]

        for line in lines:
            objects = {name: turned(at) for name, at in line["objects"].items()}
            process.write(json.dumps({"hand": turned(line["hand"]), "objects": objects}) + "\n")
        told, _ = process.finished()
        wanted = expected(trained, MOTION, rate=100.0)
        assert [event.get("action") for event in told[:-1]] == [event.get("action") for event in wanted]
        assert [event.get("end_seq") for event in told[:-1]] == [event.get("end_seq") for event in wanted]

    def test_what_is_no_frame_is_told_and_left_out(self, start: Start, trained: Model) -> None:
        process = start(*JSONL)
        lines = as_lines(MOTION).splitlines(keepends=True)
        again, extra = lines[199], lines[300].replace('"object":', '"cup": null, "object":')
        process.write("garbage\n" + "".join(lines[:200]) + again + "".join(lines[200:300]) + extra)
        process.write('{"t": 99}\n' + "".join(lines[301:]))
        told, beside = process.finished()
        assert told[:-1] == expected(trained, MOTION)
        for why in (
            "line 1: is no JSON",
            "line 202: t 1.99 is not later",
            "line 304: needs the form",
            "cup was not",
        ):
            assert why in beside
        assert f"3 of {len(MOTION) + 3} lines were no frames" in beside

    def test_over_a_way_that_breaks(self, start: Start, trained: Model, wire: Wire) -> None:
        motion = recording(6, 12).trajectory
        process = start(*JSONL, url=wire.url)
        process.write(as_lines(motion, 0, 300))
        told = [process.first()]
        wire.cut()
        process.write(as_lines(motion, 300, 600))
        with wire.broken():
            process.write(as_lines(motion, 600, 900))
        process.write(as_lines(motion, 900))
        further, _ = process.finished()
        assert [*told, *further][:-1] == expected(trained, motion)

    def test_ctrl_c_awaits_the_last_segments(self, start: Start, trained: Model, server: Server) -> None:
        process = start(*JSONL)
        process.write(as_lines(MOTION, 0, 300))
        told = [process.first()]
        until_taken(server.url, process, 300)
        process.interrupt()
        further, _ = process.finished(open_input=True)
        assert [*told, *further][:-1] == expected(trained, MOTION.part(0, 300))

    def test_what_cannot_begin_says_why(self, start: Start) -> None:
        for words, lines, why in (
            (("--model", "nobody"), as_lines(MOTION, 0, 1), "model_not_found"),
            ((), "\n", "no frame came"),
            (("--udp", "nowhere"), "", "is no HOST:PORT"),
        ):
            process = start(*JSONL, *words)
            process.write(lines)
            told, beside = process.finished(code=1)
            assert (told, why in beside) == ([], True), beside


class TestDatagrams:
    def test_they_give_what_the_recogniser_gives(self, start: Start, trained: Model, server: Server) -> None:
        process = start(*JSONL, "--udp", "127.0.0.1:0")
        port = int(process.told(r"awaited at 127\.0\.0\.1:(\d+)"))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for first in range(0, len(MOTION), 3):
                sender.sendto(as_lines(MOTION, first, first + 3).encode(), ("127.0.0.1", port))
                time.sleep(0.002)
        until_taken(server.url, process, len(MOTION))
        process.interrupt()
        told, _ = process.finished()
        assert told[:-1] == expected(trained, MOTION)

    def test_they_wait_while_the_server_is_away(
        self, start: Start, trained: Model, server: Server, wire: Wire
    ) -> None:
        process = start(*JSONL, "--udp", "127.0.0.1:0", url=wire.url)
        port = int(process.told(r"awaited at 127\.0\.0\.1:(\d+)"))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:

            def send(start: int, stop: int) -> None:
                for at in range(start, stop):
                    sender.sendto(as_lines(MOTION, at, at + 1).encode(), ("127.0.0.1", port))
                    time.sleep(0.001)

            send(0, 200)
            told = [process.first()]
            with wire.broken():
                send(200, len(MOTION))
        until_taken(server.url, process, len(MOTION))
        process.interrupt()
        further, _ = process.finished()
        assert [*told, *further][:-1] == expected(trained, MOTION)

    def test_a_port_that_is_taken_is_told(self, start: Start) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(("127.0.0.1", 0))
            process = start(*JSONL, "--udp", "{}:{}".format(*taken.getsockname()))
            _, beside = process.finished(code=1)
        assert "in use" in beside


class TestLabStreamingLayer:
    def test_its_samples_give_what_the_recogniser_gives(
        self, start: Start, trained: Model, tmp_path: Path
    ) -> None:
        motion = MOTION.part(1, len(MOTION))  # to LSL, time 0 is now
        channels = "hand_X,hand_Y,hand_Z,object_X,object_Y,object_Z,pad"
        for rate in (
            0,
            100,
        ):  # irregular; regular, where LSL makes times of its own, which are the same nearly
            with Outlet(tmp_path, motion, f"rig-{rate}", channels, rate) as outlet:
                words = ("--model", "table-top", "--stream", f"rig-{rate}", "--json")
                process = start("bridge", "lsl", *words)
                told = [process.first()]
                outlet.wait(30)
                process.interrupt()
                further, _ = process.finished()
            found, wanted = [*told, *further][:-1], expected(trained, motion)
            assert [event.get("end_seq") for event in found] == [event.get("end_seq") for event in wanted]
            assert rate or found == wanted

    def test_channels_without_names_are_named(self, start: Start, trained: Model, tmp_path: Path) -> None:
        names = "-,hand.x,hand.y,hand.z,object.x,object.y"
        words = ("bridge", "lsl", "--model", "table-top", "--stream", "bare")
        with Outlet(tmp_path, MOTION, "bare", "") as outlet:
            for given, why in (
                ((), "0 have names"),
                (("--channels", names), "6 have names"),
                (("--channels", "a,b,c,d,e,f,g"), "no track is called hand"),
                (("--channels", "hand.x,hand.y,hand.z,object.x,object.y,object.z,-"), "declare it by --unit"),
            ):
                _, beside = start(*words, *given).finished(code=1)
                assert why in beside
            outlet.kill()

    def test_a_stream_that_is_not_there_is_told(self, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("app.commands.lsl.FIND_S", 0.2)
        words = ("bridge", "lsl", "--model", "table-top", "--stream", "none")
        assert "no LSL stream called none" in run(*words, code=1).stderr
        monkeypatch.setattr("app.commands.lsl.find_spec", lambda name: None)
        assert "pip install 'gesta[lsl]'" in run(*words, code=1).stderr


class Outlet:
    """A program that streams a motion by LSL as soon as somebody listens, in a process of its own."""

    def __init__(self, folder: Path, motion: Trajectory, name: str, channels: str, rate: int = 100) -> None:
        lines = folder / "frames.jsonl"
        lines.write_text(as_lines(motion))
        self._command = [sys.executable, str(OUTLET), name, channels, str(lines), str(rate)]

    def __enter__(self) -> subprocess.Popen[bytes]:
        self._process = subprocess.Popen(self._command, cwd=ROOT, stderr=subprocess.DEVNULL)
        return self._process

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
