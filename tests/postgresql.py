"""A throwaway PostgreSQL server of Debian's binaries, on a socket in a folder of its own, gone when the tests are."""

from __future__ import annotations

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import psycopg
import pytest

NEEDED = "INSPECTOR_TESTS_NEED_POSTGRESQL"
"""Set where tests without PostgreSQL would prove too little: what would be skipped fails."""
QUICKLY = {"fsync": "off", "full_page_writes": "off", "shared_buffers": "16MB"}
"""Nothing here has to outlive the machine; what was confirmed outlives the server, which tests kill."""
MADE = ["--no-sync", "--encoding=UTF8", "--locale=C"]


@dataclass(frozen=True)
class Server:
    """A server that runs."""

    folder: Path
    """Of its socket: there is no port."""

    def url(self, name: str = "postgres") -> str:
        """Of a database on it."""
        return f"postgresql://postgres@/{name}?host={self.folder}"

    def new_database(self) -> str:
        """The url of a new, empty one."""
        name = f"d{uuid4().hex}"
        with psycopg.connect(self.url(), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name} STRATEGY file_copy".encode())
        return self.url(name)

    def start(self) -> None:
        """Return when it answers."""
        options = " ".join(
            ["-clisten_addresses=", f"-k{self.folder}", *(f"-c{name}={value}" for name, value in QUICKLY.items())]
        )
        _run(self.folder, *self._control(), f"--log={self.folder}/log", f"--options={options}", "start")

    def kill(self) -> None:
        """At once: who is connected is told nothing, and tables that are not logged are empty afterwards."""
        _run(self.folder, *self._control(), "--mode=immediate", "stop")

    @contextmanager
    def asleep(self) -> Iterator[None]:
        """It holds its connections and answers nothing, as on a machine that swaps."""
        first = int((self.folder / "data" / "postmaster.pid").read_text().split()[0])
        os.kill(first, signal.SIGSTOP)
        others = Path(f"/proc/{first}/task/{first}/children").read_text().split()
        try:
            for each in map(int, others):
                os.kill(each, signal.SIGSTOP)
            yield
        finally:
            for each in (*map(int, others), first):
                os.kill(each, signal.SIGCONT)

    def _control(self) -> list[str | Path]:
        return [binaries() / "pg_ctl", f"--pgdata={self.folder}/data", "--wait"]


def binaries() -> Path:
    """Where the newest server's programs are; skips the test where there are none."""
    found = [Path(path).parent for path in [shutil.which("initdb")] if path]
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda folder: int(folder.parent.name))
    found += [folder for folder in reversed(folders) if (folder / "initdb").exists()]
    if not found:
        why = "there is no PostgreSQL; Debian and Ubuntu have it as `postgresql`"
        pytest.fail(why) if os.environ.get(NEEDED) else pytest.skip(why)
    return found[0]


@contextmanager
def server() -> Iterator[Server]:
    """A server, from when it answers until the end."""
    programs = binaries()
    folder = Path(tempfile.mkdtemp(prefix="pg-"))
    try:
        _run(folder, programs / "initdb", f"--pgdata={folder}/data", "--auth=trust", "--username=postgres", *MADE)
        running = Server(folder)
        try:
            running.start()
            yield running
        finally:
            running.kill()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _run(folder: Path, *command: str | Path) -> None:
    """PostgreSQL refuses to be root: then it is `nobody`. What it says is in the folder: a pipe would stay open."""
    account: dict[str, Any] = {}
    if os.geteuid() == 0:
        nobody = pwd.getpwnam("nobody")
        os.chown(folder, nobody.pw_uid, nobody.pw_gid)
        account = {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}
    with (folder / "said").open("w+") as said:
        done = subprocess.run(command, cwd=folder, stdout=said, stderr=said, check=False, **account)
    assert done.returncode == 0, (folder / "said").read_text()
