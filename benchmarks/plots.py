"""Curves for the pages; the same figures give the same file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

Curve = tuple[Sequence[float] | Sequence[str], Sequence[float]]


def curves(of: Mapping[str, Curve], x: str, y: str, file: Path, logarithmic: bool = False) -> None:
    """Draw curves by their titles into an SVG; x, y: what the axes show."""
    with mpl.rc_context({"svg.hashsalt": "gesta", "svg.fonttype": "path"}):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        axes = figure.subplots()
        for title, (at, values) in of.items():
            axes.plot(at, values, marker="o", label=title)
        if logarithmic:
            axes.set_xscale("log", base=2)
            axes.set_yscale("log", base=2)
        axes.set_xlabel(x)
        axes.set_ylabel(y)
        axes.grid(alpha=0.3)
        axes.legend()
        file.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(file, metadata={"Date": None})
