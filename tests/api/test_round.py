"""The whole round over HTTP: upload, learn, recipe, replay, judge again; and what is refused on the way."""

from __future__ import annotations

import hashlib
import json
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from api.app import create_app
from inspector.learner import add_recordings, learn_recordings, load_appearance
from inspector.pictures import decode, encode_png
from inspector.policies import PolicyFile
from inspector.recording import SweepReader, SweepWriter
from inspector.replay import replay
from inspector.settings import read_settings
from models.frame import EncodedPicture, Frame
from models.verdict import Policy
from tests.api.stations import BAD, GOOD, LINE, bomb, feed, material, sweep
from tests.inspector.line import cut, recorded
from tests.patience import until

HERE = "http://127.0.0.1"
MCAP = {"content-type": "application/octet-stream"}
PROBLEM = "application/problem+json"


RECTANGLE = {"s": 0.4, "x": 10, "y": 10, "width": 20, "height": 20}
MASK = b64encode(encode_png(np.eye(9, dtype=np.uint8)).data).decode()


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    data = tmp_path_factory.mktemp("round")
    cameras = {"top": f"{LINE}&unit=8&seed=8", "gone": "opencv:rtsp://me:secret@127.0.0.1:9/none"}
    return create_app(read_settings(data=data, scorers=1, cameras=cameras, max_recording=20_000_000))


@pytest.fixture(scope="module")
def client(app: FastAPI) -> Iterator[TestClient]:
    with TestClient(app, base_url=HERE, raise_server_exceptions=False) as client:
        yield client


def uploaded(client: TestClient, path: Path, product: str = "plate", **headers: str) -> str:
    answer = client.post(f"/v1/products/{product}/sweeps", content=path.read_bytes(), headers=MCAP | headers)
    assert answer.status_code == 201, answer.text
    return answer.json()["sweep_id"]


def ended(client: TestClient, job_id: str) -> dict[str, Any]:
    """The job when it is over."""
    job: dict[str, Any] = {}

    def has_ended() -> bool:
        job.update(client.get(f"/v1/jobs/{job_id}").json())
        return job["state"] != "running"

    until(has_ended, lambda: job)
    return job


def refused(answer: Any, status: int, said: str) -> None:
    assert (answer.status_code, answer.headers["content-type"]) == (status, PROBLEM), answer.text
    assert said in answer.json()["detail"]


def incoming(client: TestClient) -> list[Path]:
    app: Any = client.app
    return list((app.state.service.folder.path / "incoming").iterdir())


@pytest.fixture(scope="module")
def golden(client: TestClient) -> str:
    return uploaded(client, material() / "golden.mcap")


@pytest.fixture(scope="module")
def appearance(client: TestClient, golden: str) -> str:
    answer = client.post("/v1/products/plate/appearances", json={"sweep_ids": [golden]})
    assert answer.status_code == 202, answer.text
    job = ended(client, answer.json()["job_id"])
    assert (job["state"], job["progress"], job["error"]) == ("done", 1.0, None)
    return job["appearance_id"]


@pytest.fixture(scope="module")
def recipe(client: TestClient, appearance: str) -> dict[str, Any]:
    answer = client.post("/v1/products/plate/recipes", json={"appearance_id": appearance, "activate": True})
    assert answer.status_code == 201, answer.text
    return answer.json()


@pytest.fixture(scope="module")
def inspected(client: TestClient, recipe: dict[str, Any]) -> dict[str, Any]:
    """A live inspection of a bad part, concluded."""
    begun = client.post("/v1/inspections", json={"product_id": "plate", "part_id": "0007"}).json()
    feed(client, begun["inspection_id"])
    return client.post(f"/v1/inspections/{begun['inspection_id']}/conclude").json()


