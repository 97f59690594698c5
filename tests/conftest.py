"""One BLAS thread per worker of pytest-xdist: two with two each wait for each other. The same examples every time."""

import os
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from tests import ports

if TYPE_CHECKING:
    from tests.buckets import Buckets
    from tests.postgresql import Server

# NumPy reads these when it is loaded. Here that may have been, by a plugin; workers are started later, and inherit.
for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

# Other examples are searched for by hand, with `pytest --hypothesis-profile=default`: not on somebody else's change.
# No deadline: how long a test takes is the machine's.
settings.register_profile("same", derandomize=True, deadline=None)
settings.load_profile("same")


@pytest.fixture(scope="session")
def postgresql() -> "Iterator[Server]":
    """One server for all tests of a worker that ask for it."""
    from tests.postgresql import server

    with server() as running:
        yield running


@pytest.fixture
def port() -> "Iterator[int]":
    """A port at which nobody listens, and that nobody else is given."""
    with ports.held() as port:
        yield port


@pytest.fixture(scope="session")
def buckets() -> "Iterator[Buckets]":
    """One S3 service for all tests of a worker that ask for it."""
    from tests.buckets import server

    with server() as running:
        yield running
