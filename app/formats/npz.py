"""NumPy archives: ``times`` (n,) in seconds, and each other array (n, 3) a track by its name.

Length unit and up axis are declared by the caller; NaN is a dropout.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from app.formats.capture import Capture, Declared, resolve
from app.formats.errors import Unreadable, read_by

NAME, TITLE = "npz", "NPZ"


def read(path: Path, declared: Declared) -> Capture:
    """Return the recording in a file. Raises FormatError."""
    geometry = resolve(TITLE, declared)
    with read_by("numpy"), path.open("rb") as file, np.load(file) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name, array in arrays.items():
        if array.dtype.kind not in "iuf":
            raise Unreadable(name, f"holds {array.dtype}, needs numbers")
    if "times" not in arrays or arrays["times"].ndim != 1:
        raise Unreadable("times", "needs an array times of shape (n,) in seconds")
    times = arrays.pop("times").astype(np.float64)
    shape = (len(times), 3)
    for name, array in arrays.items():
        if array.shape != shape:
            raise Unreadable(name, f"has shape {array.shape}, needs {shape}")
    tracks = {name: geometry.to_metres(array.astype(np.float64)) for name, array in arrays.items()}
    return Capture(NAME, times, np.arange(len(times)), tracks)
