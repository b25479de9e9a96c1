"""What the README tells a new user to type works, in its order, on a real server with a real worker."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from subprocess import Popen

import httpx
import pytest
from websockets.sync.client import connect

from app.settings import Settings
from tests.serving import ROOT, Server

README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.DOTALL | re.MULTILINE)


def curl(command: str) -> httpx.Response:
    """Do what this curl command does."""
    arguments = iter(shlex.split(command.replace("\\\n", " "))[1:])
    method, url, headers, body = None, "", {}, None
    for argument in arguments:
        if argument == "-X":
            method = next(arguments)
        elif argument == "-H":
            name, _, value = next(arguments).partition(": ")
            headers[name] = value
        elif argument == "-d":
            body = next(arguments)
        else:
            url = argument
    return httpx.request(method or ("GET" if body is None else "POST"), url, headers=headers, content=body)


def commands(script: str) -> list[str]:
    """Return the curl commands of a script, each with its continuation lines."""
    return re.findall(r"^curl (?:[^'\n\\]|\\\n|'[^']*')*", script, re.MULTILINE)


@pytest.fixture(scope="module")
def here(server: Server, worker: Popen[bytes]) -> str:
    """The address of a server that has a worker."""
    return server.url


def test_the_python_example_learns_recognises_and_re_enacts(here: str) -> None:
    [example] = blocks("python")
    command = [sys.executable, "-c", example.replace("http://127.0.0.1:8000", here)]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True, timeout=120)
    *segments, frames = done.stdout.splitlines()
    assert [line.split()[0] for line in (segments[0], segments[-1])] == ["grasp", "retract"]
    assert frames.endswith("frames to [0.1, 0.35, 0.04]")


def test_the_curl_examples_are_answered(here: str) -> None:
    [script] = blocks("bash")
    found = commands(script)
    assert len(found) == script.count("\ncurl ") + script.startswith("curl ")
    for command in found:
        answer = curl(command.replace("http://127.0.0.1:8000", here))
        assert answer.is_success, (command, answer.text)


def test_the_stream_by_hand_is_answered(here: str) -> None:
    [script] = blocks("json")
    with connect(here.replace("http", "ws") + "/v1/stream") as socket:
        for line in script.splitlines():
            socket.send(line)
        kinds = [json.loads(message)["type"] for message in socket]
    assert kinds[0] == "started"
    assert "flushed" in kinds
    assert kinds[-1] == "ended"


def test_the_table_of_settings_is_whole() -> None:
    told = set(re.findall(r"`GESTA_(\w+)`", README))
    assert told == {name.upper() for name in Settings.model_fields}


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", README):
        assert (ROOT / target).exists(), target
