"""How commands end: 0, 1 with the reason in words, 2 where they were given wrongly; and what they load."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from app.cli import COMMANDS
from tests.commands.conftest import SEEN, gesta, write_body
from tests.serving import ROOT, Server

ENDS = ("--start", "0,0,0", "--goal", "0,0,1")
ASKING = [
    ("models",),
    ("models", "table-top"),
    ("promote", "table-top", 1),
    ("export", "table-top", 1, "{folder}/version.json"),
    ("import", "table-top", "{body}"),
    ("generate", "table-top", "grasp", *ENDS),
    ("evaluate", "table-top", "{body}"),
    ("train", "table-top", "{body}"),
    ("segment", "{body}", "--model", "table-top"),
    ("replay", "{body}", "--model", "table-top"),
    ("bridge", "jsonl", "--model", "table-top"),
]


class Elsewhere(BaseHTTPRequestHandler):
    """Another server, which knows nothing of what it is asked."""

    def do_GET(self) -> None:
        content = b"<html>nothing here</html>"
        self.send_response(200 if self.path.startswith("/welcome") else 404)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    do_POST = do_PUT = do_GET  # noqa: N815

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 (so it is called)
        """Say nothing."""


@pytest.fixture(scope="module")
def elsewhere() -> Iterator[str]:
    with HTTPServer(("127.0.0.1", 0), Elsewhere) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.mark.parametrize("words", ASKING, ids=lambda words: "-".join(map(str, words[:2])))
def test_where_no_gesta_answers_it_is_told(words: tuple[object, ...], elsewhere: str, tmp_path: Path) -> None:
    body = write_body(tmp_path / "seen.json", SEEN, labelled=True)
    if words[0] == "import":
        body.write_text('{"features": {"objects": []}}')
    given = [str(word).format(folder=tmp_path, body=body) for word in words]
    for url, why in (
        ("http://127.0.0.1:9", "http://127.0.0.1:9 does not answer"),
        (elsewhere, "404"),
        (f"{elsewhere}/welcome", "is no Gesta server"),
        ("nowhere", "nowhere does not answer"),
    ):
        outcome = gesta(*given, url=url)
        assert (outcome.exit_code, outcome.stdout) == (1, "")
        assert why in outcome.stderr


@pytest.mark.parametrize(
    "words",
    [("modls",), ("models", "a", "b"), ("replay",), ("bridge",), ("bridge", "natnet"), ("promote", "m")],
)
def test_what_is_no_command_is_wrong_usage(words: tuple[str, ...]) -> None:
    outcome = gesta(*words)
    assert outcome.exit_code == 2
    assert "Usage: " in outcome.output


def test_who_reads_no_further_ends_it_in_order(server: Server, table_top: str, tmp_path: Path) -> None:
    body = write_body(tmp_path / "seen.json", SEEN)
    command = f"{sys.executable} -m app.cli replay {body} --model {table_top} --speed 0 --url {server.url}"
    ran = subprocess.run(
        ["bash", "-c", f"{command} | head -n 1"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert len(ran.stdout.splitlines()) == 1
    assert "Traceback" not in ran.stderr
    assert "does not answer" not in ran.stderr


def test_every_command_has_a_line_of_help() -> None:
    shown = gesta("--help").stdout
    for name in COMMANDS:
        assert (f"\n  {name} " in shown) == (name != "serve-on")
        assert gesta(name, "--help").exit_code == 0


def test_a_server_loads_nothing_of_a_client() -> None:
    loaded = "import json, sys, app.cli, app.commands.serve; print(json.dumps(sorted(sys.modules)))"
    ran = subprocess.run(
        [sys.executable, "-c", loaded], cwd=ROOT, check=True, capture_output=True, text=True, timeout=60
    )
    assert {"httpx", "rich", "websockets", "numpy", "app.client"}.isdisjoint(json.loads(ran.stdout))
