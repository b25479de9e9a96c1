"""The house's table of rooms (DESIGN, section 1) and its rules, checked by reading the imports."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

HOUSE = Path(__file__).parents[1]


class Room(NamedTuple):
    """What a room may import besides itself and the standard library, and what of that it must not."""

    packages: tuple[str, ...] = ()
    of_the_house: tuple[str, ...] = ()
    must_not: tuple[str, ...] = ()


CLOCK = ("time", "datetime", "sched")
FILES = ("os", "pathlib", "io", "shutil", "tempfile", "glob", "fileinput", "mmap", "sqlite3")
WORLD = (
    "asyncio",
    "socket",
    "subprocess",
    "multiprocessing",
    "threading",
    "http",
    "urllib",
    "random",
    "secrets",
)
VALUES = ("app.motion.errors", "app.motion.trajectory", "app.motion.model", "app.motion.asked")
ROOMS = ("app.motion", "app.formats", "app.registry", "app.service", "app.api", "app.dashboard")

TABLE = {
    "app.motion": Room(
        ("numpy", "scipy", "numba", "llvmlite", "hmmlearn", "sklearn"), must_not=(*CLOCK, *FILES, *WORLD)
    ),
    "app.formats": Room(("numpy", "ezc3d", "mcap", "mcap_ros2", "rosbags"), VALUES),
    "app.registry": Room(("sqlalchemy", "alembic", "numpy", "obstore"), VALUES),
    "app.service": Room(("dbos", "numpy"), ("app.motion", "app.formats", "app.registry")),
    "app.api": Room(
        ("fastapi", "starlette", "pydantic", "uvicorn"),
        (
            *VALUES,
            "app.service",
            "app.registry.errors",
            "app.registry.records",
        ),
    ),
    "app.dashboard": Room(("starlette",)),
    "app.client": Room(("httpx", "websockets", "numpy")),
    "app.settings": Room(("pydantic", "pydantic_settings")),
    "app.main": Room(("fastapi", "starlette"), (*ROOMS, "app.settings")),
    "app.cli": Room(("typer",)),
    "app.commands": Room(
        ("typer", "rich", "httpx", "websockets", "numpy", "pydantic", "uvicorn"),
        (*ROOMS, "app.client", "app.main", "app.settings"),
    ),
    "app.demo": Room(("httpx", "numpy", "typer", "rich"), ("app.client", "app.motion")),
    "migrations": Room(("sqlalchemy", "alembic"), ("app.registry", "app.settings")),
}
"""The part of a name that matters is its beginning: ``numpy`` stands for ``numpy.typing``, too."""

IN_ONE_FILE = {"hmmlearn": {1}, "sklearn": {0, 1}}
"""In how many files of the house a package may be imported."""

READS_ENVIRONMENT = "app.settings"
"""All others may at most hand the whole of it on to a process they start: ``env={**os.environ, ...}``."""
ENVIRONMENT = {"os.environ", "os.environb", "os.getenv", "os.getenvb", "os.putenv", "os.unsetenv"}
READERS = ("pydantic_settings", "dotenv", "decouple")

NO_NOUNS = {"utils", "util", "common", "helpers", "helper", "core", "managers", "manager", "misc"}
LONGEST_FILE = 400
LONGEST_FUNCTION = 40

UNSAFE_MODULES = ("pickle", "_pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve")
UNSAFE_CALLS = {"eval", "exec", "__import__"}

RANDOM_WITH_A_SEED = {"Generator", "default_rng", "SeedSequence", "BitGenerator", "PCG64"}
TOUCHES_FILES = {"open", "input", "print"}
NUMPY_FILES = {"load", "save", "savez", "loadtxt", "savetxt", "genfromtxt", "fromfile", "memmap"}


class Module(NamedTuple):
    """One file of the house."""

    name: str
    source: str

    @property
    def tree(self) -> ast.Module:
        return ast.parse(self.source)

    @property
    def room(self) -> str:
        parts = self.name.split(".")
        return parts[0] if parts[0] == "migrations" else ".".join(parts[:2])


Rule = Callable[[Module], Iterator[str]]


def modules(*folders: str) -> list[Module]:
    """Return the files under these folders of the house."""
    paths = [path for folder in folders for path in sorted((HOUSE / folder).rglob("*.py"))]
    names = [".".join(path.relative_to(HOUSE).with_suffix("").parts) for path in paths]
    return [
        Module(name.removesuffix(".__init__"), path.read_text(encoding="utf-8"))
        for name, path in zip(names, paths, strict=True)
    ]


def imports(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and full name of all that is imported; a relative name keeps its dots."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = "." * node.level + (node.module or "")
            yield from ((node.lineno, f"{origin}.{alias.name}") for alias in node.names)


def begins(name: str, *with_any: str) -> bool:
    return any(name == prefix or name.startswith(f"{prefix}.") for prefix in with_any)


def dotted(node: ast.expr) -> str:
    """Return ``a.b.c`` of an attribute, the empty string where it is the attribute of something else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute) and (of := dotted(node.value)):
        return f"{of}.{node.attr}"
    return ""


