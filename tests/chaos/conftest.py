"""Houses for the tests of chaos."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.chaos.house import House, Postgres, housing, postgresql
from tests.chaos.rounds import register


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    """Two servers on SQLite that know the model of the streams; the tests of a module share them."""
    with housing(tmp_path_factory.mktemp("house"), n_servers=2) as built:
        register(built)
        yield built


@pytest.fixture(scope="session")
def mortal_postgresql() -> Iterator[Postgres]:
    """A PostgreSQL that may be killed."""
    with postgresql() as server:
        yield server
