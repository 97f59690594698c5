"""The shell around every route: problems, limits, who may ask from where, documentation without a network."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from starlette.testclient import WebSocketDenialResponse

import api
import inspector
import models
from api.app import create_app
from api.errors import KINDS, kind_of
from inspector.errors import WorldError
from inspector.settings import read_settings
from models.errors import InspectionError

HERE = "http://127.0.0.1"


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    return create_app(read_settings(data=tmp_path_factory.mktemp("shell") / "data", scorers=1))


@pytest.fixture(scope="module")
def client(app: FastAPI) -> Iterator[TestClient]:
    with TestClient(app, base_url=HERE, raise_server_exceptions=False) as client:
        yield client


def family(kind: type[InspectionError]) -> Iterator[type[InspectionError]]:
    for each in kind.__subclasses__():
        yield each
        yield from family(each)


def test_every_error_has_a_place_in_the_table() -> None:
    for package in (models, inspector, api):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not module.name.endswith("__main__") and ".migrations" not in module.name:
                importlib.import_module(module.name)
    assert InspectionError not in KINDS
    assert WorldError not in KINDS
    lost = {each for each in family(InspectionError) if not set(each.__mro__) & set(KINDS)}
    # Labelled sets and batches are worked on at the command line only, no request comes where nobody listens, and a
    # client is the other side. Executors are opened in processes whose errors arrive as WorkFailed.
    elsewhere = tuple(f"inspector.{name}" for name in ("evaluation.", "batch.", "executors", "serving", "client."))
    elsewhere = (*elsewhere, "api.cluster")
    assert {each for each in lost if not each.__module__.startswith(elsewhere)} <= {WorldError}
    assert kind_of(type("New", (next(iter(KINDS)),), {}))[1] is next(iter(KINDS.values()))


def test_health_needs_no_token(client: TestClient) -> None:
    assert client.get("/livez").json()["state"] == "alive"
    assert client.get("/readyz").json() == {"state": "ready", "reasons": []}
    assert 'inspector_requests_total{method="GET",route="/readyz",status="200"} 1.0' in client.get("/metrics").text


def test_what_cannot_work_says_why(client: TestClient, app: FastAPI) -> None:
    incoming: Path = app.state.service.folder.path / "incoming"
    incoming.rmdir()
    answer = client.get("/readyz")
    incoming.mkdir()
    assert answer.status_code == 503
    assert answer.json()["state"] == "not ready"
    assert "allowed is a folder that this program may write to" in answer.json()["reasons"][0]
    assert str(incoming.parent) not in answer.text


@pytest.mark.parametrize(
    ("method", "path", "status"), [("GET", "/v1/nothing", 404), ("DELETE", "/livez", 405), ("GET", "/livez/", 404)]
)
def test_what_is_not_there_is_a_problem_document(client: TestClient, method: str, path: str, status: int) -> None:
    answer = client.request(method, path)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert set(answer.json()) == {"type", "title", "status", "detail"}
    assert (answer.json()["status"], path in answer.json()["detail"]) == (status, True)


def test_what_was_not_expected_is_told_in_the_log_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    app = create_app(read_settings(data=tmp_path, database="memory:", scorers=1))

    @app.get("/broken")
    def broken() -> None:
        raise RuntimeError("a secret")

    with TestClient(app, base_url=HERE, raise_server_exceptions=False) as client:
        answer = client.get("/broken")
    assert answer.status_code == 500
    assert answer.headers["content-type"] == "application/problem+json"
    assert "secret" not in answer.text
    assert "a secret" in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"host": "localhost:8000"}, 200),
        ({"host": "[::1]:8000"}, 200),
        ({"host": "evil.example"}, 403),
        ({"host": "127.0.0.1.evil.example"}, 403),
        ({"host": ""}, 403),
        ({"origin": "http://127.0.0.1"}, 200),
        ({"origin": "http://127.0.0.1:9000"}, 403),
        ({"origin": "https://evil.example"}, 403),
        ({"origin": "null"}, 403),
    ],
)
def test_pages_from_elsewhere_cannot_ask(client: TestClient, headers: dict[str, str], status: int) -> None:
    assert client.get("/livez", headers=headers).status_code == status


def test_a_stream_cannot_be_opened_by_a_page_from_elsewhere(client: TestClient) -> None:
    evil = {"origin": "https://evil.example"}
    with (
        pytest.raises(WebSocketDenialResponse) as denied,
        client.websocket_connect("ws://127.0.0.1/v1/x", headers=evil),
    ):
        pass
    assert denied.value.status_code == 403
    assert "only pages of this service" in denied.value.json()["detail"]


def test_no_other_origin_is_invited(client: TestClient) -> None:
    preflight = {"origin": HERE, "access-control-request-method": "POST"}
    assert "access-control-allow-origin" not in client.options("/livez", headers=preflight).headers


def test_a_body_may_not_be_too_large(client: TestClient) -> None:
    told = client.post("/v1/anything", content=b"", headers={"content-length": str(4 << 30)})
    assert (told.status_code, told.headers["connection"]) == (413, "close")
    assert "allowed are 1048576 bytes" in told.json()["detail"]


def test_the_documentation_needs_nothing_from_elsewhere(client: TestClient) -> None:
    page = client.get("/docs")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    links = re.findall(r"(?:src|href|url)[=(]['\"]?([^'\" >)]*)", page.text)
    assert {link for link in links if link[0] != "#"} == {"/openapi.json"}
    for path in client.get("/openapi.json").json()["paths"]:
        assert path in page.text


def test_every_problem_is_documented_as_one(client: TestClient) -> None:
    for path, item in client.get("/openapi.json").json()["paths"].items():
        for method, operation in item.items():
            assert operation.get("description"), (method, path)
            for status, answer in operation["responses"].items():
                if int(status) >= 400 and path != "/readyz":
                    assert list(answer["content"]) == ["application/problem+json"], (method, path, status)