def test_an_upload_is_kept_as_it_came(client: TestClient, golden: str) -> None:
    data = (material() / "golden.mcap").read_bytes()
    kept, count = (
        client.get(f"/v1/products/plate/sweeps/{golden}").json(),
        len(list(SweepReader(material() / "golden.mcap"))),
    )
    assert kept["sha256"] == hashlib.sha256(data).hexdigest()
    assert (kept["bytes"], kept["frames"], kept["source"], kept["losses"]) == (len(data), count, "upload", [])
    assert client.get(f"/v1/products/plate/sweeps/{golden}/recording").content == data
    assert [each["sweep_id"] for each in client.get("/v1/products/plate/sweeps").json()["items"]][-1] == golden


def test_the_service_learns_what_the_command_line_learns(client: TestClient, appearance: str, tmp_path: Path) -> None:
    assert appearance == learn_recordings([material() / "golden.mcap"], tmp_path / "a").id
    told = client.get(f"/v1/products/plate/appearances/{appearance}").json()
    assert (told["facts"]["sweeps"], told["facts"]["width"], told["facts"]["height"]) == ("1", 240, 180)
    assert told["bytes"] == (tmp_path / "a").stat().st_size
    (only,) = client.get("/v1/products/plate/appearances").json()["items"]
    assert only == told


def test_sweeps_are_added_as_on_the_command_line(client: TestClient, appearance: str, tmp_path: Path) -> None:
    good = uploaded(client, sweep(GOOD))
    asked = {"sweep_ids": [good], "add_to": appearance}
    job = ended(client, client.post("/v1/products/plate/appearances", json=asked).json()["job_id"])
    there = add_recordings([sweep(GOOD)], material() / "plate.appearance", tmp_path / "b")
    assert job["appearance_id"] == there.id != appearance
    told = client.get(f"/v1/products/plate/appearances/{there.id}").json()
    assert told["sweep_ids"][-1] == good
    assert len(told["sweep_ids"]) == 2


def test_what_cannot_be_learnt_from_is_told_by_the_id_of_the_sweep(
    client: TestClient, golden: str, app: FastAPI, tmp_path: Path
) -> None:
    stranger = uploaded(client, recorded(tmp_path / "stranger.mcap", "part=casting&size=240x180"))
    asked = {"sweep_ids": [golden, stranger]}
    job = ended(client, client.post("/v1/products/plate/appearances", json=asked).json()["job_id"])
    assert job["state"] == "failed"
    assert job["error"].startswith(f"sweep {stranger}: golden sweep 2 fits the reference sweep in ")
    assert str(app.state.service.folder.path) not in json.dumps(job)
    assert incoming(client) == []


@pytest.mark.parametrize(
    ("asked", "status", "said"),
    [
        ({"sweep_ids": ["0" * 32]}, 404, "there is no sweep"),
        ({"sweep_ids": []}, 422, "body.sweep_ids"),
        ({"sweep_ids": ["GOLDEN", "GOLDEN"]}, 422, "named twice"),
        ({"sweep_ids": ["GOLDEN"], "add_to": "sha256:0"}, 404, "there is no appearance"),
        ({"sweep_ids": ["GOLDEN"], "nonsense": 1}, 422, "body.nonsense"),
        ({}, 422, "one of `sweep_ids` and `of` is needed"),
        ({"sweep_ids": ["GOLDEN"], "of": "sha256:0"}, 422, "one of `sweep_ids` and `of` is needed"),
        ({"of": "sha256:0"}, 422, "`of` and `excuse` go together"),
        ({"of": "sha256:0", "excuse": [RECTANGLE | {"width": 0}]}, 422, "body.excuse.0.width"),
        ({"of": "sha256:0", "excuse": [RECTANGLE]}, 404, "there is no appearance"),
        ({"sweep_ids": ["GOLDEN"], "ignore": "!"}, 422, "allowed is a PNG in base64"),
        ({"sweep_ids": ["GOLDEN"], "ignore": "aGVsbG8="}, 422, "it is no PNG"),
        ({"sweep_ids": ["GOLDEN"], "ignore": MASK, "add_to": "sha256:0"}, 422, "keeps its mask"),
        (["GOLDEN"], 422, "body"),
    ],
)
def test_what_is_not_there_is_not_learnt(client: TestClient, golden: str, asked: Any, status: int, said: str) -> None:
    text = json.dumps(asked).replace("GOLDEN", golden)
    answer = client.post("/v1/products/plate/appearances", content=text, headers={"content-type": "application/json"})
    refused(answer, status, said)


