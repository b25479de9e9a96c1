"""``gesta export`` and ``gesta import``: versions as files, from one server to another."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Annotated
from urllib.parse import quote

import httpx
import typer

from app.client import GestaClient
from app.commands.asking import URL, Model, Url, asking, create_if_absent
from app.commands.terminal import AsJson, failure, show, show_json


def export(
    model: Model,
    version: Annotated[str, typer.Argument(help="A number, an alias or `latest`.")],
    file: Annotated[Path, typer.Argument(help="The file to write.")],
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Write a version to a file, which any server takes."""
    with asking(url) as client:
        told = client.version(model, version)
        content = _artifact(client, model, told["version"])
        if f"sha256:{hashlib.sha256(content).hexdigest()}" != told["digest"]:
            raise failure(f"what came of {model}, version {told['version']}, is not what it should be")
        file.write_bytes(content)
    if as_json:
        show_json({"file": str(file), **{name: told[name] for name in ("model", "version", "digest")}})
    else:
        show(f"{file}: {model}, version {told['version']}, {len(content)} bytes")


def take_in(
    model: Model,
    file: Annotated[Path, typer.Argument(help="What `gesta export` wrote.")],
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Make a file the next version of a model, which is created if there is none."""
    with asking(url) as client:
        try:
            artifact = json.loads(file.read_bytes())
            objects = artifact["features"]["objects"]
        except (ValueError, LookupError, TypeError) as error:
            raise failure(f"{file} is no version of a model: gesta export writes them") from error
        create_if_absent(client, model, objects)
        told = client.request("POST", f"/models/{quote(model, safe='')}/versions:import", artifact)
        show_json(told) if as_json else show(f"{file} is version {told['version']} of {model}")


def _artifact(client: GestaClient, model: str, number: int) -> bytes:
    """Return an artifact, byte for byte."""
    path = f"/v1/models/{quote(model, safe='')}/versions/{number}/artifact"
    answer = httpx.get(f"{client.url}{path}", timeout=60.0)
    answer.raise_for_status()
    return answer.content
