"""`inspector serve` as a process of its own, for tests that need the whole of it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx2

from tests import patience, ports

PROGRAM = "from inspector.cli import main; main()"


@dataclass(frozen=True)
class Served:
    """A service that answers."""

    url: str
    process: subprocess.Popen[bytes]
    log: Path


@contextmanager
def serve(
    data: Path, *options: str, port: int | None = None, program: str = PROGRAM, **settings: str
) -> Generator[Served]:
    """The service on that folder, ready; ended in the end, in whatever state it is. Leads a process group."""
    command = [sys.executable, "-c", program, "serve", "--data", str(data)]
    environment = os.environ | {f"INSPECTOR_{name.upper()}": value for name, value in settings.items()}
    with ExitStack() as held:
        port = port or held.enter_context(ports.held())
        log = data.with_name(f"{data.name}.log")
        out = held.enter_context(log.open("ab"))
        process = subprocess.Popen(
            [*command, "--port", str(port), *options],
            env=environment,
            stdout=out,
            stderr=out,
            start_new_session=True,
        )
        held.callback(process.wait, patience.SECONDS)
        held.callback(process.terminate)
        served = Served(f"http://127.0.0.1:{port}", process, log)
        wait_until_ready(served)
        yield served


def wait_until_ready(served: Served) -> None:
    """Return when it answers that it is; fail with its log when it has ended."""

    def is_ready() -> bool:
        assert served.process.poll() is None, served.log.read_text()
        try:
            return patience.get(f"{served.url}/readyz").status_code == 200
        except httpx2.TransportError:
            return False

    patience.until(is_ready, served.log.read_text)
