"""What can be said of the image without an engine: its files are there, its settings exist, its health check tells."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
import yaml

from inspector.settings import Settings
from tests.system.repository import ROOT, texts

DOCKER = {name: text for name, text in texts().items() if name.startswith("docker/")}
DOCKERFILE = DOCKER["docker/Dockerfile"]
CONNECTIONS = 9
"""Of a service: what `inspector/stores/README.md` says of it, and its tests count."""
COMPOSE_ONLY = {"INSPECTOR_PUBLISH"}
FOR_TESTS = {"INSPECTOR_TESTS_S3"}


class Answers(BaseHTTPRequestHandler):
    """A service that answers every path with its status."""

    status = 200

    def do_GET(self) -> None:
        ready = self.path == "/readyz"
        self.send_response(self.status if ready else 404)
        self.end_headers()
        self.wfile.write(b"the disk is full")

    def log_message(self, format: str, *args: object) -> None:
        pass


@contextmanager
def answering(status: int) -> Iterator[int]:
    """The port of a service that answers so."""
    with HTTPServer(("127.0.0.1", 0), type("Handler", (Answers,), {"status": status})) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


def ready(port: int) -> subprocess.CompletedProcess[str]:
    """The health check, as the image runs it."""
    environment = {"INSPECTOR_PORT": str(port), "http_proxy": "http://127.0.0.1:1"}
    command = [sys.executable, "-I", ROOT / "docker/ready.py"]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("status", "code", "told"), [(200, 0, ""), (503, 1, "the disk is full\n")])
def test_the_health_check_says_whether_the_service_is_ready(status: int, code: int, told: str) -> None:
    with answering(status) as port:
        said = ready(port)
    assert (said.returncode, said.stdout, said.stderr) == (code, told, "")


def test_the_health_check_fails_where_nothing_listens() -> None:
    said = ready(1)
    assert said.returncode == 1
    assert "refused" in said.stdout
    assert said.stderr == ""


def test_what_is_copied_is_there_and_is_let_in() -> None:
    let_in = re.findall(r"^!(\S+)$", DOCKER["docker/Dockerfile.dockerignore"], re.MULTILINE)
    copied = [
        source
        for line in re.findall(r"^COPY (?!--from)(.+)$", DOCKERFILE, re.MULTILINE)
        for source in line.split()[:-1]
    ]
    assert sorted(copied) == sorted(let_in)
    assert [name for name in copied if not (ROOT / name).exists()] == []


def test_every_setting_that_is_named_exists() -> None:
    named = (
        {name for text in DOCKER.values() for name in re.findall(r"INSPECTOR_[A-Z0-9_]*[A-Z0-9]", text)}
        - COMPOSE_ONLY
        - FOR_TESTS
    )
    assert {name.removeprefix("INSPECTOR_").lower() for name in named} <= set(Settings.model_fields)


def test_the_database_lets_all_services_in_that_the_proxy_knows() -> None:
    most = re.search(r"server-template node 1-(\d+) ", DOCKER["docker/haproxy.cfg"])
    allowed = re.search(r"max_connections=(\d+)", DOCKER["docker/compose.cluster.yaml"])
    assert most is not None
    assert allowed is not None
    # Three are kept for who looks after it.
    assert int(most[1]) * CONNECTIONS + 3 <= int(allowed[1])


def test_no_log_fills_the_disk() -> None:
    files = [yaml.safe_load(text) for name, text in DOCKER.items() if name.endswith(".yaml")]
    services = [service for file in files for service in file["services"].values()]
    assert {service["logging"]["driver"] for service in services} == {"local"}


def test_the_image_runs_as_nobody_special_and_is_asked_for_its_health() -> None:
    last = DOCKERFILE.split("\nFROM ")[-1]
    assert re.search(r"^USER 10001:10001$", last, re.MULTILINE)
    assert re.search(r"^HEALTHCHECK .*ready\.py", last, re.MULTILINE)
    assert "pip install" not in last
