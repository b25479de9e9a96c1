"""What leaves the house: the wheel, the image's compose file, the tests of a clone without the data."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from zipfile import ZipFile

import pytest
import typer
import yaml
from sqlalchemy import make_url

from app.api.stream_server import GRACE
from app.cli import cli
from app.service.live import Limits
from app.settings import Settings

ROOT = Path(__file__).parents[1]
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
DOCKERFILE = (ROOT / "Dockerfile").read_text()
OURS = {name: made for name, made in COMPOSE["services"].items() if made["image"] == "gesta"}
ALONE = {name: made for name, made in OURS.items() if "profiles" not in made}
CLUSTER = {name: made for name, made in COMPOSE["services"].items() if made.get("profiles") == ["cluster"]}
SERVERS, WORKERS = ("server-1", "server-2"), ("worker-1", "worker-2")

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
    assert ALONE.keys() == {"gesta", "worker", "migrate"}
    assert len({made["environment"]["GESTA_DATABASE_URL"] for made in ALONE.values()}) == 1
    (mount,) = {mount for made in ALONE.values() for mount in made["volumes"]}
    volume, _, folder = mount.partition(":")
    assert volume in COMPOSE["volumes"]
    assert f"WORKDIR {folder}\n" in DOCKERFILE
    assert not Path(Settings.model_fields["store_url"].default).is_absolute()


def test_the_cluster_is_an_installation_of_its_own() -> None:
    """What is in no profile starts with every profile, on other data."""
    clustered = {name: made for name, made in CLUSTER.items() if made["image"] == "gesta"}
    assert clustered.keys() == {*SERVERS, *WORKERS, "cluster-migrate"}
    [environment] = {tuple(made["environment"].items()) for made in clustered.values()}
    given = dict(environment)
    assert make_url(given["GESTA_DATABASE_URL"]).host == "cluster-database"
    assert urlsplit(given["AWS_ENDPOINT_URL"]).hostname == "cluster-store"
    assert not any("volumes" in made for made in clustered.values())
    assert {"cluster-database", "cluster-store"} <= CLUSTER.keys() & COMPOSE["volumes"].keys()
    for name in ("cluster-database", "cluster-store", "cluster-bucket", "balancer"):
        assert re.search(r":(\d+(\.\d+)?|RELEASE\..+Z)$", CLUSTER[name]["image"]), "its version is pinned"


def test_the_cluster_has_one_password_for_each_secret() -> None:
    store, bucket = CLUSTER["cluster-store"]["environment"], CLUSTER["cluster-bucket"]["environment"]
    given = CLUSTER["server-1"]["environment"]
    user, password = given["AWS_ACCESS_KEY_ID"], given["AWS_SECRET_ACCESS_KEY"]
    assert (store["MINIO_ROOT_USER"], store["MINIO_ROOT_PASSWORD"]) == (user, password)
    assert bucket["MC_HOST_store"] == f"http://{user}:{password}@cluster-store:9000"
    name = urlsplit(given["GESTA_STORE_URL"]).netloc
    assert CLUSTER["cluster-bucket"]["command"] == ["mb", "--ignore-existing", f"store/{name}"]
    database = CLUSTER["cluster-database"]["environment"]
    assert f":{database['POSTGRES_PASSWORD']}@" in given["GESTA_DATABASE_URL"]


def test_the_balancer_knows_the_servers_and_asks_whether_they_are_ready() -> None:
    balancer = CLUSTER["balancer"]
    [mount] = balancer["configs"]
    text = (ROOT / COMPOSE["configs"][mount["source"]]["file"]).read_text()
    assert re.findall(r"^ *server (\S+) (\S+):8000$", text, re.MULTILINE) == [
        (name, name) for name in SERVERS
    ]
    assert "httpchk GET /readyz" in text
    assert "bind :8000" in text
    assert balancer["ports"][0].endswith(":8000")
    started = {name: on["condition"] for name, on in balancer["depends_on"].items()}
    assert started == dict.fromkeys(SERVERS, "service_healthy") | dict.fromkeys(WORKERS, "service_started")


def test_jobs_are_done_by_the_workers_alone() -> None:
    for name in ("gesta", *SERVERS):
        assert OURS[name]["environment"]["GESTA_JOB_WORKER"] == "none"
    for name in ("worker", *WORKERS):
        assert OURS[name]["command"] == ["worker"]


def test_nothing_starts_before_what_it_needs() -> None:
    done, healthy = {"condition": "service_completed_successfully"}, {"condition": "service_healthy"}
    for name in ("gesta", "worker"):
        assert OURS[name]["depends_on"] == {"migrate": done}
    for name in (*SERVERS, *WORKERS):
        assert OURS[name]["depends_on"] == {"cluster-migrate": done, "cluster-bucket": done}
    assert OURS["migrate"]["depends_on"] == {"database": healthy}
    assert OURS["cluster-migrate"]["depends_on"] == {"cluster-database": healthy}
    assert CLUSTER["cluster-bucket"]["depends_on"] == {"cluster-store": healthy}


def test_a_server_has_time_to_drain_before_it_is_killed() -> None:
    for name in ("gesta", *SERVERS):
        assert int(OURS[name]["stop_grace_period"].removesuffix("s")) > Limits().drain + GRACE


def test_compose_is_reached_from_its_own_machine_only() -> None:
    ports = [port for made in COMPOSE["services"].values() for port in made.get("ports", [])]
    assert ports == ["127.0.0.1:8000:8000", "127.0.0.1:8080:8000"]


def test_every_variable_is_a_setting() -> None:
    known = {f"GESTA_{name.upper()}" for name in Settings.model_fields}
    named = {name for made in OURS.values() for name in made["environment"] if name.startswith("GESTA_")}
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
    folders = (".ci", "app", "benchmarks", "deploy", "docs", "migrations", "tests")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]
    files += [path for path in ROOT.glob("[!.]*") if path.is_file() and path.suffix != ".db"]
    texts = {".cfg", ".ini", ".json", ".mako", ".md", ".py", ".toml", ".txt", ".yaml", ".yml", ""}
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
