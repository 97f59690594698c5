"""An S3 service for tests: moto's server in a thread of this process, with a bucket for each test that asks."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from urllib.request import Request, urlopen

import pytest


@dataclass
class Buckets:
    """A service that runs."""

    endpoint: str
    _numbers: itertools.count[int] = field(default_factory=itertools.count)

    def new(self) -> str:
        """The URL of a new bucket."""
        name = f"bucket-{next(self._numbers)}"
        with urlopen(Request(f"{self.endpoint}/{name}", method="PUT")):
            pass
        return f"s3://{name}?endpoint={self.endpoint}"


@contextmanager
def server() -> Generator[Buckets]:
    """The service; its credentials are in the environment as long as it runs."""
    moto = pytest.importorskip("moto.server", reason="moto is not installed: pip install 'moto[server]'")
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    running = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("AWS_ACCESS_KEY_ID", "tests")
        environment.setenv("AWS_SECRET_ACCESS_KEY", "hunter2-of-s3")
        environment.setenv("AWS_REGION", "us-east-1")
        running.start()
        try:
            host, port = running.get_host_and_port()
            yield Buckets(f"http://{host}:{port}")
        finally:
            running.stop()