@pytest.mark.parametrize(
    ("body", "headers", "status", "said"),
    [
        (b"", MCAP, 422, "the file is empty"),
        (b"PNG" * 999, MCAP, 422, "no MCAP, it begins with 504e47504e47504e"),
        (b"\x89MCAP0\r\n", MCAP, 422, "no topics in it"),
        (b"\x89MCAP0\r\n" + bytes(999), MCAP, 422, "the recording: "),
        (b"", {"content-type": "multipart/form-data; boundary=x"}, 415, "allowed is an MCAP recording"),
        (b"", {"content-type": "image/jpeg"}, 415, "the body is image/jpeg"),
        (b"", MCAP | {"content-length": "20000001"}, 413, "allowed are 20000000 bytes"),
    ],
)
def test_what_is_no_recording_is_refused_and_leaves_nothing(
    client: TestClient, body: bytes, headers: dict[str, str], status: int, said: str
) -> None:
    refused(client.post("/v1/products/none/sweeps", content=body, headers=headers), status, said)
    assert incoming(client) == []
    refused(client.get("/v1/products/none"), 404, "there is no product 'none'")


def test_a_body_without_a_length_is_cut_off_at_the_limit(client: TestClient) -> None:
    def endless() -> Iterator[bytes]:
        yield b"\x89MCAP0\r\n"
        for _ in range(30):
            yield bytes(1 << 20)

    refused(client.post("/v1/products/none/sweeps", content=endless(), headers=MCAP), 413, "allowed are 20000000 bytes")
    assert incoming(client) == []


def test_what_an_upload_has_lost_is_told(client: TestClient, tmp_path: Path) -> None:
    short = uploaded(client, cut(sweep(BAD), tmp_path / "short.mcap", 0.5), "short")
    told = client.get(f"/v1/products/short/sweeps/{short}").json()
    assert 0 < told["frames"] < len(list(SweepReader(sweep(BAD))))
    assert told["losses"]


def test_a_picture_in_an_upload_has_no_more_pixels_than_allowed(client: TestClient, tmp_path: Path) -> None:
    good, path = next(iter(SweepReader(sweep(GOOD)))), tmp_path / "large.mcap"
    with SweepWriter(path) as writer:
        writer.write(replace(good, encoded=encode_png(good.pixels)))
        for number, (width, height) in enumerate([(8000, 8001), (60_000, 60_000)], start=1):
            large = EncodedPicture("png", bomb(width, height))
            writer.write(Frame(good.pixels, good.t_ns + number, good.sequence + number, None, large))
    large = uploaded(client, path, "large")
    told = client.get(f"/v1/products/large/sweeps/{large}").json()
    assert told["frames"] == 1
    assert "2 pictures could not be decoded" in told["losses"][0]
    assert "8000x8001 pixels announced, allowed are 64000000 in all" in told["losses"][0]


def test_a_recording_whose_part_has_no_proper_name_is_kept_without_it(client: TestClient, tmp_path: Path) -> None:
    path = tmp_path / "named.mcap"
    with SweepWriter(path, part_id="7\0") as writer:
        writer.write(next(iter(SweepReader(sweep(GOOD)))))
    named = uploaded(client, path, "named")
    told = client.get(f"/v1/products/named/sweeps/{named}").json()
    assert (told["part_id"], told["frames"]) == (None, 1)
    assert told["losses"] == [r"the recording calls its part '7\x00'; allowed are 1 to 128 printable characters"]


