"""How fast it is: kernel, frame, training, start, and many streams at once.

python benchmarks/speed.py [--only PART ...] [--output PAGE]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.motion.warming import warm
from benchmarks import frame_speed, kernel_speed, load, page, start_up, training_speed

Section = Callable[[Path | None], tuple[str, list[page.Goal]]]

PARTS: dict[str, Section] = {
    "kernel": kernel_speed.section,
    "frame": frame_speed.section,
    "training": lambda _: training_speed.section(training_speed.measure()),
    "start": lambda _: start_up.section(start_up.measure()),
    "streams": lambda _: load.section(load.measure()),
}

INTRODUCTION = """\
All figures of a table are of one run of this program, and what counts are the ratios: these machines have two
cores, and other work on them."""


def main() -> None:
    """Measure, print and write the page; images go beside it."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    options.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="parts to measure")
    options.add_argument("--output", type=Path, help="page to write; images go beside it")
    given = options.parse_args()
    warm()
    texts, goals = [], []
    for part in given.only:
        page.tell(part)
        text, asked = PARTS[part](given.output.parent if given.output else None)
        texts.append(text)
        goals += asked
    page.publish("\n".join([page.heading("Speed", INTRODUCTION), page.goals(goals), *texts]), given.output)


if __name__ == "__main__":
    main()
