"""What a command tells: its result on standard output, everything else on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from app.client import Message

WIDE = 200
"""Columns of a table that is not shown at a terminal."""

AsJson = Annotated[bool, typer.Option("--json", help="Tell the result as JSON.")]


def tell(text: str, style: str = "") -> None:
    """Tell a line on standard error."""
    _beside().print(Text(printable(text), style), soft_wrap=True)


def failure(text: str) -> typer.Exit:
    """Tell why the command fails, and return its end: 1."""
    tell(text, "red")
    return typer.Exit(1)


def show(*lines: str) -> None:
    """Tell lines of the result."""
    for line in lines:
        sys.stdout.write(f"{printable(line)}\n")
    sys.stdout.flush()


def show_json(value: Any) -> None:
    """Tell the result, or a line of it, as JSON."""
    sys.stdout.write(f"{json.dumps(value)}\n")
    sys.stdout.flush()


def show_table(*rows: tuple[Any, ...], title: str | None = None) -> None:
    """Tell a table; its first row names the columns. Numbers stand on the right, None is left out."""
    headings, *body = rows
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, show_edge=False)
    for heading, *column in zip(headings, *body, strict=True):
        are_numbers = all(isinstance(value, int | float | None) for value in column)
        table.add_column(Text(heading), justify="right" if are_numbers else "left", overflow="fold")
    for row in body:
        table.add_row(*(Text(_cell(value)) for value in row))
    console = Console(highlight=False)
    console.width = console.width if console.is_terminal else WIDE
    console.print(table)


def printable(text: str) -> str:
    """Return a text without what would move a terminal's cursor, or worse."""
    return "".join(letter if letter.isprintable() or letter == "\n" else "\ufffd" for letter in text)


@contextmanager
def progress(what: str, *further: ProgressColumn, as_json: bool = False) -> Iterator[Progress]:
    """Give a progress bar on standard error, with further columns.

    What is told meanwhile goes above it, and so does a result that is shown at the same terminal. as_json:
    there the result is JSON, of which no line may be wrapped; it does without the bar.
    """
    together = sys.stdout.isatty()
    columns = (TextColumn("{task.description}"), BarColumn(24), *further, TimeElapsedColumn())
    with Progress(
        *columns, console=_beside(), redirect_stdout=together, disable=together and as_json
    ) as shown:
        shown.add_task(what, total=None, message="")
        yield shown


@contextmanager
def job_watched(what: str) -> Iterator[Callable[[Message], None]]:
    """Give what shows how far a job is, for ``GestaClient.result``."""
    with progress(what, TextColumn("{task.fields[message]}")) as shown:
        [task] = shown.task_ids

        def watch(job: Message) -> None:
            at = job["progress"]
            message = Text(printable(at["message"])).markup
            shown.update(task, completed=at["done"], total=at["total"] or None, message=message)

        yield watch


@cache
def _beside() -> Console:
    """Return the one console on standard error: a progress bar makes room for what it prints."""
    return Console(stderr=True, highlight=False)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    return "" if value is None else printable(str(value))
