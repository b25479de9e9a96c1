"""A client, a worker, and small uploads."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import count, groupby
from typing import Any

import numpy as np
import pytest

from app.client import GestaClient, trajectory
from app.motion.model import FeatureSpecification, Model
from app.motion.simulation import demonstrations
from app.motion.training import TrainingOptions, fit_model
from app.motion.trajectory import Demonstration
from tests.serving import ROOT, Server

Sent = tuple[str, dict[str, Any]]
NUMBERS = count()


def as_sent(demonstration: Demonstration) -> Sent:
    motion = demonstration.trajectory
    return demonstration.action, trajectory(motion.times, motion.hand, motion.objects)


@pytest.fixture(scope="session")
def shown() -> list[Demonstration]:
    """Four demonstrations of each class."""
    grouped = groupby(demonstrations(3), key=lambda demonstration: demonstration.action)
    return [demonstration for _, of_class in grouped for demonstration in list(of_class)[::13][:4]]


@pytest.fixture(scope="session")
def sent(shown: list[Demonstration]) -> list[Sent]:
    """The same as they are sent."""
    return [as_sent(demonstration) for demonstration in shown]


@pytest.fixture(scope="session")
def paired(shown: list[Demonstration]) -> Model:
    """A small model with two roles."""
    both = []
    for each in shown:
        motion, thing = each.trajectory, each.trajectory.objects["object"]
        objects = {"object": thing, "tool": thing + np.array([0.3, 0.0, 0.0])}
        both.append(replace(each, trajectory=replace(motion, objects=objects)))
    return fit_model(both, FeatureSpecification(("object", "tool")), TrainingOptions(n_states=4))


@pytest.fixture
def client(server: Server) -> Iterator[GestaClient]:
    """A client of the server."""
    with GestaClient(server.url) as opened:
        yield opened


@pytest.fixture
def new_model(client: GestaClient) -> Callable[..., str]:
    """Create a model of a name that no test has used."""

    def create(objects: tuple[str, ...] = ("object",), **fields: Any) -> str:
        return str(client.create_model(f"model-{next(NUMBERS)}", objects, **fields)["name"])

    return create


@contextmanager
def working(server: Server) -> Iterator[subprocess.Popen[bytes]]:
    """Run a worker on the server's database and store."""
    settings = {
        "GESTA_DATABASE_URL": server.database.url.render_as_string(hide_password=False),
        "GESTA_STORE_URL": server.store.url,
    }
    command = [sys.executable, "-m", "app.cli", "worker", "--parent", str(os.getpid())]
    with server.log.open("ab") as log:
        process = subprocess.Popen(command, cwd=ROOT, env={**os.environ, **settings}, stdout=log, stderr=log)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(30)


@pytest.fixture(scope="module")
def worker(server: Server) -> Iterator[subprocess.Popen[bytes]]:
    """A worker beside the server of the module."""
    with working(server) as process:
        yield process
