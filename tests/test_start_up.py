"""What a server and its worker load when they start, and that `gesta warm` leaves nothing to compile."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TIMEOUT_S = 300

LOADED = "import json, sys\n{}\nprint(json.dumps(sorted(sys.modules)))"
SERVER = "import app.cli, app.main, app.api.stream_server"
WORKER = "import app.cli, app.service.worker"

JOBS = """
from dataclasses import replace
import numpy as np
from app.service.frames import Frames, Layout, settle
from app.service.geometry import Geometry
from app.motion.evaluation import evaluate
from app.motion.generation import generate
from app.motion.model import FeatureSpecification
from app.motion.recogniser import Recogniser, recognise
from app.motion.simulation import demonstrations, recording
from app.motion.training import TrainingOptions, fit_model
from app.motion.validation import cross_validate
from app.registry.artifacts import dump_model, load_model

shown = [d for d in demonstrations(1)][::12]
options = TrainingOptions()
model = fit_model(shown, FeatureSpecification(("object",)), options)
fit_model(shown, model.features, options, base=model, learned=range(0, len(shown), 2))
cross_validate(model, shown, options)
model = load_model(dump_model(model))
motion = recording(2, 2)
seen = {"a": motion.trajectory.objects["object"], "b": motion.trajectory.hand}
two = replace(motion.trajectory, objects=seen)
for trajectory in (motion.trajectory, two):
    for method in ("viterbi", "steps", "greedy"):
        recognise(model, trajectory, method=method)
recogniser = Recogniser(model, rate=100.0)
for at in range(0, len(motion.trajectory), 5):
    recogniser.push(motion.trajectory.part(at, at + 5))
    recogniser.hypothesis()
sent = Frames(0, motion.trajectory.times, np.stack([motion.trajectory.hand, seen["a"]], axis=1))
rows = settle(Layout(("object",), Geometry()), sent, 0, -1.0)
Recogniser(model).take(rows[:, 0], rows[:, 1:].reshape(len(rows), -1, 3))
evaluate([(motion.trajectory.times, motion.segments, motion.segments)])
for method in ("default", "paper"):
    generate(model, model.names[0], [0, 0, 0.02], [0.1, 0.35, 0.04], method=method)
"""


def run(command: list[str], **environment: str) -> str:
    ran = subprocess.run(
        [sys.executable, *command],
        cwd=ROOT,
        env={**os.environ, **environment},
        check=True,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
    return ran.stdout + ran.stderr


def kernels(folder: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("imports", "foreign"),
    [
        (
            SERVER,
            {
                "hmmlearn",
                "sklearn",
                "dbos",
                "httpx",
                "rich",
                "matplotlib",
                "obstore",
                "app.demo",
                "scipy.interpolate",
                "scipy.stats",
            },
        ),
        (WORKER, {"hmmlearn", "sklearn", "fastapi", "uvicorn", "pydantic_settings", "httpx", "app.demo"}),
    ],
)
def test_a_process_loads_only_what_it_is_for(imports: str, foreign: set[str]) -> None:
    assert foreign.isdisjoint(json.loads(run(["-c", LOADED.format(imports)])))


def test_after_warming_nothing_is_compiled(tmp_path: Path) -> None:
    assert "compiling" not in run(["-m", "app.cli", "warm"], NUMBA_CACHE_DIR=str(tmp_path))
    warmed = kernels(tmp_path)
    assert warmed
    run(["-c", JOBS], NUMBA_CACHE_DIR=str(tmp_path))
    assert kernels(tmp_path) == warmed


def test_a_server_without_a_cache_compiles_and_says_so(tmp_path: Path) -> None:
    start = "import logging; logging.basicConfig(); from app.motion.warming import warm_recognition as w; w()"
    cold, warm = (run(["-c", start], NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2))
    assert cold.count("`gesta warm` does it beforehand") == 1
    assert warm == ""
