"""Two services that share PostgreSQL and a bucket: what one has, the other has, and nobody does anything for it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from inspector.objects import Objects
from inspector.service.desk import Desk
from inspector.service.recognising import Recognising
from inspector.service.replaying import others_of
from inspector.settings import Settings
from tests.api.stations import GOOD, PRODUCT, begin, feed, frames, material, picture, sweep
from tests.api.test_round import HERE, MCAP, ended, uploaded
from tests.buckets import Buckets
from tests.patience import until
from tests.postgresql import Server


@pytest.fixture(scope="module")
def bucket(buckets: Buckets) -> str:
    return buckets.new()


@pytest.fixture(scope="module")
def two(
    tmp_path_factory: pytest.TempPathFactory, postgresql: Server, bucket: str
) -> Iterator[tuple[TestClient, TestClient]]:
    url = postgresql.new_database()
    one, other = (
        create_app(
            Settings.model_validate(
                {"data": tmp_path_factory.mktemp(name), "database": url, "files": bucket, "scorers": 1}
            )
        )
        for name in "ab"
    )
    with TestClient(one, base_url=HERE) as first, TestClient(other, base_url=HERE) as second:
        yield first, second


@pytest.fixture(scope="module")
def recipe(two: tuple[TestClient, TestClient]) -> str:
    """Learnt at the first service, from a sweep that the second one received."""
    one, other = two
    sweep_id = uploaded(other, material() / "golden.mcap")
    job = one.post(f"/v1/products/{PRODUCT}/appearances", json={"sweep_ids": [sweep_id]}).json()
    done = ended(one, job["job_id"])
    assert done["state"] == "done", done
    made = one.post(f"/v1/products/{PRODUCT}/recipes", json={"appearance_id": done["appearance_id"], "activate": True})
    assert made.status_code == 201, made.text
    return made.json()["recipe_id"]


def inspected(client: TestClient, options: str) -> dict[str, Any]:
    """The result, when its recording is where it stays."""
    inspection = begin(client)
    feed(client, inspection, frames(options))
    result = client.post(f"/v1/inspections/{inspection}/conclude").json()
    until(lambda: client.get(f"/v1/inspections/{inspection}").json()["recording"] != "being written")
    return result


def test_what_one_learnt_the_other_inspects_by(two: tuple[TestClient, TestClient], recipe: str) -> None:
    one, other = (inspected(client, GOOD) for client in two)
    assert one["verdict"] == other["verdict"] == "OK"
    assert one["digest"] == other["digest"]
    assert one["recipe_id"] == other["recipe_id"] == recipe


def test_a_recording_of_one_is_shown_replayed_and_sent_by_the_other(
    two: tuple[TestClient, TestClient], recipe: str, bucket: str
) -> None:
    one, other = two
    result = inspected(one, GOOD)
    at = f"/v1/inspections/{result['inspection_id']}"
    name = f"inspections/{result['inspection_id']}.mcap"
    assert (
        Objects(bucket).size(name)
        == one.app.state.service.store.inspection(  # pyright: ignore[reportAttributeAccessIssue]
            result["inspection_id"]
        ).recording_bytes
    )
    sent = [client.get(f"{at}/recording") for client in two]
    assert sent[0].content == sent[1].content == Objects(bucket).open(name).read()
    assert sent[1].headers["content-length"] == str(len(sent[1].content))
    assert sent[1].headers["content-disposition"] == f'attachment; filename="{result["inspection_id"]}.mcap"'
    for start, end in ((0, 9), (100, 5000), (100, len(sent[0].content) + 7), (3, None)):
        some = other.get(f"{at}/recording", headers={"range": f"bytes={start}-{'' if end is None else end - 1}"})
        assert some.content == sent[0].content[start:end]
        assert some.status_code == 206
        assert some.headers["content-range"].startswith(f"bytes {start}-{start + len(some.content) - 1}/")
    assert other.get(f"{at}/recording", headers={"range": "bytes=99999999-"}).status_code == 416
    shown = [client.get(f"{at}/frames/7/pictures/frame") for client in two]
    assert shown[0].content == shown[1].content
    again = other.post("/v1/replays", json={"inspection_id": result["inspection_id"]}).json()
    assert one.get(f"/v1/inspections/{again['inspection_id']}").json()["digest"] == result["digest"]


def test_workers_far_away_are_told_where_all_have_what_other_parts_look_like(
    two: tuple[TestClient, TestClient], recipe: str
) -> None:
    service = two[1].app.state.service  # pyright: ignore[reportAttributeAccessIssue]
    known = Recognising(service.store, service.files, Desk(1))
    far = known.others("another", "sha256:", far=True)[PRODUCT]
    assert far.startswith("s3://")
    near = known.others("another", "sha256:")[PRODUCT]
    assert near.startswith(str(service.folder.path))
    assert [each.name for each in others_of({PRODUCT: far, "gone": f"{far}x", "local": near})] == ["local", PRODUCT]


def test_frames_are_shown_while_the_recording_cannot_be_brought_away(
    two: tuple[TestClient, TestClient], recipe: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = two
    service = one.app.state.service  # pyright: ignore[reportAttributeAccessIssue]
    with monkeypatch.context() as away:
        away.setattr(service.files, "_kept", type(service.files._kept)(Objects("s3://b-0?endpoint=http://127.0.0.1:1")))
        inspection = begin(one)
        feed(one, inspection, frames(GOOD))
        assert one.post(f"/v1/inspections/{inspection}/conclude").json()["verdict"] == "OK"
        at = f"/v1/inspections/{inspection}"
        shown = one.get(f"{at}/frames/7/pictures/frame").content
        assert shown == picture(frames(GOOD)[7])
        for client in two:
            assert client.get(f"{at}/recording").status_code == 409
            assert client.get(at).json()["recording"] == "being written"
        assert other.get(f"{at}/frames/7/pictures/frame").status_code == 409
        assert b"inspector_recordings_unpublished 1.0" in one.get("/metrics").content
    until(lambda: other.get(at).json()["recording"] != "being written")
    assert {client.get(f"{at}/frames/7/pictures/frame").content for client in two} == {shown}
    assert b"inspector_recordings_unpublished 0.0" in one.get("/metrics").content


def test_a_sweep_is_kept_in_the_bucket_and_sent_from_there(two: tuple[TestClient, TestClient], bucket: str) -> None:
    one, other = two
    path = sweep(GOOD)
    sweep_id = uploaded(one, path)
    assert other.get(f"/v1/products/{PRODUCT}/sweeps/{sweep_id}/recording").content == path.read_bytes()
    Objects(bucket).remove(f"sweeps/{sweep_id}.mcap")
    answer = other.get(f"/v1/products/{PRODUCT}/sweeps/{sweep_id}/recording")
    assert answer.status_code == 404
    assert [*one.app.state.service.folder.path.glob("sweeps/*")] == []  # pyright: ignore[reportAttributeAccessIssue]


def test_what_goes_wrong_with_the_bucket_is_told_without_its_place(
    two: tuple[TestClient, TestClient], monkeypatch: pytest.MonkeyPatch
) -> None:
    one, _ = two
    files = one.app.state.service.files  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setattr(files, "_kept", type(files._kept)(Objects("s3://bucket-0?endpoint=http://127.0.0.1:1")))
    answer = one.post(f"/v1/products/{PRODUCT}/sweeps", content=sweep(GOOD).read_bytes(), headers=MCAP)
    assert answer.status_code == 503
    assert answer.json()["type"] == "urn:inspector:object-error"
    assert "it does not answer" in answer.json()["detail"]
    assert [*one.app.state.service.folder.path.glob("incoming/*")] == []  # pyright: ignore[reportAttributeAccessIssue]
