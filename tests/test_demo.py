"""The demonstration, run against the real server as anybody runs it, only faster."""

from __future__ import annotations

import io
from pathlib import Path

import httpx
import pytest
from rich.console import Console
from typer.testing import CliRunner

from app.cli import cli
from app.demo import DemoFailed, run, serving

PNG = b"\x89PNG\r\n\x1a\n"


def test_five_actions_are_recognised_and_a_movement_is_drawn(tmp_path: Path) -> None:
    told = Console(file=io.StringIO(), width=120, record=True)
    shown = run(tmp_path / "demo", told, speed=20.0)
    truth = [segment.action for segment in shown.recording.segments]
    assert len(truth) == 5
    assert [segment["action"] for segment in shown.segments] == truth
    assert shown.picture.read_bytes().startswith(PNG)
    assert "Traceback" not in (tmp_path / "demo" / "server.log").read_text()
    text = told.export_text()
    assert "220 uploaded" in text
    assert text.count("s later") == 5
    assert str(shown.picture) in text


def test_its_server_stops_with_it(tmp_path: Path) -> None:
    with serving(tmp_path) as url:
        assert httpx.get(f"{url}/livez").status_code == 200
    with pytest.raises(httpx.ConnectError):
        httpx.get(f"{url}/livez")


def test_a_server_that_cannot_start_is_told_with_its_log(tmp_path: Path) -> None:
    (tmp_path / "gesta.db").mkdir()
    with pytest.raises(DemoFailed, match=r"server\.log"), serving(tmp_path):
        pass


def test_without_matplotlib_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.demo.find_spec", lambda name: None)
    outcome = CliRunner().invoke(cli, ["demo", "--folder", str(tmp_path / "demo")])
    assert outcome.exit_code == 1
    assert "pip install 'gesta[demo]'" in outcome.output
    assert not (tmp_path / "demo").exists()