@pytest.mark.parametrize("product", ["", "a b", "-a", "a" * 65, "%2e%2e%2fx", "a%00"])
def test_a_product_has_a_name(client: TestClient, product: str) -> None:
    answer = client.post(f"/v1/products/{product}/sweeps", content=b"x", headers=MCAP)
    assert answer.status_code in (404, 422)
    assert answer.headers["content-type"] == PROBLEM


def test_a_named_camera_is_recorded(client: TestClient) -> None:
    asked = {"camera": "top", "frames": 25, "part_id": "0042"}
    answer = client.post("/v1/products/filmed/sweeps", json=asked)
    assert answer.status_code == 202
    job = ended(client, answer.json()["job_id"])
    assert (job["state"], job["error"]) == ("done", None)
    told = client.get(f"/v1/products/filmed/sweeps/{job['sweep_id']}").json()
    assert (told["frames"], told["part_id"], told["source"]) == (25, "0042", "camera")


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"camera": "opencv:0", "frames": 1}, "known are gone, top"),
        ({"camera": "top"}, "one of `seconds` and `frames`"),
        ({"camera": "top", "frames": 0}, "body.frames"),
        ({"camera": "top", "seconds": 1e9}, "body.seconds"),
    ],
)
def test_a_client_names_no_place(client: TestClient, asked: dict[str, Any], said: str) -> None:
    refused(client.post("/v1/products/filmed/sweeps", json=asked), 422, said)


def test_a_camera_that_does_not_answer_fails_its_job_without_its_password(client: TestClient) -> None:
    answer = client.post("/v1/products/filmed/sweeps", json={"camera": "gone", "seconds": 1})
    job = ended(client, answer.json()["job_id"])
    assert job["state"] == "failed"
    assert "secret" not in json.dumps(job)


def test_a_policy_is_a_new_version_and_the_trail_tells_who_and_what(client: TestClient, recipe: dict[str, Any]) -> None:
    path = "/v1/products/plate/recipes"
    edited = client.post(path, json={"policy": {"sensitivity": 1.5}, "note": "finer", "activate": False}).json()
    assert (edited["version"], edited["active"]) == (recipe["version"] + 1, False)
    assert edited["appearance_id"] == recipe["appearance_id"]
    assert edited["policy"] == PolicyFile(sensitivity=1.5).model_dump()
    assert client.get(f"{path}/{edited['recipe_id']}").json() == edited
    assert client.post(f"{path}/{edited['recipe_id']}/activate").json()["active"]
    assert client.get("/v1/products/plate").json()["active_recipe"]["recipe_id"] == edited["recipe_id"]
    newest = client.get("/v1/audit").json()["items"][0]
    assert (newest["actor"], newest["action"]) == ("local", "recipe.activate")
    assert (newest["before"]["recipe_id"], newest["after"]["recipe_id"]) == (recipe["recipe_id"], edited["recipe_id"])
    assert client.post(f"{path}/{recipe['recipe_id']}/activate").status_code == 200
    assert [each["version"] for each in client.get(path).json()["items"]][-2:] == [2, 1]


@pytest.mark.parametrize(
    ("asked", "status", "said"),
    [
        ({"policy": {"coverage": 2}}, 422, "body.policy.coverage"),
        ({"policy": {"sensitivity": 0.001}}, 422, "sensitivity is 0.001, allowed are 0.01 to 100.0"),
        ({"policy": {"nonsense": 2}}, 422, "body.policy.nonsense"),
        ({"policy": {"coverage": "much"}}, 422, "body.policy.coverage"),
        ({"appearance_id": "sha256:" + "0" * 64}, 404, "there is no appearance"),
    ],
)
def test_a_recipe_that_cannot_be_is_refused(
    client: TestClient, recipe: dict[str, Any], asked: Any, status: int, said: str
) -> None:
    refused(client.post("/v1/products/plate/recipes", json=asked), status, said)


