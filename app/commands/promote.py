"""``gesta promote``: which version a name is for."""

from __future__ import annotations

from typing import Annotated

import typer

from app.commands.asking import URL, Model, Url, asking
from app.commands.terminal import AsJson, show, show_json


def promote(
    model: Model,
    version: Annotated[str, typer.Argument(help="A number, an alias or `latest`.")],
    alias: Annotated[str, typer.Option(help="The name that it gets.")] = "production",
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """Let an alias name a version; streams that run keep theirs."""
    with asking(url) as client:
        number = client.version(model, version)["version"]
        told = client.promote(model, alias, number)
    show_json(told) if as_json else show(f"{alias} of {model} is version {number}")
