"""What the guides tell to type is answered, in their order, by a real server with a real worker."""

from __future__ import annotations

import json
import re
from pathlib import Path
from subprocess import Popen

import pytest
from websockets.sync.client import connect

from app.client import GestaClient
from app.motion.model import Model
from tests.api.conftest import Sent
from tests.api.test_readme import commands, curl
from tests.serving import ROOT, Server

GUIDES = sorted((ROOT / "docs").glob("*.md"))


def blocks(guide: str, language: str) -> list[str]:
    text = (ROOT / "docs" / guide).read_text()
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def trained_here(server: Server, trained: Model, sent: list[Sent]) -> None:
    """The model that the guides speak of has a version, and demonstrations."""
    server.teach(trained, "table-top")
    with GestaClient(server.url) as client:
        client.add_demonstrations("table-top", sent)


def test_the_api_by_use_is_answered(server: Server, worker: Popen[bytes], trained_here: None) -> None:
    script = "".join(blocks("api.md", "bash"))
    found = commands(script)
    assert len(found) == script.count("curl ") > 10
    for command in found:
        answer = curl(command.replace("http://127.0.0.1:8000", server.url))
        assert answer.is_success, (command, answer.text)


def test_the_stream_by_use_is_answered(server: Server, trained_here: None) -> None:
    lines = [line for block in blocks("wire.md", "json") for line in block.splitlines()]
    with connect(server.url.replace("http", "ws") + "/v1/stream") as socket:
        for line in lines:
            socket.send(line)
        told = [json.loads(message) for message in socket]
    kinds = [message["type"] for message in told]
    assert kinds[0] == "started"
    assert {"gap", "pong", "flushed"} <= set(kinds)
    assert told[-1] == {"type": "ended", "event": told[-1]["event"], "segments": 0, "frames": 3}


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.name)
def test_links_lead_somewhere(guide: Path) -> None:
    text = guide.read_text()
    for target, _, place in re.findall(r"\]\((?!http)([^)#]*)(#([^)]*))?\)", text):
        path = guide.parent / target if target else guide
        assert path.exists(), target
        if place:
            headings = re.findall(r"^#+ (.*)$", path.read_text(), re.MULTILINE)
            assert place in {re.sub(r"[^\w -]", "", each).lower().replace(" ", "-") for each in headings}
