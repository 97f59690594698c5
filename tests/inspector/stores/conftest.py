"""One server for all tests of a worker that ask for it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.postgresql import Server, server


@pytest.fixture(scope="session")
def postgresql() -> Iterator[Server]:
    with server() as running:
        yield running
