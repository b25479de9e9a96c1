"""What a benchmark writes: a page of Markdown that says how, of what and where it was measured."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]


def heading(title: str, text: str) -> str:
    """Return the head of a page: the command that makes it, the commit and the machine."""
    return f"""# {title}

{text}

Measured by `{_command()}` at commit {_commit()}, on {os.cpu_count()} cores of {_processor()}, Python \
{platform.python_version()}.
"""


@dataclass(frozen=True)
class Goal:
    """What is asked for, what was measured, and whether that will do."""

    asked: str
    measured: str
    met: bool


def goals(of: Iterable[Goal]) -> str:
    """Return the section on what is asked for."""
    rows = [(goal.asked, goal.measured, "yes" if goal.met else "**no**") for goal in of]
    return f"## Asked for\n\n{table(('asked', 'measured', 'met'), rows)}"


def table(names: Sequence[str], rows: Iterable[Sequence[str]], n_words: int = 1) -> str:
    """Return a table; its first columns hold words, the others figures."""
    rule = ["---" if column < n_words else "---:" for column in range(len(names))]
    return "\n".join("| " + " | ".join(row) + " |" for row in (names, rule, *rows)) + "\n"


def publish(page: str, output: Path | None) -> None:
    """Print the page, and write it where it is wanted."""
    print(page)
    if output is not None:
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(page)


def tell(text: str) -> None:
    """Say what goes on, beside the page."""
    print(text, file=sys.stderr, flush=True)


def _command() -> str:
    """Return the command, its paths as seen from the project."""
    words = [os.path.relpath(word, ROOT) if os.path.exists(word) else word for word in sys.argv]
    return shlex.join(["python", *words])


def _commit() -> str:
    if not (git := shutil.which("git")):
        return "unknown"
    commit, changes = (
        subprocess.run([git, *words], cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()
        for words in (("rev-parse", "--short", "HEAD"), ("status", "--porcelain", "--", "app/motion"))
    )
    return f"{commit or 'unknown'}{' (with changes to the core that are not committed)' if changes else ''}"


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
