"""What leaves the house: the wheel, the image's compose file, the tests of a clone without the data."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest
import typer
import yaml

from app.cli import cli
from app.settings import Settings

ROOT = Path(__file__).parents[1]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
DOCKERFILE = (ROOT / "Dockerfile").read_text()
OURS = {name: made for name, made in COMPOSE["services"].items() if made["image"] == "gesta"}

FOREIGN = re.compile(
    r"(?<![\w.])/(work|root|farm|home/\w+)/[\w.-]+"
    r"|\b(pypi|pythonhosted|npmjs|deb\.debian|proxy\.golang)\.(org|com)\b|\b(ghcr|docker|quay)\.io\b"
)
"""A path of one machine, or the host of a package registry."""


def test_wheel_holds_every_module_and_what_migrates(tmp_path: Path) -> None:
    source = tmp_path / "source"
    for folder in ("app", "migrations"):
        shutil.copytree(ROOT / folder, source / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*build, "--wheel-dir", tmp_path, source], check=True)
    (wheel,) = tmp_path.glob("gesta-*.whl")
    expected = {
        str(path.relative_to(source))
        for folder in ("app", "migrations")
        for path in (source / folder).rglob("*")
        if path.is_file()
    }
    assert {"migrations/script.py.mako", "migrations/env.py", "app/cli.py"} <= expected
    with ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
        assert any(name.endswith("LICENSE") for name in archive.namelist())
    assert held == expected


def test_server_and_worker_share_database_and_store() -> None:
    assert OURS.keys() == {"gesta", "worker", "migrate"}
    assert len({made["environment"]["GESTA_DATABASE_URL"] for made in OURS.values()}) == 1
    (mount,) = {mount for made in OURS.values() for mount in made["volumes"]}
    volume, _, folder = mount.partition(":")
    assert volume in COMPOSE["volumes"]
    assert f"WORKDIR {folder}\n" in DOCKERFILE
    assert not Path(Settings.model_fields["store_url"].default).is_absolute()


def test_jobs_are_done_by_the_worker_alone() -> None:
    assert OURS["gesta"]["environment"]["GESTA_JOB_WORKER"] == "none"
    assert OURS["worker"]["command"] == ["worker"]


def test_nothing_starts_before_the_database_is_migrated() -> None:
    for name in ("gesta", "worker"):
        assert OURS[name]["depends_on"] == {"migrate": {"condition": "service_completed_successfully"}}
    assert OURS["migrate"]["depends_on"] == {"database": {"condition": "service_healthy"}}


def test_compose_is_reached_from_its_own_machine_only() -> None:
    ports = [port for made in COMPOSE["services"].values() for port in made.get("ports", [])]
    assert ports == ["127.0.0.1:8000:8000"]


def test_every_variable_is_a_setting() -> None:
    known = {f"GESTA_{name.upper()}" for name in Settings.model_fields}
    named = {name for made in OURS.values() for name in made["environment"]}
    assert named | set(re.findall(r"GESTA_\w+", DOCKERFILE)) <= known


def test_every_command_is_one_of_gesta() -> None:
    known = set(typer.main.get_group(cli).commands)
    given = {made["command"][0] for made in OURS.values() if "command" in made}
    in_image = re.findall(r'^RUN gesta (\w+)|^CMD \["(\w+)"', DOCKERFILE, re.MULTILINE)
    assert given | {warm or served for warm, served in in_image} == {"migrate", "serve", "warm", "worker"}
    assert {"migrate", "serve", "warm", "worker"} <= known


def test_image_fixes_what_kernels_are_compiled_for() -> None:
    """Numba takes a kernel from its cache only where the name and the features of the processor agree."""
    last = DOCKERFILE.rpartition("\nFROM ")[2]
    before_warming = last.partition("RUN gesta warm")[0]
    for name in ("NUMBA_CACHE_DIR", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"):
        assert f"{name}=" in before_warming
    assert "USER 10001" in before_warming


def test_no_file_names_a_registry_or_a_path_of_one_machine() -> None:
    folders = (".ci", "app", "benchmarks", "docs", "migrations", "tests")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]
    files += [path for path in ROOT.glob("[!.]*") if path.is_file() and path.suffix != ".db"]
    texts = {".ini", ".json", ".mako", ".md", ".py", ".toml", ".txt", ".yaml", ".yml", ""}
    found = {
        str(path.relative_to(ROOT)): match[0]
        for path in files
        if path.suffix in texts and (match := FOREIGN.search(path.read_text()))
    }
    assert not found


@pytest.mark.parametrize(("present", "outcome"), [(True, "2 passed"), (False, "1 passed, 1 deselected")])
def test_tests_of_the_data_run_where_it_is(tmp_path: Path, present: bool, outcome: str) -> None:
    tests = tmp_path / "clone" / "tests"
    shutil.copytree(ROOT / "tests", tests, ignore=shutil.ignore_patterns("test_*.py", "__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tests.parent)
    (tests / "test_both.py").write_text(
        "import pytest\n\ndef test_plain(): pass\n\n@pytest.mark.shared\ndef test_of_the_data(): pass\n"
    )
    if present:
        (tmp_path / "shared" / "data").mkdir(parents=True)
    command = [sys.executable, "-m", "pytest"]
    ran = subprocess.run(command, cwd=tests.parent, env={}, capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1].strip("= ").startswith(outcome)
    assert ("1 tests that read it did not run" in ran.stdout) is not present
