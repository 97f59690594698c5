"""An S3 service for tests: moto's server in a thread of this process, with a bucket for each test that asks.

Or a real one, where INSPECTOR_TESTS_S3 names its address, and the environment has what it asks for: AWS_ACCESS_KEY_ID
and so on. Buckets stay there; their names begin with `bucket-`.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from threading import Thread
from typing import Any
from urllib.request import Request, urlopen

import obstore
import pytest
from obstore.store import S3Store

REAL = os.environ.get("INSPECTOR_TESTS_S3")
"""The address of a service that runs already."""
_NO_MOTO = "moto is not installed: pip install 'moto[server]'"
_MOTOS = {"AWS_ACCESS_KEY_ID": "tests", "AWS_SECRET_ACCESS_KEY": "hunter2-of-s3", "AWS_REGION": "us-east-1"}
"""What it is asked by: it takes any."""


def credentials() -> dict[str, str]:
    """What the service is asked by, as environment."""
    return _MOTOS if REAL is None else {name: os.environ.get(name, each) for name, each in _MOTOS.items()}


@dataclass
class Buckets:
    """A service that runs."""

    endpoint: str

    def new(self) -> str:
        """The URL of a new bucket."""
        return self.make(f"bucket-{time.time_ns()}")

    def make(self, name: str) -> str:
        """The URL of the bucket of that name, new. Raises OSError where the service does not answer."""
        by: Any = {name.lower(): each for name, each in credentials().items()}
        store = S3Store(name, config=by | {"endpoint": self.endpoint}, client_options={"allow_http": True})
        signed = obstore.sign(store, "PUT", "", timedelta(minutes=1))
        with urlopen(Request(signed, method="PUT")):
            pass
        return f"s3://{name}?endpoint={self.endpoint}"


@contextmanager
def server() -> Generator[Buckets]:
    """The service; its credentials are in the environment as long as it runs."""
    if REAL is not None:
        yield Buckets(REAL)
        return
    moto = pytest.importorskip("moto.server", reason=_NO_MOTO)
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    running = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    with pytest.MonkeyPatch.context() as environment:
        for name, each in credentials().items():
            environment.setenv(name, each)
        running.start()
        try:
            host, port = running.get_host_and_port()
            yield Buckets(f"http://{host}:{port}")
        finally:
            running.stop()


@contextmanager
def unconditional(*, refuses: bool) -> Generator[Buckets]:
    """A service that does not know `If-None-Match`: it does as if it was not there, or refuses what has it."""
    moto = pytest.importorskip("moto.moto_server.werkzeug_app", reason=_NO_MOTO)
    serving = pytest.importorskip("werkzeug.serving", reason=_NO_MOTO)
    application = moto.DomainDispatcherApplication(moto.create_backend_app)

    def answer(environ: dict[str, Any], start: Callable[..., object]) -> Iterable[bytes]:
        if environ.pop("HTTP_IF_NONE_MATCH", None) is None or not refuses:
            return application(environ, start)
        environ["wsgi.input"].read(int(environ["CONTENT_LENGTH"]))
        start("501 Not Implemented", [("Content-Type", "application/xml")])
        return [b"<Error><Code>NotImplemented</Code></Error>"]

    running = serving.make_server("127.0.0.1", 0, answer, threaded=True)
    thread = Thread(target=running.serve_forever)
    thread.start()
    try:
        yield Buckets(f"http://127.0.0.1:{running.server_address[1]}")
    finally:
        running.shutdown()
        thread.join()
        running.server_close()
