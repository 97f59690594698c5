"""The services of docker/compose.cluster.yaml as processes: PostgreSQL, an S3 endpoint, `inspector serve`, HAProxy."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx2
import pytest

from inspector.client import Client
from inspector.stores import open_store
from tests import patience, ports
from tests.api.stations import PRODUCT, material
from tests.buckets import REAL, Buckets, credentials
from tests.postgresql import server as postgresql
from tests.system import composed
from tests.system.proxying import Proxy, proxy
from tests.system.serving import Served, wait_until_ready

SERVE = [sys.executable, "-c", "from inspector.cli import main; main()"]
QUICKLY = {"INSPECTOR_SCORERS": "1", "INSPECTOR_LOG_LEVEL": "info", "INSPECTOR_REQUIRE_TOKEN": "true"}
"""What the image sets otherwise: there, all addresses are listened at, and so tokens are asked for."""


class Node:
    """One `inspector serve`."""

    def __init__(self, address: str, folder: Path, environment: dict[str, str]) -> None:
        self.url = f"http://{address}:{environment['INSPECTOR_PORT']}"
        self.log = folder / f"{address}.log"
        self._environment = os.environ | environment
        self._environment |= {"INSPECTOR_HOST": address, "INSPECTOR_DATA": str(folder / address)}
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Return when it is ready."""
        with self.log.open("ab") as out:
            self._process = subprocess.Popen(
                [*SERVE, "serve"], env=self._environment, stdout=out, stderr=out, start_new_session=True
            )
        wait_until_ready(Served(self.url, self._process, self.log))

    def kill(self) -> None:
        """With SIGKILL, its scorers too: as if the machine was gone."""
        assert self._process is not None
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def stop(self, meanwhile: Callable[[], object] = lambda: None) -> int:
        """With SIGTERM; the exit code."""
        assert self._process is not None
        self._process.terminate()
        meanwhile()
        return self._process.wait(patience.SECONDS)

    @contextmanager
    def asleep(self) -> Iterator[None]:
        """It does nothing, and holds its connections, as on a machine that swaps."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self._process.send_signal(signal.SIGCONT)

    def is_asked(self, made: Cluster) -> bool:
        """Whether a request to the front comes here."""
        before = self._requests()
        made.get("/v1/products")
        return self._requests() > before

    def _requests(self) -> float:
        rows = patience.get(f"{self.url}/metrics").text.splitlines()
        asked = [row for row in rows if row.startswith("inspector_requests_total") and "/v1/products" in row]
        return sum(float(row.split()[-1]) for row in asked)

    def end(self) -> None:
        """Whatever state it is in."""
        if self._process is not None and self._process.poll() is None:
            self.stop()


class Cluster:
    """What is reached at `url`, a product that is learnt, and a token."""

    def __init__(self, url: str, nodes: list[Node], database: str, token: str, front: Proxy | None = None) -> None:
        self.url, self.nodes, self.database, self.token = url, nodes, database, token
        self._front = front

    def client(self) -> Client:
        """As a line has one."""
        return Client(self.url, self.token, timeout=5.0, patience=patience.SECONDS)

    def get(self, path: str) -> httpx2.Response:
        """Asked of whoever stands in front."""
        return patience.get(f"{self.url}{path}", headers={"Authorization": f"Bearer {self.token}"})

    def owners(self, inspections: set[str]) -> dict[str, str | None]:
        """Which service has each."""
        with open_store(self.database) as store:
            return {each: store.inspection(each).node for each in inspections}

    def moved(self, inspections: set[str]) -> set[str]:
        """Those that did not stay where they began."""
        with open_store(self.database) as store:
            return {each for each in inspections if store.inspection(each).takes}

    def taken_for_gone(self) -> Counter[str]:
        """How often the front took each service for gone, by the names that it gives them."""
        said = self._front.log.read_text() if self._front is not None else ""
        return Counter(re.findall(r"Server services/(\S+) is DOWN", said))

    def wait_for(self, node: Node) -> None:
        """Return when requests come to that one again."""
        patience.until(lambda: any(node.is_asked(self) for _ in range(len(self.nodes))), node.log.read_text)


@contextmanager
def cluster(folder: Path, nodes: int = 2, **settings: str) -> Iterator[Cluster]:
    """All of it, ready, the product learnt by way of the front."""
    with ExitStack() as held:
        front = held.enter_context(proxy(folder))
        database, environment = held.enter_context(shared(folder, front, settings))
        started = [Node(front.address(number), folder, environment) for number in range(nodes)]
        for number, node in enumerate(started):
            held.callback(node.end)
            node.start()
            front.names.addresses.append(front.address(number))
        token = first_token([node.log for node in started])
        made = Cluster(front.url, started, database, token, front)
        patience.until(lambda: made.get("/readyz").status_code == 200, front.log.read_text)
        teach(made)
        yield made


@contextmanager
def shared(folder: Path, front: Proxy | None, settings: dict[str, str]) -> Iterator[tuple[str, dict[str, str]]]:
    """The database, and the environment of a service that works on it and on a bucket."""
    with ExitStack() as held:
        database = held.enter_context(postgresql()).new_database()
        files = new_bucket(held.enter_context(buckets(folder)))
        there = composed.environment("inspector", {})
        environment = composed.environment(
            "inspector", {there["INSPECTOR_DATABASE"]: database, there["INSPECTOR_FILES"]: files}
        )
        environment |= (
            credentials() | QUICKLY | {f"INSPECTOR_{name.upper()}": value for name, value in settings.items()}
        )
        environment |= {"INSPECTOR_PORT": str(front.port if front else held.enter_context(ports.held()))}
        yield database, environment


@contextmanager
def buckets(folder: Path) -> Iterator[Buckets]:
    """moto's S3 service, or the real one that is named."""
    if REAL is not None:
        yield Buckets(REAL)
        return
    pytest.importorskip("moto.server", reason="moto is not installed: pip install 'moto[server]'")
    with ports.held() as port, (folder / "s3.log").open("ab") as out:
        command = [sys.executable, "-m", "moto.server", "--host", "127.0.0.1", "--port", str(port)]
        process = subprocess.Popen(command, stdout=out, stderr=out)
        try:
            yield Buckets(f"http://127.0.0.1:{port}")
        finally:
            process.terminate()
            process.wait(patience.SECONDS)


def new_bucket(service: Buckets) -> str:
    """Its URL, when the service answers."""
    made: list[str] = []

    def answers() -> bool:
        try:
            made.append(service.new())
        except OSError:
            return False
        return True

    patience.until(answers, lambda: "no bucket")
    return made[0]


def first_token(logs: list[Path]) -> str:
    """Told once, by one of them."""

    def said() -> list[str]:
        return [token for log in logs for token in re.findall(r"the first token, .*: (\S+)", log.read_text())]

    patience.until(lambda: len(said()) > 0, lambda: "no token was told")
    assert len(said()) == 1
    return said()[0]


def teach(made: Cluster) -> None:
    """The product of the other tests, over the network."""
    with made.client() as client:
        sweep = client.upload_sweep(material() / "golden.mcap", PRODUCT)
        client.make_recipe(PRODUCT, client.learn(PRODUCT, [sweep]))