def test_without_anything_learnt_there_is_no_recipe(client: TestClient) -> None:
    uploaded(client, sweep(GOOD), "fresh")
    refused(client.post("/v1/products/fresh/recipes", json={}), 409, "has no active recipe")
    refused(client.post("/v1/products/nobody/recipes", json={}), 404, "there is no product")


def test_a_replay_of_what_was_inspected_gives_the_same_digest(
    client: TestClient, inspected: dict[str, Any], appearance: str
) -> None:
    again = client.post("/v1/replays", json={"inspection_id": inspected["inspection_id"]})
    assert again.status_code == 201, again.text
    told = again.json()
    assert told["digest"] == inspected["digest"]
    assert (told["is_simulated"], inspected["is_simulated"], told["verdict"]) == (True, False, "NG")
    assert told["frames"] == inspected["frames"]
    here = replay(SweepReader(sweep(BAD)), load_appearance(material() / "plate.appearance"))
    assert told["digest"] == here.result.digest
    stored = client.get(f"/v1/inspections/{told['inspection_id']}").json()
    assert (stored["source"], stored["is_simulated"], stored["recording"]) == ("replay", True, "none")
    assert client.get(f"/v1/inspections/{told['inspection_id']}/result").json() == told
    refused(client.post("/v1/replays", json={"inspection_id": told["inspection_id"]}), 410, "no recording")


def test_a_sweep_is_replayed_by_another_policy_as_a_job(client: TestClient, recipe: dict[str, Any]) -> None:
    bad = uploaded(client, sweep(BAD))
    asked = {"sweep_id": bad, "policy": {"sensitivity": 0.01}}
    answer = client.post("/v1/replays", json=asked, headers={"Prefer": "respond-async"})
    assert answer.status_code == 202
    job = ended(client, answer.json()["job_id"])
    told = client.get(f"/v1/inspections/{job['inspection_id']}/result").json()
    assert (told["verdict"], told["replay_of"]) == ("OK", f"sweep {bad}")


@pytest.mark.parametrize("asked", [{}, {"inspection_id": "a", "sweep_id": "b"}, {"recipe_id": "a"}])
def test_a_replay_is_of_one_thing(client: TestClient, asked: dict[str, str]) -> None:
    refused(client.post("/v1/replays", json=asked), 422, "one of `inspection_id` and `sweep_id`")


def test_what_is_not_there_is_not_replayed(client: TestClient) -> None:
    refused(client.post("/v1/replays", json={"inspection_id": "0" * 32}), 404, "there is no inspection")
    refused(client.post("/v1/replays", json={"sweep_id": "0" * 32}), 404, "there is no sweep")


def test_a_policy_is_tried_on_what_was_inspected_and_nothing_changes(
    client: TestClient, inspected: dict[str, Any]
) -> None:
    before = client.get("/v1/inspections").json()
    path = "/v1/products/plate/rejudge"
    told = client.post(path, json={"policy": {"sensitivity": 0.01}}).json()
    (one,) = told["inspections"]
    assert (one["inspection_id"], one["before"], one["now"]) == (inspected["inspection_id"], "NG", "OK")
    assert told["gone"] == 0
    assert (told["changed"], told["counts"]) == (1, {"before": {"NG": 1}, "now": {"OK": 1}})
    same = client.post(path, json={"policy": {}, "inspection_ids": [inspected["inspection_id"]]}).json()
    assert (same["changed"], same["inspections"][0]["reasons"]) == (0, inspected["reasons"])
    assert client.get("/v1/inspections").json() == before
    refused(client.post(path, json={"policy": {}, "inspection_ids": ["0" * 32]}), 404, "there is no inspection")
    refused(client.post(path, json={"policy": {}, "last": 0}), 422, "body.last")


