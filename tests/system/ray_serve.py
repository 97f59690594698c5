"""The same service by Ray Serve on this machine: `python -m api.cluster`, on one database and one bucket."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from tests import patience
from tests.clusters import needs
from tests.system.clustered import Cluster, first_token, shared, teach
from tests.system.serving import Served, wait_until_ready

OWN = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_AUTH_MODE": "disabled", "NO_COLOR": "1", "RAY_COLOR_PREFIX": "0"}
"""Nobody is told of it, nothing is kept for another Ray of this machine."""


class RayServe:
    """Ray, and the replicas in it."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process

    def replicas(self) -> list[int]:
        """The processes that are replicas."""
        return [pid for pid, _, what in self._all() if what.startswith("ray::ServeReplica")]

    def kill(self, replica: int) -> None:
        """With SIGKILL, its scorers too: as if the machine was gone."""
        for pid in [replica, *(pid for pid, parent, _ in self._all() if parent == replica)]:
            os.kill(pid, signal.SIGKILL)

    def _all(self) -> list[tuple[int, int, str]]:
        """Every process that was started from here: its number, its parent's, and what it is."""
        listed = subprocess.run(["ps", "-e", "-o", "pid=,ppid=,args="], capture_output=True, text=True, check=True)
        rows = (row.split(None, 2) for row in listed.stdout.splitlines())
        known = [(int(pid), int(parent), what) for pid, parent, what in rows]
        found, ours = list[tuple[int, int, str]](), {self._process.pid}
        while more := [each for each in known if each[1] in ours and each[0] not in ours]:
            found += more
            ours |= {pid for pid, _, _ in more}
        return found


@contextmanager
def ray_serve(folder: Path, replicas: int = 2, **settings: str) -> Iterator[tuple[Cluster, RayServe]]:
    """Ready, the product learnt."""
    needs("ray")
    with ExitStack() as held:
        database, environment = held.enter_context(shared(folder, None, settings))
        environment |= OWN | {"INSPECTOR_HOST": "127.0.0.1", "INSPECTOR_DATA": str(folder / "data")}
        log, url = folder / "ray.log", f"http://127.0.0.1:{environment['INSPECTOR_PORT']}"
        with log.open("ab") as out:
            command = [sys.executable, "-m", "api.cluster", "--replicas", str(replicas)]
            process = subprocess.Popen(command, env=os.environ | environment, stdout=out, stderr=out)
        held.callback(process.wait, patience.SECONDS)
        held.callback(process.terminate)
        wait_until_ready(Served(url, process, log))
        made = Cluster(url, [], database, first_token([log]))
        teach(made)
        yield made, RayServe(process)
