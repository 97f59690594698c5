"""`inspector serve` as a process: one line when it is up, one line when it cannot be, an end that loses nothing."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import ssl
import subprocess
import sys
from collections.abc import Generator
from contextlib import closing, contextmanager, suppress
from http.client import HTTPConnection
from pathlib import Path

import pytest

from tests import patience
from tests.api.stations import material

COMMAND = [sys.executable, "-c", "from inspector.cli import main; main()", "serve"]


class Server:
    """A running service."""

    def __init__(self, process: subprocess.Popen[str], url: str) -> None:
        self.process, self.url = process, url
        self.port = int(url.rpartition(":")[2])

    def end(self, number: int = signal.SIGTERM) -> tuple[int, str]:
        """Exit code, and what it logged."""
        self.process.send_signal(number)
        _, err = self.process.communicate(timeout=600)
        return self.process.returncode, err


@contextmanager
def running(data: Path, *options: str, **environment: str) -> Generator[Server]:
    arguments = ["--data", str(data), "--port", "0", *options]
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "INSPECTOR_SCORERS": "1", **environment},
    )
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = re.match(r"inspector serves at (\S+); documentation at \1/docs\n", line)
        assert found, line or process.communicate()
        yield Server(process, found[1])
    finally:
        process.kill()
        process.communicate()


def refused(*arguments: str) -> str:
    """The one line of a service that cannot be."""
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stdout) == (1, ""), done
    (line,) = done.stderr.splitlines()
    return line


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("serve") / "data"


@pytest.fixture(scope="module")
def server(data: Path) -> Generator[Server]:
    with running(data, INSPECTOR_MAX_RECORDING="2000000") as server:
        yield server


def test_it_is_up_after_one_line(server: Server) -> None:
    assert patience.get(f"{server.url}/readyz").json() == {"state": "ready", "reasons": []}
    assert "Sweep Inspector" in patience.get(f"{server.url}/docs").text


def test_a_second_service_on_the_folder_says_so_in_a_line(server: Server, data: Path) -> None:
    line = refused("--data", str(data), "--port", "0")
    assert line.startswith(f"inspector: {data}: another service works on this folder")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--port", "PORT"], "inspector: cannot listen at 127.0.0.1, port PORT: Address already in use"),
        (["--host", "192.0.2.1"], "inspector: cannot listen at 192.0.2.1, port 0: "),
        (["--tls-key", "key.pem"], "inspector: setting tls_key is 'key.pem': it goes with tls_cert"),
        (["--tls-cert", "none.pem"], "inspector: setting tls_cert is 'none.pem': No such file"),
        (["--camera", "a/b=opencv:0"], "inspector: setting cameras: Value error, 'a/b' is no name"),
        (["--database", "nonsense:x"], "inspector: database 'nonsense': no such kind"),
    ],
)
def test_what_cannot_be_says_so_in_a_line(server: Server, tmp_path: Path, options: list[str], said: str) -> None:
    port = str(server.port)
    line = refused("--data", str(tmp_path / "data"), "--port", "0", *(each.replace("PORT", port) for each in options))
    assert line.startswith(said.replace("PORT", port))


def test_an_upload_that_breaks_off_leaves_nothing(server: Server, data: Path) -> None:
    body = (material() / "golden.mcap").read_bytes()
    with socket.create_connection(("127.0.0.1", server.port)) as line:
        head = "POST /v1/products/p/sweeps HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/octet-stream\r\n"
        line.sendall(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body[:-9])
        patience.until(lambda: any((data / "incoming").iterdir()))
    patience.until(lambda: not any((data / "incoming").iterdir()))
    assert patience.get(f"{server.url}/v1/products").json()["items"] == []


def test_a_body_that_is_too_large_is_answered_at_once_and_not_read(server: Server) -> None:
    with closing(HTTPConnection("127.0.0.1", server.port, timeout=120)) as line:
        line.putrequest("POST", "/v1/products/p/sweeps")
        line.putheader("Content-Length", str(4 << 30))
        line.putheader("Content-Type", "application/octet-stream")
        line.endheaders(b"\x89MCAP0\r\n")
        answer = line.getresponse()
        assert (answer.status, answer.getheader("connection")) == (413, "close")
        assert "allowed are 2000000 bytes" in json.loads(answer.read())["detail"]


def test_what_is_no_recording_is_refused_after_its_first_bytes(server: Server) -> None:
    with closing(HTTPConnection("127.0.0.1", server.port, timeout=120)) as line:
        line.putrequest("POST", "/v1/products/p/sweeps")
        line.putheader("Transfer-Encoding", "chunked")
        line.endheaders()
        with suppress(ConnectionError):
            # Refused while this is on its way.
            for _ in range(2):
                line.send(b"80000\r\n" + bytes(0x80000) + b"\r\n")
        answer = line.getresponse()
        assert (answer.status, answer.getheader("connection")) == (422, "close")


def test_listeners_do_not_hold_up_the_end_and_nothing_is_logged_but_that(server: Server) -> None:
    with patience.stream("GET", f"{server.url}/v1/events") as events:
        lines = events.iter_lines()
        next(lines)
        code, err = server.end(signal.SIGINT)
        assert code == 0
        assert any("stopping" in line for line in lines)
    assert [json.loads(line)["event"] for line in err.splitlines()] == ["stopping"]


def test_off_loopback_a_token_is_needed_and_the_first_is_told_once(tmp_path: Path) -> None:
    with running(tmp_path / "data", "--require-token") as server:
        assert server.process.stdout is not None
        told = server.process.stdout.readline()
        assert told.startswith("the first token, of an admin; it is told this once: ")
        admin = {"authorization": f"Bearer {told.split()[-1]}"}
        nobody = patience.get(f"{server.url}/v1/products")
        assert (nobody.status_code, nobody.headers["www-authenticate"]) == (401, "Bearer")
        assert patience.get(f"{server.url}/v1/products", headers=admin).status_code == 200
        assert server.end()[0] == 0
    database = (tmp_path / "data" / "service.sqlite").read_bytes()
    assert told.split()[-1].encode() not in database
    with running(tmp_path / "data", "--require-token") as server:
        assert patience.get(f"{server.url}/v1/products", headers=admin).status_code == 200
        server.process.send_signal(signal.SIGTERM)
        assert server.process.communicate()[0] == ""


def test_a_job_that_is_cut_off_has_failed_whether_by_an_end_or_by_a_kill(tmp_path: Path) -> None:
    options = ("--camera", "top=simulated:?frames=20000&realtime=1&size=64x48")

    def begin(server: Server) -> str:
        asked = {"camera": "top", "frames": 19_000}
        job = patience.post(f"{server.url}/v1/products/p/sweeps", json=asked).json()["job_id"]
        patience.until(lambda: patience.get(f"{server.url}/v1/jobs/{job}").json()["progress"] > 0)
        return job

    def failed(server: Server, job: str) -> str:
        told = patience.get(f"{server.url}/v1/jobs/{job}").json()
        assert told["state"] == "failed"
        return told["error"]

    with running(tmp_path / "data", *options) as server:
        ended = begin(server)
        assert server.end()[0] == 0
    with running(tmp_path / "data", *options) as server:
        assert failed(server, ended) == "the service was stopped before this was done"
        killed = begin(server)
        server.process.kill()
        server.process.wait()
    with running(tmp_path / "data", *options) as server:
        assert failed(server, killed) == "the service ended while this was being done"
        assert list((tmp_path / "data" / "incoming").iterdir()) == []


def test_it_speaks_https(tmp_path: Path) -> None:
    made = subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
         "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", "key.pem", "-out", "cert.pem"],
        cwd=tmp_path, capture_output=True, check=False,
    )  # fmt: skip
    if made.returncode:
        pytest.skip("openssl is not here")
    options = ["--tls-cert", str(tmp_path / "cert.pem"), "--tls-key", str(tmp_path / "key.pem")]
    with running(tmp_path / "data", *options) as server:
        trusted = ssl.create_default_context(cafile=str(tmp_path / "cert.pem"))
        assert patience.get(f"{server.url}/livez", verify=trusted).json()["state"] == "alive"
        assert server.url.startswith("https://")
