"""Where recordings are: files that are named, and what lies in and under folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from app.commands.recordings import BODY, LABELS, Unusable

BAG = "metadata.yaml"
"""What a folder holds that is a recording, a ROS 2 bag."""


def recordings(paths: Sequence[Path], *but: Path | None) -> list[Path]:
    """Return these files, and those of a known kind in and under these folders. Raises Unusable."""
    from app.formats.reading import FORMATS  # noqa: PLC0415 (`gesta --help` does not load it)

    kinds = {BODY, *(suffix for known in FORMATS for suffix in known.suffixes)}
    found: dict[Path, None] = {}
    for path in paths:
        if path.is_dir() and not (path / BAG).is_file():
            inside = (each for each in path.rglob("*") if _is_recording(each, kinds))
            found |= dict.fromkeys(sorted(inside))
        elif path.exists():
            found[path] = None
        else:
            raise Unusable(f"{path}: there is no such file or directory")
    others = {path.resolve() for path in but if path is not None}
    listed = [path for path in found if path.resolve() not in others]
    if not listed:
        raise Unusable(f"no recordings ({', '.join(sorted(kinds))}) in {', '.join(map(str, paths))}")
    return listed


def _is_recording(path: Path, kinds: set[str]) -> bool:
    """Whether a path under a folder is a recording: a file of a known kind, or a bag's folder."""
    if (path.parent / BAG).is_file() or path.name.lower().endswith(LABELS):
        return False
    return (path / BAG).is_file() if path.is_dir() else path.suffix.lower() in kinds
