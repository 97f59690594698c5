"""`inspector serve` as a process of its own, for tests that need the whole of it."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx2

PATIENCE = 60.0
PROGRAM = "from inspector.cli import main; main()"


@dataclass(frozen=True)
class Served:
    """A service that answers."""

    url: str
    process: subprocess.Popen[bytes]
    log: Path


def free_port() -> int:
    """A port that nobody listens at just now."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@contextmanager
def serve(
    data: Path, *options: str, port: int | None = None, program: str = PROGRAM, **settings: str
) -> Generator[Served]:
    """The service on that folder, ready; ended in the end, in whatever state it is. Leads a process group."""
    port, log = port or free_port(), data.with_name(f"{data.name}.log")
    command = [sys.executable, "-c", program, "serve", "--data", str(data)]
    environment = os.environ | {f"INSPECTOR_{name.upper()}": value for name, value in settings.items()}
    with log.open("ab") as out:
        process = subprocess.Popen(
            [*command, "--port", str(port), *options],
            env=environment,
            stdout=out,
            stderr=out,
            start_new_session=True,
        )
    served = Served(f"http://127.0.0.1:{port}", process, log)
    try:
        wait_until_ready(served)
        yield served
    finally:
        process.terminate()
        process.wait(PATIENCE)


def wait_until_ready(served: Served) -> None:
    """Return when it answers that it is; fail with its log when it has ended."""
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            if httpx2.get(f"{served.url}/readyz").status_code == 200:
                return
        except httpx2.TransportError:
            pass
        assert served.process.poll() is None, served.log.read_text()
        assert time.monotonic() < deadline, served.log.read_text()
        time.sleep(0.05)
