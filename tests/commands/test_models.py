"""``gesta models``, ``promote``, ``export`` and ``import``: what is on a server, and gets on another."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from app.client import GestaClient
from app.motion.model import Model
from tests.commands.conftest import Run
from tests.serving import Server


@pytest.fixture
def model(server: Server, trained: Model, request: pytest.FixtureRequest) -> str:
    """A model of the test's own, with two versions."""
    name: str = request.node.originalname
    server.teach(trained, name)
    return server.teach(trained, name)


def test_models_are_listed_with_their_aliases(run: Run, model: str, client: GestaClient) -> None:
    client.promote(model, "production", 2)
    client.promote(model, "best", 1)
    row = next(line for line in run("models").stdout.splitlines() if model in line)
    assert "best: 1, production: 2" in row
    assert row.split()[1:3] == ["object", "2"]
    told = json.loads(run("models", "--json").stdout)["models"]
    [listed] = [each for each in told if each["name"] == model]
    assert [version["version"] for version in listed["versions"]] == [2, 1]


def test_a_model_is_told_with_its_versions(run: Run, model: str, client: GestaClient) -> None:
    client.promote(model, "production", 1)
    told = run("models", model).stdout
    assert "objects: object; table at 0 m" in told
    assert "demonstrations: none" in told
    assert [line.split()[0] for line in told.splitlines()[-2:]] == ["2", "1"]
    assert "production" in told.splitlines()[-1]
    assert json.loads(run("models", model, "--json").stdout)["actions"] == {}


def test_a_version_is_promoted(run: Run, model: str, client: GestaClient) -> None:
    assert run("promote", model, 1).stdout == f"production of {model} is version 1\n"
    assert json.loads(run("promote", model, "latest", "--alias", "new", "--json").stdout)["version"] == 2
    assert run("promote", model, "new").exit_code == 0
    assert client.version(model, "production")["version"] == 2
    assert "version_not_found" in run("promote", model, 3, code=1).stderr


def test_a_version_goes_through_a_file(run: Run, model: str, client: GestaClient, tmp_path: Path) -> None:
    file = tmp_path / "version.json"
    assert "version 2" in run("export", model, "latest", file).stdout
    digest = client.version(model, 2)["digest"]
    assert f"sha256:{hashlib.sha256(file.read_bytes()).hexdigest()}" == digest
    assert json.loads(run("export", model, 1, file, "--json").stdout)["version"] == 1
    first = run("import", f"{model}-2", file)
    assert first.stdout == f"{file} is version 1 of {model}-2\n"
    assert "created" in first.stderr
    second = run("import", f"{model}-2", file, "--json")
    assert json.loads(second.stdout)["digest"] == digest
    assert second.stderr == ""


def test_what_is_no_version_is_not_taken(run: Run, model: str, tmp_path: Path) -> None:
    file = tmp_path / "other.json"
    for text in ("", "[]", '{"features": 1}'):
        file.write_text(text)
        assert "is no version of a model" in run("import", model, file, code=1).stderr
    file.write_text('{"features": {"objects": ["object"]}}')
    assert "artifact_invalid" in run("import", model, file, code=1).stderr
