"""``gesta models``: what is on a server."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import typer

from app.client import GestaClient, Message
from app.commands.asking import URL, Url, asking
from app.commands.terminal import AsJson, show, show_json, show_table


def models(
    name: Annotated[str | None, typer.Argument(help="A model to tell more of.")] = None,
    as_json: AsJson = False,
    url: Url = URL,
) -> None:
    """List the models with their aliases, or the versions of one."""
    with asking(url) as client:
        if name is None:
            told = [_with_versions(client, model) for model in client.pages("/models", "models")]
            show_json({"models": told}) if as_json else _show_all(told)
        else:
            model = _with_versions(client, client.model(name))
            show_json(model) if as_json else _show_one(model)


def _with_versions(client: GestaClient, model: Mapping[str, Any]) -> Message:
    return {**model, "versions": list(client.pages(f"/models/{model['name']}/versions", "versions"))}


def _show_all(told: list[Message]) -> None:
    rows = [
        (
            model["name"],
            ", ".join(model["objects"]),
            len(model["versions"]),
            ", ".join(_aliases(model)),
            model["versions"][0]["created_at"][:16] if model["versions"] else None,
        )
        for model in told
    ]
    show_table(("model", "objects", "versions", "aliases", "newest"), *rows)


def _show_one(model: Message) -> None:
    shown = ", ".join(f"{action} {count}" for action, count in model["actions"].items())
    show(
        f"{model['name']}: {model['description'] or 'no description'}",
        f"objects: {', '.join(model['objects']) or 'none'}; table at {model['table_height_m']:g} m",
        f"demonstrations: {shown or 'none'}",
    )
    rows = [
        (
            version["version"],
            ", ".join(version["aliases"]),
            (version["evaluation"] or {}).get("accuracy"),
            ", ".join(version["actions"]),
            len(version["demonstrations"]),
            version["created_at"][:16],
        )
        for version in model["versions"]
    ]
    show_table(("version", "aliases", "accuracy", "actions", "demonstrations", "created"), *rows)


def _aliases(model: Message) -> list[str]:
    """Return ``alias: version`` of each."""
    return sorted(f"{alias}: {each['version']}" for each in model["versions"] for alias in each["aliases"])