def test_a_request_that_comes_twice_is_done_once(client: TestClient, recipe: dict[str, Any]) -> None:
    key = {"Idempotency-Key": "retry-1"}
    one = client.post("/v1/products/plate/recipes", json={"activate": False}, headers=key)
    two = client.post("/v1/products/plate/recipes", json={"activate": False}, headers=key)
    assert (one.status_code, two.status_code, two.headers["idempotency-replayed"]) == (201, 201, "true")
    assert one.json() == two.json()
    other = client.post("/v1/products/plate/recipes", json={"activate": False, "note": "other"}, headers=key)
    refused(other, 422, "was used for another request")
    for wrong in ("", "a" * 256):
        answer = client.post("/v1/products/plate/recipes", json={}, headers={"Idempotency-Key": wrong})
        refused(answer, 422, "allowed are 1 to 255")


def test_an_upload_that_comes_twice_is_kept_once(client: TestClient) -> None:
    key = {"Idempotency-Key": "retry-upload"}
    one, two = (uploaded(client, sweep(GOOD), "twice", **key) for _ in range(2))
    assert one == two
    assert len(client.get("/v1/products/twice/sweeps").json()["items"]) == 1
    other = client.post("/v1/products/twice/sweeps", content=sweep(BAD).read_bytes(), headers=MCAP | key)
    refused(other, 422, "was used for another request")
    assert incoming(client) == []


def test_what_failed_may_be_tried_again_with_its_key(client: TestClient) -> None:
    key = {"Idempotency-Key": "retry-late"}
    asked = {"appearance_id": None}
    refused(client.post("/v1/products/late/recipes", json=asked, headers=key), 404, "there is no product")
    uploaded(client, sweep(GOOD), "late")
    refused(client.post("/v1/products/late/recipes", json=asked, headers=key), 409, "no active recipe")


def test_polling_costs_a_line_where_nothing_is_new(client: TestClient, golden: str) -> None:
    for path in ("/v1/products", "/v1/products/plate/sweeps", f"/v1/products/plate/sweeps/{golden}", "/v1/audit"):
        first = client.get(path)
        again = client.get(path, headers={"If-None-Match": f'"x", W/{first.headers["etag"]}'})
        assert (again.status_code, again.content) == (304, b""), path
    tag = client.get("/v1/products").headers["etag"]
    uploaded(client, sweep(GOOD), "another")
    assert client.get("/v1/products", headers={"If-None-Match": tag}).status_code == 200


def test_lists_are_read_page_by_page(client: TestClient, recipe: dict[str, Any]) -> None:
    whole = client.get("/v1/audit?limit=200").json()["items"]
    pages, after = list[Any](), ""
    while True:
        page = client.get(f"/v1/audit?limit=1{after}").json()
        pages += page["items"]
        if page["next"] is None:
            break
        after = f"&after={page['next']}"
    assert pages == whole
    for wrong in ("limit=0", "limit=201", "after=-1", "after=x", f"after={2**63}"):
        refused(client.get(f"/v1/audit?{wrong}"), 422, "query.")


def test_the_policy_of_the_wire_is_the_policy_of_files() -> None:
    assert Policy(**PolicyFile().model_dump()) == Policy()


def learnt_as(client: TestClient, **asked: Any) -> str:
    job = ended(client, client.post("/v1/products/plate/appearances", json=asked).json()["job_id"])
    assert (job["state"], job["error"]) == ("done", None)
    return job["appearance_id"]


def judged_by(client: TestClient, appearance: str, inspection: str) -> str:
    """The verdict on what was inspected, by another appearance."""
    made = client.post("/v1/products/plate/recipes", json={"appearance_id": appearance, "activate": False}).json()
    asked = {"inspection_id": inspection, "recipe_id": made["recipe_id"]}
    return client.post("/v1/replays", json=asked).json()["verdict"]


def ignored(client: TestClient, appearance: str, s: float) -> np.ndarray:
    """What is not looked at there: 255 fixed in the picture, 128 on the part."""
    answer = client.get(f"/v1/products/plate/appearances/{appearance}/ignored?s={s}")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/png")
    return decode(EncodedPicture("png", answer.content))


