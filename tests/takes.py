"""Simulated recordings as a lab has them: QTM's tables, and files of labels beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from app.motion.trajectory import Recording


def qtm_tsv(shown: Recording, gap: int | None = None) -> bytes:
    """Return a recording as QTM exports it, in millimetres; gap: a frame in which the hand is not seen."""
    motion, lines = shown.trajectory, []
    names = ("Hand top", "Box")
    axes = "\t".join(f"{name} {axis}" for name in names for axis in "XYZ")
    tracks = 1000.0 * np.hstack([motion.hand, motion.objects["object"]])
    for frame, (time, row) in enumerate(zip(motion.times, tracks, strict=True)):
        cells = [f"{value:.6f}" for value in row]
        if frame == gap:
            cells[:3] = [""] * 3
        lines.append("\t".join([str(frame + 1), f"{time:.6f}", *cells]))
    head = [
        f"NO_OF_FRAMES\t{len(lines)}",
        "NO_OF_MARKERS\t2",
        "FREQUENCY\t100",
        "MARKER_NAMES\t" + "\t".join(names),
        f"Frame\tTime\t{axes}",
    ]
    return "\n".join([*head, *lines, ""]).encode()


def write_take(shown: Recording, folder: Path, name: str, labelled: bool = True) -> None:
    """Write a recording and, beside it, its labels."""
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.tsv").write_bytes(qtm_tsv(shown))
    if labelled:
        times = shown.trajectory.times
        rows = [f"{each.action},{times[each.start]},{times[each.end]}" for each in shown.segments]
        (folder / f"{name}.labels.csv").write_text("\n".join(["action,start_s,end_s", *rows, ""]))
