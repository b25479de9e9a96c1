"""Tables read back what was written, bit for bit."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.formats import table
from app.motion.generation import GeneratedMotion
from app.motion.trajectory import Floats
from tests.formats.motions import minimum_jerk

values = arrays(np.float64, (5, 13), elements=st.floats(allow_nan=False, allow_infinity=False))


def columns(motion: GeneratedMotion) -> Floats:
    return np.column_stack(
        [motion.times, motion.positions, motion.velocities, motion.accelerations, motion.std]
    )


def test_the_header_names_the_columns() -> None:
    header, *rows = csv.reader(io.StringIO(table.csv(minimum_jerk(20)), newline=""))
    assert ",".join(header) == "t,x,y,z,vx,vy,vz,ax,ay,az,std_x,std_y,std_z"
    assert [len(row) for row in rows] == 20 * [13]


def test_lines_end_as_rfc_4180_has_it() -> None:
    written = table.csv(minimum_jerk(20))
    assert written.count("\r\n") == written.count("\n") == 21
    assert written.endswith("\r\n")


@given(values)
def test_every_number_reads_back_exactly(drawn: Floats) -> None:
    motion = GeneratedMotion(drawn[:, 0], drawn[:, 1:4], drawn[:, 4:7], drawn[:, 7:10], drawn[:, 10:])
    _, *rows = csv.reader(io.StringIO(table.csv(motion), newline=""))
    assert np.array(rows, dtype=np.float64).tobytes() == drawn.tobytes()


@pytest.mark.parametrize("n_frames", [2, 1000])
def test_numpy_reads_it(n_frames: int) -> None:
    motion = minimum_jerk(n_frames)
    read = np.loadtxt(io.StringIO(table.csv(motion)), delimiter=",", skiprows=1)
    assert read.tobytes() == columns(motion).tobytes()