def test_a_mask_is_as_on_the_command_line_and_silences_what_passes_under_it(
    client: TestClient, golden: str, inspected: dict[str, Any], tmp_path: Path
) -> None:
    region = inspected["deviations"][0]["regions"][0]
    mask = np.zeros((180, 240), np.uint8)
    mask[region["y"] - 20 : region["y"] + region["height"] + 20] = 255
    png = encode_png(mask).data
    (tmp_path / "mask.png").write_bytes(png)
    made = learnt_as(client, sweep_ids=[golden], ignore=b64encode(png).decode())
    assert made == learn_recordings([material() / "golden.mcap"], tmp_path / "a", ignore=tmp_path / "mask.png").id
    assert client.get(f"/v1/products/plate/appearances/{made}").json()["facts"]["ignored"] == pytest.approx(
        np.mean(mask > 0), abs=1e-3
    )
    assert judged_by(client, made, inspected["inspection_id"]) == "OK"
    for s in (0, 0.4):
        assert np.array_equal(ignored(client, made, s), mask)
    request = client.get("/v1/jobs?limit=1").json()["items"][0]["request"]
    assert request == {"sweep_ids": [golden], "ignore": "sha256:" + hashlib.sha256(png).hexdigest()}


def test_a_mask_of_another_size_is_refused_in_words(client: TestClient, golden: str) -> None:
    answer = client.post("/v1/products/plate/appearances", json={"sweep_ids": [golden], "ignore": MASK})
    job = ended(client, answer.json()["job_id"])
    assert (job["state"], "9x9" in job["error"], str(golden) in job["error"]) == ("failed", True, True), job["error"]
    assert incoming(client) == []


def test_a_region_of_the_part_is_excused_wherever_it_is_seen(
    client: TestClient, appearance: str, inspected: dict[str, Any]
) -> None:
    at = inspected["deviations"][0]["peak_index"]
    frame = inspected["frames"][at]
    region = max(frame["regions"], key=lambda each: each["score"])
    low = {name: max(0, region[name] - 20) for name in ("x", "y")}
    size = {
        side: min(region[name] + region[side] + 20, most) - low[name]
        for name, side, most in (("x", "width", 240), ("y", "height", 180))
    }
    made = learnt_as(client, of=appearance, excuse=[{"s": frame["s"], **low, **size}])
    told = client.get(f"/v1/products/plate/appearances/{made}").json()
    assert (told["facts"]["excused_from"], told["facts"]["excused_regions"]) == (appearance, "1")
    assert told["sweep_ids"] == client.get(f"/v1/products/plate/appearances/{appearance}").json()["sweep_ids"]
    assert judged_by(client, appearance, inspected["inspection_id"]) == "NG"
    assert judged_by(client, made, inspected["inspection_id"]) == "OK"
    (kept,) = json.loads(told["facts"]["excused"])
    assert kept == {"s": frame["s"], **low, **size}
    shown = ignored(client, made, frame["s"])
    x, y = low["x"] + size["width"] // 2, low["y"] + size["height"] // 2
    assert (shown.shape, shown[y, x], set(np.unique(shown).tolist())) == ((180, 240), 128, {0, 128})
    assert 1 <= np.count_nonzero(shown) / (size["width"] * size["height"]) < 4
    # It moves with the part.
    later = ignored(client, made, frame["s"] + 0.1)
    assert later[y, x] in (0, 128)
    assert not np.array_equal(shown, later)
    assert not ignored(client, appearance, frame["s"]).any()
    answer = client.post("/v1/products/plate/appearances", json={"of": made, "excuse": [RECTANGLE | {"x": 230}]})
    assert ended(client, answer.json()["job_id"])["error"] == "region 1 ends at (250, 30); the picture is 240x180"
