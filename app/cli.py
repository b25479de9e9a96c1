"""The command ``gesta``.

A command is a file of ``app.commands``, loaded only when it is asked for: a server loads nothing of the
worker or of a client, and none of them waits for the others' libraries. They end with 0 where all is well,
with 1 where something was refused or has failed, with 2 where a command was given wrongly.
"""

from __future__ import annotations

import logging
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

COMMANDS = {
    "serve": "app.commands.serve:serve",
    "serve-on": "app.commands.serve:serve_on",
    "worker": "app.commands.worker:worker",
    "demo": "app.demo:demo",
    "inspect": "app.commands.inspect:inspect",
    "train": "app.commands.train:train",
    "evaluate": "app.commands.evaluate:evaluate",
    "segment": "app.commands.segment:segment",
    "replay": "app.commands.replay:replay",
    "bridge": "app.commands.bridge:bridge",
    "generate": "app.commands.generate:generate",
    "models": "app.commands.models:models",
    "promote": "app.commands.promote:promote",
    "export": "app.commands.exchange:export",
    "import": "app.commands.exchange:take_in",
    "migrate": "app.commands.migrate:migrate",
    "backup": "app.commands.backup:backup",
    "restore": "app.commands.backup:restore",
    "sweep": "app.commands.sweep:sweep",
    "warm": "app.commands.warm:warm_up",
}
"""Where each command is: a function, or a typer of several."""

HIDDEN = ("serve-on",)
PLAIN: dict[str, Any] = {"pretty_exceptions_enable": False, "rich_markup_mode": None}
"""Help texts stand as they are written: ``[m]`` is a unit."""


class LateCommands(TyperGroup):
    """The commands by their names; each is loaded when it is asked for."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {name: TyperCommand(name) for name in COMMANDS}

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002 (typer gives it)
        """Return a command, None where there is none of the name."""
        if cmd_name not in COMMANDS:
            return None
        module, _, attribute = COMMANDS[cmd_name].partition(":")
        found = getattr(import_module(module), attribute)
        if isinstance(found, typer.Typer):
            return typer.main.get_command(found)
        alone = typer.Typer(add_completion=False, **PLAIN)
        alone.command(cmd_name, hidden=cmd_name in HIDDEN)(found)
        return typer.main.get_command(alone)


cli = typer.Typer(cls=LateCommands, no_args_is_help=True, **PLAIN)


@cli.callback()
def gesta() -> None:
    """Gesta learns actions from demonstrations, recognises them in streams, re-enacts them.

    Every command ends with 0 where all is well, with 1 where something was refused or has failed, with 2
    where it was given wrongly.
    """


def main() -> None:
    """Run the command; its log goes to standard error."""
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s", level=logging.INFO)
    for library in ("alembic", "dbos", "httpx"):
        logging.getLogger(library).setLevel(logging.WARNING)
    cli()


if __name__ == "__main__":
    main()
