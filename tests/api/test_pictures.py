"""Pictures of recorded frames: as recorded, expected, seen, and what is out of tolerance, where the regions are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from api.app import create_app
from inspector.pictures import encode_jpeg
from inspector.service.showing import Shelf
from inspector.settings import read_settings
from tests.api.stations import BAD, begin, feed, frames, learnt, picture, post, sweep, teach

KINDS = ("frame", "expected", "seen", "difference")


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    return create_app(read_settings(data=tmp_path_factory.mktemp("pictures"), scorers=1))


@pytest.fixture(scope="module")
def client(app: FastAPI) -> Iterator[TestClient]:
    with TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False) as client:
        teach(app.state.service)
        yield client


@pytest.fixture(scope="module")
def inspected(client: TestClient) -> dict[str, Any]:
    inspection = begin(client)
    feed(client, inspection)
    return client.post(f"/v1/inspections/{inspection}/conclude").json()


def shown(client: TestClient, inspection: str, index: int, kind: str) -> np.ndarray:
    answer = client.get(f"/v1/inspections/{inspection}/frames/{index}/pictures/{kind}")
    assert answer.status_code == 200, answer.text
    assert "immutable" in answer.headers["cache-control"]
    return cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_UNCHANGED)


def test_a_defect_is_seen_where_its_region_is(client: TestClient, inspected: dict[str, Any]) -> None:
    inspection, at = inspected["inspection_id"], inspected["deviations"][0]["peak_index"]
    told = client.get(f"/v1/inspections/{inspection}/frames/{at}").json()
    assert {name: told[name] for name in inspected["frames"][at]} == inspected["frames"][at]
    region = told["regions"][0]
    expected, seen, heat = (shown(client, inspection, at, kind) for kind in KINDS[1:])
    assert (expected.shape, seen.shape, heat.shape) == ((180, 240), (180, 240), (180, 240, 4))
    y, x = np.argwhere(heat[..., 3] > 128).mean(axis=0)
    a, b, c, d, e, f = told["placement"]
    across, down = a * x + b * y + c, d * x + e * y + f
    assert region["x"] - 4 <= across <= region["x"] + region["width"] + 4
    assert region["y"] - 4 <= down <= region["y"] + region["height"] + 4
    apart = np.abs(expected.astype(int) - seen)[10:-10, 10:-10]
    assert (apart.max() > 25, np.median(apart) < 8) == (True, True)
    assert {tuple(ink) for ink in heat[heat[..., 3] > 0][:, :3].tolist()} <= {(0, 140, 255), (255, 110, 30)}


def test_the_frame_is_as_it_was_recorded_whatever_the_order(client: TestClient, inspected: dict[str, Any]) -> None:
    inspection = inspected["inspection_id"]
    for index in (30, 3, 31, 0, len(frames()) - 1):
        path = f"/v1/inspections/{inspection}/frames/{index}/pictures/frame"
        answer = client.get(path)
        assert (answer.content, answer.headers["content-type"]) == (picture(frames()[index]), "image/jpeg")
    again = client.get(path, headers={"if-none-match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def test_a_replay_shows_what_it_is_a_replay_of(client: TestClient, inspected: dict[str, Any]) -> None:
    replayed = client.post("/v1/replays", json={"inspection_id": inspected["inspection_id"]}).json()["inspection_id"]
    assert client.get(f"/v1/inspections/{replayed}/frames/7/pictures/frame").content == picture(frames()[7])
    mcap = {"content-type": "application/octet-stream"}
    sent = client.post("/v1/products/plate/sweeps", content=sweep(BAD).read_bytes(), headers=mcap).json()
    of_sweep = client.post("/v1/replays", json={"sweep_id": sent["sweep_id"]}).json()["inspection_id"]
    assert client.get(f"/v1/inspections/{of_sweep}/frames/8/pictures/frame").content == picture(frames(BAD)[8])
    at = inspected["deviations"][0]["peak_index"]
    both = [shown(client, each, at, "difference") for each in (replayed, inspected["inspection_id"])]
    np.testing.assert_array_equal(*both)


def test_what_cannot_be_shown_says_why(client: TestClient, app: FastAPI) -> None:
    inspection = begin(client)
    blind = encode_jpeg(np.full((180, 240), 9, np.uint8)).data
    client.post(f"/v1/inspections/{inspection}/frames", content=blind, headers={"content-type": "image/jpeg"})
    post(client, inspection, frames()[0], sequence=1)
    path = f"/v1/inspections/{inspection}/frames"
    for asked in ("0", "0/pictures/frame"):
        problem(client.get(f"{path}/{asked}"), 409, "there is a frame to look at when it is concluded")
    client.post(f"/v1/inspections/{inspection}/conclude")
    assert client.get(f"{path}/0/pictures/frame").content == blind
    assert client.get(f"{path}/0").json()["placement"] == []
    problem(client.get(f"{path}/0/pictures/seen"), 404, "it was not compared with what is expected: it is blind")
    problem(client.get(f"{path}/2"), 404, "it has 2 frames, counted from 0")
    problem(client.get(f"{path}/2/pictures/frame"), 404, "it has 2 frames, counted from 0")
    assert client.get(f"{path}/0/pictures/other").status_code == 422
    assert client.get(f"{path}/-1").status_code == 422
    problem(client.get(f"/v1/inspections/{'0' * 32}/frames/0/pictures/seen"), 404, "no inspection")
    service = app.state.service
    service.files.whole(inspection).unlink()
    service.store.set_recording(inspection, "removed", note="it was too old")
    problem(client.get(f"{path}/1/pictures/frame"), 410, "it was too old")
    assert client.get(f"{path}/1").status_code == 200


def problem(answer: Any, status: int, said: str) -> None:
    assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json"), answer.text
    assert said in answer.json()["detail"]


@pytest.mark.parametrize("room", [1, 60_000, 1 << 30])
def test_any_frame_of_many_recordings_is_found_however_little_is_held(room: int) -> None:
    shelf = Shelf(room)
    paths: list[Path] = [sweep(BAD), sweep(), *(sweep(f"unit={unit}&seed={unit}") for unit in range(3, 8))]
    for index in (5, 6, 2, 35, 0):
        for path in paths:
            kept = shelf.frame(path, index)
            wanted = frames(path.stem)[index]
            assert kept is not None
            assert (kept.t_ns, kept.sequence, kept.picture.data) == (wanted.t_ns, wanted.sequence, picture(wanted))
    assert shelf.frame(paths[0], 40) is None


def test_what_is_expected_anywhere_and_how_densely_it_was_shown(client: TestClient) -> None:
    path = f"/v1/products/plate/appearances/{learnt().id}"
    told = client.get(f"{path}/sampling")
    found = told.json()
    assert {len(found[name]) for name in ("s", "pixels_per_frame", "frames_per_spot", "curve_per_frame")} == {
        learnt().places
    }
    assert (found["moves"], found["width"], found["height"], found["advice"]) == (True, 240, 180, [])
    assert client.get(f"{path}/sampling", headers={"if-none-match": told.headers["etag"]}).status_code == 304
    for s in (0, 0.4, 1):
        picture = client.get(f"{path}/reference?s={s}")
        place = int(picture.headers["reference-place"])
        assert place == learnt().key_at(s)
        assert picture.content == learnt().pictures[learnt().keys.tolist().index(place)]
        assert float(picture.headers["reference-s"]) == pytest.approx(s, abs=0.1)
        assert float(picture.headers["reference-s"]) in found["reference_s"]
    assert client.get(f"{path}/reference?s=1.1").status_code == 422
    for asked in ("sampling", "reference"):
        problem(client.get(f"/v1/products/plate/appearances/sha256:0/{asked}"), 404, "no appearance")


def test_a_service_that_stops_says_so(tmp_path: Path) -> None:
    app = create_app(read_settings(data=tmp_path, scorers=1))
    with TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False) as client:
        teach(app.state.service)
        app.state.service.jobs.close()
        problem(client.get(f"/v1/products/plate/appearances/{learnt().id}/sampling"), 503, "is being stopped")
