"""docker/haproxy.cfg by Debian's HAProxy, before services of one name and port, with an address of loopback each."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests import patience, ports
from tests.system import composed
from tests.system.names import Names, names

NEEDED = "INSPECTOR_TESTS_NEED_HAPROXY"
"""Set where tests without HAProxy would prove too little: what would be skipped fails."""


@dataclass(frozen=True)
class Proxy:
    """A proxy that runs, and what it asks for the addresses of services."""

    url: str
    names: Names
    port: int
    """That every service listens at."""
    log: Path

    def address(self, number: int) -> str:
        """Where that service is to listen; nobody is told of it."""
        return f"127.0.0.{101 + number}"


def program() -> str:
    """HAProxy; skips the test where there is none."""
    found = shutil.which("haproxy", path=f"{os.environ.get('PATH', '')}:/usr/sbin")
    if found is None:
        why = "there is no HAProxy; Debian and Ubuntu have it as `haproxy`"
        pytest.fail(why) if os.environ.get(NEEDED) else pytest.skip(why)
    return found


@contextmanager
def proxy(folder: Path) -> Iterator[Proxy]:
    """HAProxy as the compose file runs it, on the file that is in the repository; ended in the end."""
    haproxy = program()
    with ExitStack() as held:
        port, listen = (held.enter_context(ports.held()) for _ in range(2))
        known = held.enter_context(names())
        here = {"inspector:8000": f"inspector:{port}", "127.0.0.11:53": f"127.0.0.1:{known.port}"}
        environment = os.environ | composed.environment("haproxy", here | {":8000": f"127.0.0.1:{listen}"})
        log = folder / "haproxy.log"
        out = held.enter_context(log.open("ab"))
        file = composed.mounted("haproxy", "/usr/local/etc/haproxy/haproxy.cfg")
        process = subprocess.Popen([haproxy, "-db", "-f", file], env=environment, stdout=out, stderr=out)
        held.callback(process.wait, patience.SECONDS)
        held.callback(process.terminate)
        patience.until(lambda: process.poll() is not None or _listens(listen), log.read_text)
        assert process.poll() is None, log.read_text()
        yield Proxy(f"http://127.0.0.1:{listen}", known, port, log)


def _listens(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0
