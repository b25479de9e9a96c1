"""What is asked of the comparison, and whether it is met."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks import page
from benchmarks.comparison import REAL, SIMULATED, Comparison, Measure, told
from benchmarks.methods import OURS
from benchmarks.teaching import by_person

DELINEATED, SWEEPING, CLASSIFIED, EXTRA = 0.99, 0.97, 1.0, 0.01
"""Of the simulator's columns; the second of the sweeping one."""

AT_LEAST = {"by person": {"F1@50": 0.99, "F1@75": 0.92, "Frames": 0.97}, "by half": {"F1@50": 0.98}}
"""Of the folders' sequences, mean over folds."""

BOUNDARY = 60.0
"""At most, from person to person [ms]."""

AHEAD = {"Delineated": SIMULATED["Delineated"]} | {name: REAL[name] for name in ("F1@50", "F1@75", "Frames")}
"""The measures by which nobody may be ahead."""


def asked(compared: Comparison, folders: Sequence[Path]) -> list[page.Goal]:
    """Return what is asked of the columns that were run."""
    goals = [*_of_simulator(compared)]
    for folder in folders:
        goals += _of_folder(compared, folder)
    return [*goals, *_ahead(compared)]


def _of_simulator(compared: Comparison) -> Iterator[page.Goal]:
    for sweeping in (False, True):
        columns = [name for name in compared.simulated if name.startswith("sweeping") == sweeping]
        least = SWEEPING if sweeping else DELINEATED
        if columns:
            worst, where = min((_ours(compared, SIMULATED["Delineated"], name), name) for name in columns)
            what = "sweeping" if sweeping else "in every other condition"
            yield page.Goal(
                f"simulator: delineated ≥ {least:g}, {what}", f"{told(worst)} ({where})", worst >= least
            )
    if compared.simulated:
        classified = min(
            _ours(compared, SIMULATED["Classified, of the delineated"], name) for name in compared.simulated
        )
        yield page.Goal(
            "simulator: all delineated classified right", told(classified), classified >= CLASSIFIED
        )
        extra, where = max(
            (_ours(compared, SIMULATED["Sequences with an extra segment"], name), name)
            for name in compared.simulated
        )
        yield page.Goal(
            f"simulator: sequences with an extra segment ≤ {EXTRA:g}",
            f"{told(extra)} ({where})",
            extra <= EXTRA,
        )


def _of_folder(compared: Comparison, folder: Path) -> Iterator[page.Goal]:
    if folder.name not in compared.real:
        return
    people = by_person(folder)
    for measure, least in AT_LEAST["by person" if people else "by half"].items():
        value = _ours(compared, REAL[measure], folder.name)
        yield page.Goal(f"{folder.name}: {measure} ≥ {least:g}", told(value), value >= least)
    if people:
        error = compared.value(REAL["Boundary [ms]"], OURS, folder.name)
        met = error is not None and error <= BOUNDARY
        yield page.Goal(f"{folder.name}: boundary ≤ {BOUNDARY:g} ms", told(error), met)


def _ahead(compared: Comparison) -> Iterator[page.Goal]:
    for title, measure in AHEAD.items():
        columns = compared.simulated if title in SIMULATED else compared.real
        if columns:
            behind = sorted(
                f"{method} ({column})"
                for column in columns
                for method in compared.methods
                if (compared.value(measure, method, column) or 0.0) > _ours(compared, measure, column)
            )
            yield page.Goal(
                f"{title}: no other method ahead in any column", "; ".join(behind) or "none", not behind
            )


def _ours(compared: Comparison, measure: Measure, column: str) -> float:
    return compared.value(measure, OURS, column) or 0.0
