"""Inspections by REST: from begin to acknowledge, and everything that can be asked wrongly."""

from __future__ import annotations

import json
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from api.app import THREADS, create_app
from inspector.recording import SweepReader
from inspector.service.service import Service
from inspector.settings import read_settings
from models.verdict import Policy
from tests.api.stations import (
    GOOD,
    PRODUCT,
    begin,
    bomb,
    feed,
    frames,
    learnt,
    picture,
    post,
    remove_scores,
    standing,
    taught,
    teach,
)
from tests.contracts.stores import behind
from tests.patience import until

HERE = "http://127.0.0.1"


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[TestClient, Service]]:
    settings = read_settings(
        data=tmp_path_factory.mktemp("station") / "data", scorers=1, max_pixels=1_000_000, max_body=200_000
    )
    app = create_app(settings)
    with TestClient(app, base_url=HERE) as client:
        teach(app.state.service)
        yield client, app.state.service


@pytest.fixture
def client(station: tuple[TestClient, Service]) -> TestClient:
    return station[0]


@pytest.fixture
def service(station: tuple[TestClient, Service]) -> Service:
    return station[1]


def wrong(answer: Any, status: int, said: str) -> dict[str, Any]:
    """It is a problem document that says what was wrong."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert problem["status"] == status
    assert said in problem["detail"]
    return problem


def test_an_id_may_be_chosen_and_asked_for_again(client: TestClient):
    chosen, asked = {"X-Session-Id": "5e" * 16}, {"product_id": PRODUCT, "part_id": "chosen"}
    first = client.post("/v1/inspections", json=asked, headers=chosen)
    assert (first.status_code, first.json()["inspection_id"]) == (201, "5e" * 16)
    assert post(client, "5e" * 16, frames()[0]).status_code == 200
    again = client.post("/v1/inspections", json=asked, headers=chosen)
    assert again.json() == first.json()
    assert client.get(f"/v1/inspections/{'5e' * 16}").json()["frames_scored"] == 1
    wrong(client.post("/v1/inspections", json=asked | {"part_id": "x"}, headers=chosen), 409, "is there already")
    client.post(f"/v1/inspections/{'5e' * 16}/abort")
    wrong(client.post("/v1/inspections", json=asked, headers=chosen), 409, "is aborted already")
    for bad in ("5e", "../" * 11, "5E" * 16):
        wrong(client.post("/v1/inspections", json=asked, headers={"X-Session-Id": bad}), 422, "x-session-id")


def test_from_begin_to_acknowledge(client: TestClient):
    inspection = begin(client)
    first = post(client, inspection, frames()[0]).json()
    assert first["kind"] == "scored"
    assert first["index"] == 0
    going = client.get(f"/v1/inspections/{inspection}").json()
    assert (going["state"], going["verdict"], going["frames_scored"]) == ("processing", None, 1)
    wrong(client.get(f"/v1/inspections/{inspection}/result"), 409, "is processing")
    wrong(client.get(f"/v1/inspections/{inspection}/recording"), 409, "is processing")
    wrong(client.post(f"/v1/inspections/{inspection}/acknowledge"), 409, "is processing")
    feed(client, inspection, frames()[1:])
    result = client.post(f"/v1/inspections/{inspection}/conclude").json()
    assert result["verdict"] == "NG"
    assert result["inspection_id"] == inspection
    assert (result["result_state"], result["is_partial"], result["is_simulated"]) == ("completed", False, False)
    assert len(result["frames"]) == len(frames())
    assert client.get(f"/v1/inspections/{inspection}/result").json() == result
    bare = client.get(f"/v1/inspections/{inspection}/result?frames=false").json()
    assert bare == {name: value for name, value in result.items() if name != "frames"}
    noted = client.post(f"/v1/inspections/{inspection}/acknowledge").json()["acknowledged_ns"]
    assert client.post(f"/v1/inspections/{inspection}/acknowledge").json()["acknowledged_ns"] == noted
    assert client.get(f"/v1/inspections/{inspection}").json()["state"] == "completed"


def test_what_was_recorded_is_what_was_scored(client: TestClient, tmp_path: Path):
    inspection = begin(client)
    feed(client, inspection, frames(GOOD))
    client.post(f"/v1/inspections/{inspection}/conclude")
    path = tmp_path / "it.mcap"
    path.write_bytes(client.get(f"/v1/inspections/{inspection}/recording").content)
    recording = SweepReader(path)
    assert [(f.t_ns, f.sequence, f.encoded.data if f.encoded else b"") for f in recording] == [
        (f.t_ns, f.sequence, picture(f)) for f in frames(GOOD)
    ]
    assert recording.facts["inspection_id"] == inspection
    assert recording.losses == ()


def test_scores_can_be_read_while_it_runs_and_ever_after(client: TestClient):
    inspection = begin(client)
    feed(client, inspection, frames()[:6])
    path = f"/v1/inspections/{inspection}/scores"
    live = client.get(path).json()
    assert [each["index"] for each in live["items"]] == [0, 1, 2, 3, 4, 5]
    assert [each["index"] for each in client.get(f"{path}?after=3").json()["items"]] == [4, 5]
    assert client.get(f"{path}?after={live['next']}").json()["items"] == []
    client.post(f"/v1/inspections/{inspection}/conclude")
    after = client.get(f"{path}?after=1&limit=2").json()
    assert (after["state"], after["next"], [each["index"] for each in after["items"]]) == ("completed", 3, [2, 3])
    assert after["items"][0] == {k: v for k, v in live["items"][2].items() if k not in ("n", "kind", "sequence")}


def test_scores_that_are_not_kept_any_more_are_never_taken_for_none(client: TestClient, service: Service):
    inspection = begin(client)
    feed(client, inspection)
    result = client.post(f"/v1/inspections/{inspection}/conclude").json()
    path, rejudge = f"/v1/inspections/{inspection}", f"/v1/products/{PRODUCT}/rejudge"
    before = client.get(path).json()
    assert before["scores"] == "kept"
    remove_scores(service.settings.data, inspection)
    assert client.get(path).json() == before | {"scores": "removed"}
    said = wrong(client.get(f"{path}/scores"), 410, f"the frames of inspection '{inspection}' any more")
    assert "`keep_scores_days`" in said["detail"]
    now = client.get(f"{path}/result").json()
    assert now == result | {"frames": None, "frames_note": said["detail"]}
    assert "frames" not in client.get(f"{path}/result?frames=false").json()
    peak = result["deviations"][0]["peak_index"]
    assert client.get(f"{path}/frames/{peak}/pictures/frame").content == picture(frames()[peak])
    for asked in (f"{path}/frames/{peak}", f"{path}/frames/{peak}/pictures/seen"):
        wrong(client.get(asked), 410, "`keep_scores_days`")
    wrong(client.post(rejudge, json={"policy": {}, "inspection_ids": [inspection]}), 410, "`keep_scores_days`")
    latest = client.post(rejudge, json={"policy": {}, "last": 1}).json()
    assert (latest["gone"], latest["inspections"], latest["changed"]) == (1, [], 0)
    again = client.post("/v1/replays", json={"inspection_id": inspection}).json()
    assert (again["digest"], again["frames"]) == (result["digest"], result["frames"])


def test_a_frame_that_is_sent_again_is_not_scored_twice(client: TestClient):
    inspection = begin(client)
    first = post(client, inspection, frames()[0])
    assert post(client, inspection, frames()[0]).json() == first.json()
    jpeg = {"content-type": "image/jpeg", "idempotency-key": "frame-1"}
    path = f"/v1/inspections/{inspection}/frames"
    once = client.post(path, content=picture(frames()[1]), headers=jpeg).json()
    assert client.post(path, content=picture(frames()[1]), headers=jpeg).json() == once
    none = client.post(path, content=picture(frames()[2]), headers=jpeg | {"idempotency-key": ""})
    wrong(none, 422, "Idempotency-Key has 0 characters; allowed are 1 to 255")
    assert client.get(f"/v1/inspections/{inspection}").json()["frames_scored"] == 2
    assert post(client, inspection, frames()[5], sequence=5).status_code == 200
    wrong(post(client, inspection, frames()[3], sequence=3), 409, "the next number is 6")


def test_a_frame_that_finds_no_room_has_no_number_and_is_scored_when_it_is_sent_again(tmp_path: Path):
    settings = read_settings(data=taught(tmp_path / "data"), scorers=1, window=1)
    app = create_app(settings)
    with TestClient(app, base_url=HERE) as client, ThreadPoolExecutor(1) as another:
        inspection = begin(client)

        def by_key(number: int) -> Any:
            jpeg = {"content-type": "image/jpeg", "idempotency-key": f"frame-{number}"}
            return client.post(f"/v1/inspections/{inspection}/frames", content=picture(frames()[number]), headers=jpeg)

        with standing(app.state.service):
            waits = another.submit(by_key, 0)
            while client.get(f"/v1/inspections/{inspection}").json()["next_sequence"] == 0:
                assert not waits.done()
            wrong(by_key(1), 503, "1 frames wait already")
        first, third, second = waits.result(), by_key(2), by_key(1)
        scored = [(each.json()["index"], each.json()["sequence"]) for each in (first, third, second)]
    assert scored == [(0, 0), (1, 1), (2, 2)]


def test_begin_and_conclude_may_be_retried_by_their_key(client: TestClient):
    asked = {"json": {"product_id": PRODUCT, "part_id": "0008"}, "headers": {"idempotency-key": "part-0008"}}
    begun = client.post("/v1/inspections", **asked)
    again = client.post("/v1/inspections", **asked)
    assert again.json() == begun.json()
    inspection = begun.json()["inspection_id"]
    feed(client, inspection, frames()[:6])
    key = {"idempotency-key": "end-0008"}
    once = client.post(f"/v1/inspections/{inspection}/conclude", headers=key)
    assert client.post(f"/v1/inspections/{inspection}/conclude", headers=key).json() == once.json()
    wrong(client.post(f"/v1/inspections/{inspection}/conclude"), 409, "is completed already")


def test_after_conclude_nothing_more_is_taken_and_nothing_is_lost(client: TestClient):
    inspection = begin(client)
    feed(client, inspection, frames()[:6])
    result = client.post(f"/v1/inspections/{inspection}/conclude").json()
    wrong(post(client, inspection, frames()[7]), 409, "is completed already")
    wrong(client.post(f"/v1/inspections/{inspection}/conclude"), 409, "is completed already")
    wrong(client.post(f"/v1/inspections/{inspection}/abort"), 409, "is completed already")
    assert client.get(f"/v1/inspections/{inspection}/result").json() == result


@pytest.mark.parametrize(
    ("content", "kind", "status", "said"),
    [
        (lambda: picture(frames()[0])[:-400], "image/jpeg", 422, "jpeg"),
        (lambda: b"", "image/jpeg", 422, "0 bytes"),
        (lambda: b"GIF89a....", "image/png", 422, "unknown kind"),
        (lambda: bomb(60_000, 60_000), "image/png", 422, "60000x60000"),
        (lambda: bomb(16, 16), "image/png", 422, "16x16"),
        (lambda: picture(frames()[0]), "text/plain", 415, "text/plain"),
        (lambda: picture(frames()[0]), "", 415, "allowed is image/jpeg"),
        (lambda: bytes(300_000), "image/jpeg", 413, "200000"),
    ],
)
def test_what_is_no_picture_of_the_part_is_refused_in_words(
    client: TestClient, content: Any, kind: str, status: int, said: str
):
    inspection = begin(client)
    post(client, inspection, frames()[0])
    headers = {"content-type": kind} if kind else {}
    wrong(client.post(f"/v1/inspections/{inspection}/frames", content=content(), headers=headers), status, said)
    assert post(client, inspection, frames()[6], sequence=None).status_code == 200
    result = client.post(f"/v1/inspections/{inspection}/conclude").json()
    assert len(result["frames"]) == 2
    assert result["frames_dropped"] == (1 if status == 422 else 0)


def test_a_body_of_four_gigabytes_is_refused_by_what_it_announces(client: TestClient):
    headers = {"content-type": "image/jpeg", "content-length": str(4 << 30)}
    wrong(client.post(f"/v1/inspections/{begin(client)}/frames", content=b"", headers=headers), 413, "200000")


@pytest.mark.parametrize("path", ["frames", "conclude", "abort", "acknowledge", "disposition"])
def test_what_is_not_there_is_told(client: TestClient, path: str):
    headers = {"content-type": "image/jpeg" if path == "frames" else "application/json"}
    body = b'{"decision": "confirm"}' if path == "disposition" else b""
    wrong(client.post(f"/v1/inspections/{'0' * 32}/{path}", content=body, headers=headers), 404, "no inspection")


@pytest.mark.parametrize("path", ["", "/result", "/scores", "/recording", "/picture"])
def test_what_is_not_there_cannot_be_read(client: TestClient, path: str):
    wrong(client.get(f"/v1/inspections/{'0' * 32}{path}"), 404, "no inspection")


@pytest.mark.parametrize(
    ("asked", "status", "said"),
    [
        ({"product_id": "unknown", "part_id": "1"}, 404, "no product 'unknown'"),
        ({"product_id": PRODUCT, "part_id": "1", "recipe_id": "none"}, 404, "no recipe"),
        ({"product_id": PRODUCT}, 422, "part_id"),
        ({"product_id": "../etc", "part_id": "1"}, 422, "product_id"),
        ({"product_id": PRODUCT, "part_id": "a\nb"}, 422, "part_id"),
        ({"product_id": PRODUCT, "part_id": "1", "speed": 3}, 422, "speed"),
    ],
)
def test_an_inspection_of_nothing_known_is_not_begun(client: TestClient, asked: Any, status: int, said: str):
    wrong(client.post("/v1/inspections", json=asked), status, said)


def test_a_product_without_a_recipe_says_what_is_missing(client: TestClient, service: Service):
    service.store.ensure_product("bare", service.now_ns())
    wrong(client.post("/v1/inspections", json={"product_id": "bare", "part_id": "1"}), 409, "no active recipe")


def test_a_part_is_not_inspected_by_the_recipe_of_another_product(client: TestClient, service: Service):
    # Both have learnt the same, so that nothing but the recipe's own product stands in the way.
    recipe = service.store.active_recipe(PRODUCT)
    assert recipe is not None
    service.store.ensure_product("other", service.now_ns())
    service.store.add_appearance(replace(service.store.appearance(PRODUCT, learnt().id), product_id="other"))
    for product_id, said in (("other", f"no recipe '{recipe.recipe_id}'"), ("unknown", "no product 'unknown'")):
        asked = {"product_id": product_id, "part_id": "1", "recipe_id": recipe.recipe_id}
        wrong(client.post("/v1/inspections", json=asked), 404, said)


def test_an_aborted_inspection_is_never_ok(client: TestClient):
    inspection = begin(client)
    feed(client, inspection, frames(GOOD))
    result = client.post(f"/v1/inspections/{inspection}/abort", json={"reason": "the part fell off"}).json()
    assert (result["result_state"], result["is_partial"], result["verdict"]) == ("aborted", True, "INCOMPLETE")
    assert result["reasons"][0] == "aborted: the part fell off"
    told = client.get(f"/v1/inspections/{inspection}").json()
    assert (told["state"], told["reason"]) == ("aborted", "the part fell off")


def test_a_sweep_that_the_line_stopped_because_of_ng_stays_ng(client: TestClient):
    inspection = begin(client)
    feed(client, inspection, frames()[:30])
    assert client.post(f"/v1/inspections/{inspection}/conclude", json={"stopped": True}).json()["verdict"] == "NG"


def test_the_latest_picture_is_the_one_that_was_scored_last(client: TestClient):
    inspection = begin(client)
    path = f"/v1/inspections/{inspection}/picture"
    assert (client.get(path).status_code, client.get(path).content) == (204, b"")
    for frame in frames()[:2]:
        scored = post(client, inspection, frame).json()
        shown = client.get(path)
        assert (shown.content, shown.headers["content-type"]) == (picture(frame), "image/jpeg")
        assert (shown.headers["frame-index"], shown.headers["frame-sequence"]) == (
            str(scored["index"]),
            str(frame.sequence),
        )
        told = json.loads(shown.headers["frame-scored"])
        assert told == {name: value for name, value in scored.items() if name not in ("n", "kind", "sequence")}
    again = client.get(path, headers={"if-none-match": shown.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    client.post(f"/v1/inspections/{inspection}/frames", content=b"none", headers={"content-type": "image/jpeg"})
    assert client.get(path).content == picture(frames()[1])
    client.post(f"/v1/inspections/{inspection}/conclude")
    assert client.get(path).status_code == 204


def test_boxes_of_the_latest_picture_are_its_own(client: TestClient):
    inspection = begin(client)
    for frame in frames():
        scored = post(client, inspection, frame).json()
        told = json.loads(client.get(f"/v1/inspections/{inspection}/picture").headers["frame-scored"])
        assert (told["index"], len(told["regions"])) == (scored["index"], min(12, len(scored["regions"])))
    assert client.post(f"/v1/inspections/{inspection}/conclude").json()["verdict"] == "NG"


def test_lists_are_newest_first_and_cheap_to_poll(client: TestClient):
    made = [begin(client, f"list-{number}") for number in range(3)]
    for inspection in made:
        client.post(f"/v1/inspections/{inspection}/conclude")
    page = client.get("/v1/inspections?limit=2")
    assert [each["inspection_id"] for each in page.json()["items"]] == made[:0:-1]
    rest = client.get(f"/v1/inspections?limit=2&after={page.json()['next']}").json()
    assert rest["items"][0]["inspection_id"] == made[0]
    again = client.get("/v1/inspections?limit=2", headers={"if-none-match": page.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    invalid = client.get("/v1/inspections?verdict=INVALID&limit=200").json()["items"]
    assert {each["verdict"] for each in invalid} == {"INVALID"}
    assert set(made) <= {each["inspection_id"] for each in invalid}


def test_a_person_may_confirm_or_overrule_and_the_verdict_stays(client: TestClient, service: Service):
    inspection = begin(client)
    path = f"/v1/inspections/{inspection}/disposition"
    wrong(client.post(path, json={"decision": "confirm"}), 409, "is processing")
    feed(client, inspection)
    result = client.post(f"/v1/inspections/{inspection}/conclude").json()
    assert client.get(f"/v1/inspections/{inspection}").json()["disposition"] is None
    wrong(client.post(path, json={"decision": "overrule", "verdict": "NG"}), 409, "is NG already; confirm it")
    wrong(client.post(path, json={"decision": "overrule"}), 422, "`verdict` is needed to overrule")
    wrong(client.post(path, json={"decision": "confirm", "verdict": "OK"}), 422, "not allowed to confirm")
    wrong(client.post(path, json={"decision": "overrule", "verdict": "REVIEW"}), 422, "verdict")
    asked = {"decision": "overrule", "verdict": "OK", "comment": "a fibre, wiped off"}
    key = {"idempotency-key": "wiped"}
    told = client.post(path, json=asked, headers=key).json()
    assert client.post(path, json=asked, headers=key).json() == told
    assert (told["verdict"], told["disposition"] | {"t_ns": 0}) == ("NG", {**asked, "actor": "local", "t_ns": 0})
    assert client.get("/v1/inspections?limit=1").json()["items"][0]["disposition"] == told["disposition"]
    assert client.get(f"/v1/inspections/{inspection}/result").json() == result
    assert client.post(path, json={"decision": "confirm"}).json()["disposition"]["verdict"] == "NG"
    said = client.get(f"/v1/inspections/{inspection}/dispositions").json()["items"]
    assert [each["decision"] for each in said] == ["confirm", "overrule"]
    trail = client.get("/v1/audit?limit=2").json()["items"]
    assert [(each["action"], each["thing"]) for each in trail] == [("inspection.dispose", inspection)] * 2
    assert trail[0]["before"] == told["disposition"]
    told_of = [json.loads(each.data) for each in service.events._events if each.kind == "disposition"]
    assert [each["inspection_id"] for each in told_of].count(inspection) == 2


def test_a_part_has_a_profile_that_lists_show_where_it_is_asked_for(client: TestClient):
    inspection = begin(client)
    feed(client, inspection)
    result = client.post(f"/v1/inspections/{inspection}/conclude").json()
    highest = [None] * 50
    for frame in result["frames"]:
        if frame["state"] == "scored":
            at = min(int(frame["s"] * 50), 49)
            highest[at] = max(highest[at] or 0.0, frame["score"])
    assert result["profile"] == highest
    assert client.get(f"/v1/inspections/{inspection}").json()["profile"] == highest
    asked = [client.get(f"/v1/inspections?limit=1{more}").json()["items"][0] for more in ("", "&profile=true")]
    assert [each["profile"] for each in asked] == [None, highest]


def test_the_policy_is_the_recipes(client: TestClient, service: Service):
    teach(service, Policy(sensitivity=0.01))
    try:
        inspection = begin(client)
        feed(client, inspection)
        result = client.post(f"/v1/inspections/{inspection}/conclude").json()
    finally:
        teach(service)
    assert result["verdict"] == "OK"
    assert result["appearance_id"] == learnt().id


def over(client: TestClient, inspection: str) -> dict[str, Any]:
    """As it is when nothing is done for it any more."""
    told: dict[str, Any] = {}

    def has_ended() -> bool:
        told.update(client.get(f"/v1/inspections/{inspection}").json())
        return told["state"] != "processing"

    until(has_ended, lambda: told)
    return told


def test_when_the_scorer_dies_the_inspection_says_so_and_the_next_one_runs(client: TestClient, service: Service):
    inspection = begin(client)
    feed(client, inspection, frames()[:3])
    scorer = service.inspections.pool.scorers[0]
    assert scorer.pid is not None
    os.kill(scorer.pid, signal.SIGKILL)
    told = over(client, inspection)
    assert told["state"] == "failed"
    assert "ended unexpectedly" in told["reason"]
    gone = client.get(f"/v1/inspections/{inspection}/result").json()
    assert (gone["verdict"], gone["result_state"], gone["is_partial"]) == (None, "failed", True)
    until(lambda: client.get("/readyz").status_code == 200)
    feed(client, begin(client), frames()[:2])


def test_what_could_not_be_stored_is_tried_again_and_told_as_it_was(client: TestClient, service: Service):
    inspection = begin(client)
    feed(client, inspection)
    full = "BEFORE UPDATE OF state ON inspections BEGIN SELECT RAISE(ABORT, 'the disk is full'); END"
    behind(service.store, f"CREATE TRIGGER full {full}")
    try:
        assert "the disk is full" in client.post(f"/v1/inspections/{inspection}/conclude").json()["detail"]
    finally:
        behind(service.store, "DROP TRIGGER full")
    told = over(client, inspection)
    assert (told["state"], told["verdict"], told["reason"]) == ("completed", "NG", None)


def test_frames_do_not_wait_for_who_reads(client: TestClient, service: Service, monkeypatch: pytest.MonkeyPatch):
    inspection = begin(client)
    slow, came, go = service.store.dispositions, threading.Semaphore(0), threading.Event()

    def waits(*asked: Any) -> Any:
        came.release()
        go.wait(60)
        return slow(*asked)

    monkeypatch.setattr(service.store, "dispositions", waits)
    with ThreadPoolExecutor(THREADS + 1) as others:
        reading = [others.submit(client.get, f"/v1/inspections/{inspection}/dispositions") for _ in range(THREADS)]
        try:
            for _ in reading:
                assert came.acquire(timeout=60)
            assert others.submit(post, client, inspection, frames()[0]).result(60).status_code == 200
        finally:
            go.set()
        assert [each.result().status_code for each in reading] == [200] * THREADS


def test_one_too_many_is_refused(tmp_path: Path):
    settings = read_settings(data=taught(tmp_path / "data"), scorers=1, max_inspections=2)
    with TestClient(create_app(settings), base_url=HERE) as client:
        begin(client)
        begin(client)
        refused = client.post("/v1/inspections", json={"product_id": PRODUCT, "part_id": "3"})
        wrong(refused, 503, "2 are running, 2 are allowed")
        assert int(refused.headers["retry-after"]) > 0


def test_what_is_idle_is_aborted(tmp_path: Path):
    settings = read_settings(data=taught(tmp_path / "data"), scorers=1, idle_seconds=0.5)
    with TestClient(create_app(settings), base_url=HERE) as client:
        told = over(client, begin(client))
        assert (told["state"], told["reason"]) == ("aborted", "no frame came for 0.5 s")


def test_where_what_runs_needs_all_of_the_scorers_one_more_is_refused_until_it_has_ended(client: TestClient):
    greedy = begin(client)
    # By its own times this camera makes ten thousand pictures a second.
    for number, frame in enumerate(frames()[:30]):
        assert post(client, greedy, frame, t_ns=1_000_000_000 + 100_000 * number).status_code == 200
    refused = client.post("/v1/inspections", json={"product_id": PRODUCT, "part_id": "one more"})
    wrong(refused, 503, "of the scorers' time")
    assert int(refused.headers["retry-after"]) > 0
    assert post(client, greedy, frames()[30], t_ns=2_000_000_000).status_code == 200
    assert client.post(f"/v1/inspections/{greedy}/conclude").status_code == 200
    client.post(f"/v1/inspections/{begin(client)}/abort")


def test_what_was_processing_when_the_service_ended_is_aborted_and_can_be_read(tmp_path: Path):
    app = create_app(read_settings(data=tmp_path / "data", scorers=1))
    with TestClient(app, base_url=HERE) as client:
        teach(app.state.service)
        inspection = begin(client)
        feed(client, inspection, frames()[:12])
    again = create_app(read_settings(data=tmp_path / "data", scorers=1))
    with TestClient(again, base_url=HERE) as client:
        told = client.get(f"/v1/inspections/{inspection}").json()
        assert (told["state"], told["reason"]) == ("aborted", "the service was stopped")
        assert len(client.get(f"/v1/inspections/{inspection}/result").json()["frames"]) == 12
        path = tmp_path / "it.mcap"
        path.write_bytes(client.get(f"/v1/inspections/{inspection}/recording").content)
        assert len(list(SweepReader(path))) == 12


def test_metrics_tell_frames_verdicts_and_where_the_time_goes(client: TestClient):
    feed(client, begin(client), frames()[:2])
    told = client.get("/metrics").text
    for name in ("inspector_frames_total", "inspector_verdicts_total", "inspector_frame_seconds_bucket"):
        assert name in told
    for stage in ("wait", "decode", "score", "record", "total"):
        assert f'inspector_frame_seconds_count{{stage="{stage}"}}' in told
    assert "inspector_event_loop_held_seconds_count" in told
    assert 'inspector_frames_waiting{scorer="0"} 0.0' in told
    running = len(client.get("/v1/inspections?state=processing&limit=200").json()["items"])
    assert f"inspector_inspections_running {running}.0" in told
    assert json.dumps(PRODUCT) in told