def names(tree: ast.Module, but: Collection[ast.expr] = ()) -> Iterator[tuple[int, str]]:
    """Yield line and dotted name of all that is looked up, as written."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute | ast.Name) and node not in but and (name := dotted(node)):
            yield node.lineno, name


def handed_on(tree: ast.Module) -> list[ast.expr]:
    """Return the x of ``env={**x, ...}``."""
    given = [node.value for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg == "env"]
    environments = [value for value in given if isinstance(value, ast.Dict)]
    return [
        value
        for environment in environments
        for key, value in zip(environment.keys, environment.values, strict=True)
        if key is None
    ]


def keeps_to_the_table(module: Module) -> Iterator[str]:
    """A room imports only what the table lets it."""
    if module.name in ("app", "migrations"):
        return
    if module.room not in TABLE:
        yield f"{module.name}: {module.room} is no room of the house"
        return
    room = TABLE[module.room]
    for line, name in imports(module.tree):
        of_python = name.split(".")[0] in sys.stdlib_module_names and not begins(name, *room.must_not)
        if not of_python and not begins(name, module.room, *room.packages, *room.of_the_house):
            yield f"{module.name}:{line} imports {name}"


def leaves_the_world_alone(module: Module) -> Iterator[str]:
    """The core touches no file and no global random state."""
    if module.room != "app.motion":
        return
    for line, name in names(module.tree):
        numpy_name = name.removeprefix("numpy.").removeprefix("np.") if "." in name else ""
        global_random = numpy_name.startswith("random.") and numpy_name[7:] not in RANDOM_WITH_A_SEED
        if name in TOUCHES_FILES or numpy_name in NUMPY_FILES or global_random:
            yield f"{module.name}:{line} uses {name}"
    for line, name in imports(module.tree):
        if begins(name, "numpy.random") and name.split(".")[-1] not in RANDOM_WITH_A_SEED:
            yield f"{module.name}:{line} imports {name}"


def leaves_the_environment_to_the_settings(module: Module) -> Iterator[str]:
    if module.name == READS_ENVIRONMENT:
        return
    tree = module.tree
    for line, name in (*imports(tree), *names(tree, but=handed_on(tree))):
        if name in ENVIRONMENT or begins(name, *READERS):
            yield f"{module.name}:{line} reads the environment: {name}"


def is_called_by_a_noun(module: Module) -> Iterator[str]:
    if bad := NO_NOUNS.intersection(module.name.split(".")):
        yield f"{module.name} is named {', '.join(bad)}"


def is_short(module: Module) -> Iterator[str]:
    """Files, and functions less their docstrings, have a size that one can take in."""
    if (n_lines := len(module.source.splitlines())) > LONGEST_FILE:
        yield f"{module.name} has {n_lines} lines"
    for node in ast.walk(module.tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) is not None else node.body
            n_lines = (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0
            if n_lines > LONGEST_FUNCTION:
                yield f"{module.name}:{node.lineno} {node.name} has {n_lines} lines"


def is_safe(module: Module) -> Iterator[str]:
    """Nothing is pickled, and no text is run."""
    for line, name in imports(module.tree):
        if begins(name, *UNSAFE_MODULES):
            yield f"{module.name}:{line} imports {name}"
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Call) and dotted(node.func).removeprefix("builtins.") in UNSAFE_CALLS:
            yield f"{module.name}:{node.lineno} calls {dotted(node.func)}"
        if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
            yield f"{module.name}:{node.value.lineno} says allow_pickle"


RULES: tuple[Rule, ...] = (
    keeps_to_the_table,
    leaves_the_world_alone,
    leaves_the_environment_to_the_settings,
    is_called_by_a_noun,
    is_short,
    is_safe,
)


def users_of(package: str, house: list[Module]) -> list[str]:
    """Return the modules that import a package."""
    return [module.name for module in house if any(begins(name, package) for _, name in imports(module.tree))]


@pytest.mark.parametrize("rule", RULES)
def test_the_house_keeps_its_rules(rule: Rule) -> None:
    house = modules("app", "migrations")
    assert len(house) > 20
    assert [violation for module in house for violation in rule(module)] == []


@pytest.mark.parametrize("rule", [is_called_by_a_noun, is_short])
def test_tests_and_benchmarks_keep_them_too(rule: Rule) -> None:
    assert [violation for module in modules("tests", "benchmarks") for violation in rule(module)] == []


@pytest.mark.parametrize("package", IN_ONE_FILE)
def test_a_learning_library_has_one_user(package: str) -> None:
    users = users_of(package, modules("app", "migrations"))
    assert len(users) in IN_ONE_FILE[package], users


LONG_FUNCTION = "def f():\n    '''Say it.'''\n" + LONGEST_FUNCTION * "    x = 1\n"

GOOD = [
    (
        "app.motion.scoring",
        "import numpy as np\nfrom numba import njit\nimport logging\nrng = np.random.default_rng(1)",
    ),
    (
        "app.motion.scoring",
        "from app.motion import features\nfrom numpy.random import Generator, default_rng",
    ),
    ("app.registry.store", "import os\nos.replace(a, b)\nfrom app.motion.model import Model\nopen(a)"),
    ("app.service.training", "import asyncio\nfrom dbos import DBOS\nfrom app.registry import versions"),
    (
        "app.api.problems",
        "import fastapi\nfrom app.motion import errors\nfrom app.registry.records import Page",
    ),
    ("app.client.rest", "import httpx\nfrom app.client.wire import Message"),
    ("app.settings", "import os\nfrom pydantic_settings import BaseSettings\nos.environ['X']"),
    ("app.commands.serve", "from app.settings import Settings\nfrom app.main import create_app"),
    (
        "app.demo",
        "import os\nfrom app.client import GestaClient\nrun(x, env={**os.environ, 'GESTA_PORT': '0'})",
    ),
    ("migrations.env", "from alembic import context\nfrom app.registry.tables import metadata"),
    ("app.motion.scoring", LONG_FUNCTION + "\n# evaluate, executor.exec_module"),
    ("app.motion.scoring", "x = 1\n" * LONGEST_FILE),
]

BAD: list[tuple[Rule, str, str]] = [
    (keeps_to_the_table, "app.motion.scoring", "import asyncio"),
    (keeps_to_the_table, "app.motion.scoring", "def f():\n    from time import monotonic"),
    (keeps_to_the_table, "app.motion.scoring", "from pathlib import Path"),
    (keeps_to_the_table, "app.motion.scoring", "import os.path"),
    (keeps_to_the_table, "app.motion.scoring", "from random import random"),
    (keeps_to_the_table, "app.motion.scoring", "import pydantic"),
    (keeps_to_the_table, "app.motion.scoring", "from app.registry.records import Page"),
    (keeps_to_the_table, "app.motion.scoring", "from app import registry"),
    (keeps_to_the_table, "app.motion.scoring", "from . import features"),
    (keeps_to_the_table, "app.motion.scoring", "import app"),
    (keeps_to_the_table, "app.formats.c3d", "import sqlalchemy"),
    (keeps_to_the_table, "app.formats.c3d", "from app.motion.training import fit_model"),
    (keeps_to_the_table, "app.registry.models", "from fastapi import HTTPException"),
    (keeps_to_the_table, "app.registry.models", "from pydantic.fields import Field"),
    (keeps_to_the_table, "app.registry.models", "from app.motion.training import fit_model"),
    (keeps_to_the_table, "app.registry.models", "from app.motion import scoring"),
    (keeps_to_the_table, "app.registry.models", "from app.settings import Settings"),
    (keeps_to_the_table, "app.service.training", "from starlette.requests import Request"),
    (keeps_to_the_table, "app.service.training", "import sqlalchemy as sa"),
    (keeps_to_the_table, "app.service.training", "from pydantic import BaseModel"),
    (keeps_to_the_table, "app.service.training", "from app.api.schemas import Place"),
    (keeps_to_the_table, "app.api.models", "import numpy as np"),
    (keeps_to_the_table, "app.api.models", "import sklearn"),
    (keeps_to_the_table, "app.api.models", "import hmmlearn.hmm"),
    (keeps_to_the_table, "app.api.models", "from sqlalchemy.orm import Session"),
    (keeps_to_the_table, "app.api.models", "from app.registry.models import get"),
    (keeps_to_the_table, "app.api.models", "from app.motion.recogniser import Recogniser"),
    (keeps_to_the_table, "app.api.models", "import app.settings"),
    (keeps_to_the_table, "app.client.rest", "from app.motion.trajectory import Trajectory"),
    (keeps_to_the_table, "app.client.rest", "if TYPE_CHECKING:\n    import fastapi"),
    (keeps_to_the_table, "app.dashboard.pages", "from app.service import lab"),
    (keeps_to_the_table, "app.main", "import numpy"),
    (keeps_to_the_table, "app.demo", "from app.service.lab import Lab"),
    (keeps_to_the_table, "app.settings", "from app.registry.database import Database"),
    (keeps_to_the_table, "app.attic.boxes", ""),
    (keeps_to_the_table, "migrations.env", "from app.service.lab import Lab"),
    (leaves_the_world_alone, "app.motion.model", "with open('model') as file:\n    pass"),
    (leaves_the_world_alone, "app.motion.model", "np.load(path)"),
    (leaves_the_world_alone, "app.motion.model", "x = np.random.rand(3)"),
    (leaves_the_world_alone, "app.motion.model", "numpy.random.seed(0)"),
    (leaves_the_world_alone, "app.motion.model", "from numpy.random import normal"),
    (leaves_the_environment_to_the_settings, "app.registry.store", "import os\nos.environ['HOME']"),
    (leaves_the_environment_to_the_settings, "app.cli", "import os\nx = os.getenv('HOME', '')"),
    (leaves_the_environment_to_the_settings, "app.demo", "run(x, env={**os.environ, 'A': os.environ['B']})"),
    (leaves_the_environment_to_the_settings, "app.demo", "run(x, env=os.environ)"),
    (leaves_the_environment_to_the_settings, "app.demo", "x = {**os.environ}"),
    (leaves_the_environment_to_the_settings, "app.main", "from os import environ"),
    (leaves_the_environment_to_the_settings, "migrations.env", "import pydantic_settings"),
    (is_called_by_a_noun, "app.motion.utils", ""),
    (is_called_by_a_noun, "app.core.model", ""),
    (is_short, "app.motion.model", "x = 1\n" * (LONGEST_FILE + 1)),
    (is_short, "app.motion.model", LONG_FUNCTION + "    return x"),
    (is_short, "app.motion.model", "class A:\n async def f():\n" + (LONGEST_FUNCTION + 1) * "  x = 1\n"),
    (is_safe, "app.registry.store", "import pickle"),
    (is_safe, "app.registry.store", "def f():\n    from joblib import dump"),
    (is_safe, "app.registry.store", "eval('1')"),
    (is_safe, "app.registry.store", "x = [exec(text) for text in texts]"),
    (is_safe, "app.registry.store", "__import__('pickle')"),
    (is_safe, "app.registry.store", "np.load(path, allow_pickle=True)"),
]


@pytest.mark.parametrize(("name", "source"), GOOD)
def test_rules_let_good_modules_be(name: str, source: str) -> None:
    assert [violation for rule in RULES for violation in rule(Module(name, source))] == []


@pytest.mark.parametrize(("rule", "name", "source"), BAD)
def test_rules_find_bad_modules(rule: Rule, name: str, source: str) -> None:
    [violation] = set(rule(Module(name, source)))
    assert name in violation


def test_a_second_user_is_found() -> None:
    house = [Module(f"app.motion.{name}", "from hmmlearn.hmm import GaussianHMM") for name in "ab"]
    assert users_of("hmmlearn", house) == ["app.motion.a", "app.motion.b"]
    assert users_of("sklearn", house) == []
