"""Trends over HTTP: groups that add up, since which part scores moved, what people said; the station's figures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from api.app import create_app
from inspector.service.metrics import Metrics
from inspector.settings import read_settings
from tests.api.stations import GOOD, PRODUCT, begin, came_out, feed, frames, teach

HERE = "http://127.0.0.1"
TRENDS = f"/v1/products/{PRODUCT}/trends"


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    return create_app(read_settings(data=tmp_path_factory.mktemp("trends"), scorers=1))


@pytest.fixture(scope="module")
def client(app: FastAPI) -> Iterator[TestClient]:
    with TestClient(app, base_url=HERE) as client:
        yield client


@pytest.fixture(scope="module")
def parts(client: TestClient, app: FastAPI) -> list[str]:
    """Sixty parts, of which every tenth is NG; from the fortieth on the score is higher about s = 0.5."""
    service: Any = app.state.service
    recipe = teach(service)
    verdicts = ["NG" if number % 10 == 9 else "OK" for number in range(60)]
    return came_out(service.store, recipe, verdicts, moved_since=40, begun_ns=0, every_ns=1000)


def test_groups_add_up_and_the_oldest_takes_the_rest(client: TestClient, parts: list[str]) -> None:
    told = client.get(TRENDS, params={"group": 25}).json()
    assert [each["parts"] for each in told["groups"]] == [10, 25, 25]
    assert [each["rejected"] for each in told["groups"]] == [1, 2, 3]
    assert (told["parts"], told["verdicts"]) == (60, {"OK": 54, "NG": 6})
    assert told["groups"][0]["start_ns"] == 1000
    assert told["groups"][-1]["end_ns"] == 60000
    fewer = client.get(TRENDS, params={"group": 10, "last": 20}).json()
    assert [(each["parts"], each["rejected"]) for each in fewer["groups"]] == [(10, 1), (10, 1)]


def test_drift_is_told_where_and_since_which_part(client: TestClient, parts: list[str]) -> None:
    drift = client.get(TRENDS).json()["drift"]
    (change,) = drift["changes"]
    assert (change["s_start"], change["s_end"]) == (0.48, 0.54)
    assert (change["inspection_id"], change["since_ns"]) == (parts[40], 41000)
    assert change["after"] - change["before"] == pytest.approx(0.4, abs=0.01)
    assert drift["later"][25] - drift["earlier"][25] == pytest.approx(0.4, abs=0.01)
    assert drift["later"][5] == pytest.approx(drift["earlier"][5], abs=0.01)


def test_people_are_counted_by_what_they_said_last(client: TestClient, parts: list[str]) -> None:
    def say(part: str, **said: str) -> None:
        assert client.post(f"/v1/inspections/{part}/disposition", json=said).status_code == 200

    say(parts[9], decision="confirm")
    say(parts[19], decision="confirm")
    say(parts[19], decision="overrule", verdict="OK")
    say(parts[0], decision="overrule", verdict="NG")
    say(parts[1], decision="confirm")
    people = client.get(TRENDS).json()["people"]
    assert (people["escapes"], people["looked_at_ok"]) == (1, 2)
    assert (people["false_rejects"], people["looked_at_rejected"]) == (1, 2)
    assert (people["confirmed"], people["undecided"]) == (2, 56)


def test_of_nothing_there_are_no_trends(client: TestClient, app: FastAPI, parts: list[str]) -> None:
    service: Any = app.state.service
    service.store.ensure_product("fresh", 1)
    told = client.get("/v1/products/fresh/trends").json()
    assert (told["parts"], told["groups"], told["drift"]) == (0, [], None)
    assert client.get("/v1/products/none/trends").status_code == 404
    assert client.get(TRENDS, params={"last": 5001}).status_code == 422


def test_the_station_counts_frames_and_tells_how_long_they_take(client: TestClient, parts: list[str]) -> None:
    before = client.get("/v1/station").json()
    assert (before["frames"]["scored"], before["latency"]) == (0, {"p50": None, "p99": None})
    feed(client, begin(client), frames(GOOD)[:5])
    after = client.get("/v1/station").json()
    assert (after["frames"]["scored"], after["running"], after["state"]) == (5, 1, "inspecting")
    assert 0 < after["latency"]["p50"] <= after["latency"]["p99"]
    assert [(node["state"], node["running"]) for node in after["nodes"]] == [("inspecting", 1)]
    assert "inspector_services 1.0" in client.get("/metrics").text


def test_latency_is_read_from_the_buckets() -> None:
    metrics = Metrics()
    assert metrics.latency(0.5) is None
    for _ in range(90):
        metrics.stages.labels("total").observe(0.004)
    for _ in range(10):
        metrics.stages.labels("total").observe(0.04)
    metrics.stages.labels("wait").observe(9.0)
    assert metrics.latency(0.45) == pytest.approx(0.004)
    assert metrics.latency(0.9) == pytest.approx(0.005)
    assert metrics.latency(0.95) == pytest.approx(0.04)
    metrics.stages.labels("total").observe(99.0)
    assert metrics.latency(1.0) == 2.0


def test_a_new_recipe_is_no_drift(app: FastAPI, parts: list[str]) -> None:
    service: Any = app.state.service
    came_out(service.store, teach(service), ["OK"] * 25, first=60, moved_since=99, begun_ns=100_000, every_ns=1000)
    # Twenty parts that scored higher, and twenty-five that do not, by another recipe.
    drift = service.trends.of(PRODUCT, 45, None)["drift"]
    assert (drift["changes"], drift["later"][25]) == ([], pytest.approx(0.3, abs=0.01))
