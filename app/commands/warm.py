"""``gesta warm``: what is compiled at the first use is compiled before it."""
# ruff: noqa: PLC0415 (`gesta --help` does not load it)

from __future__ import annotations


def warm_up() -> None:
    """Compile what is compiled, so that nothing is when a server starts; for the build of an image."""
    from app.motion.warming import warm

    warm()
