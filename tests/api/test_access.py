"""Tokens and roles: every route asks for one; what a token may do is what its role may do; changes are in the trail."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from api.app import create_app
from inspector.service.access import ROLES
from inspector.settings import read_settings

OPEN = {"/livez", "/readyz", "/metrics"}
OPERATORS = ("/v1/inspections",)
ADMINS = ("/v1/tokens",)


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    data = tmp_path_factory.mktemp("access")
    return create_app(read_settings(data=data, scorers=1, host="0.0.0.0"))


@pytest.fixture(scope="module")
def client(app: FastAPI) -> Iterator[TestClient]:
    with TestClient(app, base_url="http://station-7.example", raise_server_exceptions=False) as client:
        yield client


@pytest.fixture(scope="module")
def tokens(client: TestClient, app: FastAPI) -> dict[str, dict[str, str]]:
    """Headers by role."""
    first = app.state.service.access.make_first()
    assert app.state.service.access.make_first() is None
    told = {"admin": {"authorization": f"Bearer {first}"}}
    for role in ROLES[:3]:
        made = client.post("/v1/tokens", json={"name": f"a {role}", "role": role}, headers=told["admin"]).json()
        told[role] = {"authorization": f"bearer {made['token']}"}
    return told


def routes(client: TestClient) -> list[tuple[str, str]]:
    paths = client.get("/openapi.json").json()["paths"]
    return [(method, path) for path, item in paths.items() for method in item if path not in OPEN]


def needed(method: str, path: str) -> str:
    """The role that the plan says."""
    if path.startswith(ADMINS):
        return "admin"
    if method == "get":
        return "viewer"
    return "operator" if path.startswith(OPERATORS) or path.endswith("/locate") else "engineer"


def ask(client: TestClient, method: str, path: str, headers: dict[str, str]) -> Any:
    named = path.replace("{product_id}", "none").replace("{", "").replace("}", "")
    return client.request(method, named, headers=headers | {"content-type": "application/json"}, content=b"{}")


def test_every_route_asks_for_a_token(client: TestClient, tokens: dict[str, dict[str, str]]) -> None:
    wrong = ({}, {"authorization": "Bearer nonsense"}, {"authorization": "Basic YTpi"}, {"authorization": "Bearer"})
    for method, path in routes(client):
        for headers in wrong:
            answer = ask(client, method, path, headers)
            assert (answer.status_code, answer.headers["www-authenticate"]) == (401, "Bearer"), (method, path)
            assert answer.json()["type"] in ("urn:inspector:access-refused",)


def test_a_role_may_do_what_is_its_own_and_below(client: TestClient, tokens: dict[str, dict[str, str]]) -> None:
    for method, path in routes(client):
        if path == "/v1/events":
            continue
        for role in ROLES:
            answer = ask(client, method, path, tokens[role])
            allowed = ROLES.index(role) >= ROLES.index(needed(method, path))
            assert (answer.status_code == 403) != allowed, (method, path, role, answer.text)
            assert answer.status_code != 401
    viewer = ask(client, "post", "/v1/inspections", tokens["viewer"])
    assert viewer.json()["detail"] == "this token has the role viewer; needed is operator"


def test_a_token_tells_whose_it_is(client: TestClient, tokens: dict[str, dict[str, str]]) -> None:
    for role in ROLES[:3]:
        told = ask(client, "get", "/v1/me", tokens[role]).json()
        assert (told["role"], told["actor"].startswith(f"a {role} (")) == (role, True)


def test_probes_need_none(client: TestClient) -> None:
    assert [client.get(path).status_code for path in sorted(OPEN)] == [200, 200, 200]


def test_a_stream_needs_a_token_too(client: TestClient) -> None:
    with pytest.raises(WebSocketDisconnect), client.websocket_connect("/v1/inspections/none/stream"):
        pass


def test_a_token_that_is_revoked_is_refused_at_once(client: TestClient, tokens: dict[str, dict[str, str]]) -> None:
    asked = {"name": "Jane at the line", "role": "viewer"}
    made = client.post("/v1/tokens", json=asked, headers=tokens["admin"]).json()
    hers = {"authorization": f"Bearer {made['token']}"}
    assert client.get("/v1/products", headers=hers).status_code == 200
    told = client.delete(f"/v1/tokens/{made['token_id']}", headers=tokens["admin"]).json()
    assert told["revoked_ns"] is not None
    assert client.get("/v1/products", headers=hers).status_code == 401
    assert client.delete("/v1/tokens/none", headers=tokens["admin"]).status_code == 404
    listed = client.get("/v1/tokens", headers=tokens["admin"])
    assert made["token"] not in listed.text
    assert "sha256" not in listed.text
    trail = client.get("/v1/audit", headers=tokens["viewer"])
    assert [entry["action"] for entry in trail.json()["items"][:2]] == ["token.revoke", "token.add"]
    assert trail.json()["items"][0]["actor"].startswith("first admin (")
    assert made["token"] not in trail.text


@pytest.mark.parametrize(
    "asked", [{"name": "", "role": "viewer"}, {"name": "a", "role": "root"}, {"name": "a\nb", "role": "viewer"}, {}]
)
def test_a_token_that_cannot_be_is_refused(client: TestClient, tokens: dict[str, dict[str, str]], asked: Any) -> None:
    assert client.post("/v1/tokens", json=asked, headers=tokens["admin"]).status_code == 422


def test_keys_are_each_senders_own(client: TestClient, tokens: dict[str, dict[str, str]]) -> None:
    key = {"Idempotency-Key": "mine"}
    for role in ("engineer", "admin"):
        answer = client.post("/v1/products/none/recipes", json={"note": role}, headers=tokens[role] | key)
        assert answer.status_code == 404
