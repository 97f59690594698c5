"""Batches over HTTP: many stored recordings once more, what fails named, nothing done twice, nothing lost."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from inspector.learner import learn_recordings
from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.service.jobs import Work
from inspector.settings import read_settings
from inspector.stores.records import Json
from tests.api.stations import BAD, GOOD, PRODUCT, begin, feed, frames, learnt, material, sweep, teach
from tests.api.test_round import ended, refused, uploaded
from tests.buckets import Buckets

HERE = "http://127.0.0.1"


def station(data: Path, **settings: str) -> TestClient:
    app = create_app(read_settings(data=data, scorers=1, executor="processes:2", **settings))
    return TestClient(app, base_url=HERE, raise_server_exceptions=False)


def service(client: TestClient) -> Any:
    app: Any = client.app
    return app.state.service


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    with station(tmp_path) as client:
        teach(service(client))
        yield client


def batch(client: TestClient, **asked: Any) -> dict[str, Any]:
    answer = client.post("/v1/batches", json={"product_id": PRODUCT, **asked})
    assert answer.status_code == 202, answer.text
    return ended(client, answer.json()["job_id"])


def replayed(client: TestClient) -> list[dict[str, Any]]:
    return client.get("/v1/inspections?source=replay").json()["items"]


def counts(recordings: int, before: int, done: int, failed: int, **verdicts: int) -> dict[str, Any]:
    return {"recordings": recordings, "before": before, "done": done, "failed": failed, "verdicts": verdicts}


def test_many_sweeps_are_replayed_what_fails_is_named_and_what_is_done_is_not_done_again(
    client: TestClient, tmp_path: Path
) -> None:
    good, bad, lost = (uploaded(client, sweep(each)) for each in (GOOD, BAD, BAD))
    whole = (tmp_path / "sweeps" / f"{lost}.mcap").read_bytes()
    (tmp_path / "sweeps" / f"{lost}.mcap").write_bytes(b"no recording")
    job = batch(client, of="sweeps", ids=[good, bad, lost, good])
    assert (job["state"], job["kind"], job["progress"], job["error"]) == ("done", "batch", 1.0, None)
    assert job["batch"] == counts(3, 0, 2, 1, OK=1, NG=1)
    assert len(job["said"]) == 1
    assert job["said"][0].startswith(f"sweep {lost}: its recording: no MCAP")
    assert str(tmp_path) not in job["said"][0]
    told = {each["inspection_id"]: client.get(f"/v1/inspections/{each['inspection_id']}/result").json()
            for each in replayed(client)}  # fmt: skip
    here = {f"sweep {id}": replay(SweepReader(sweep(of)), learnt()).result for id, of in ((good, GOOD), (bad, BAD))}
    assert {each["replay_of"]: each["digest"] for each in told.values()} == {
        name: result.digest for name, result in here.items()
    }
    assert all(each["is_simulated"] for each in told.values())
    again = batch(client, of="sweeps", ids=[good, bad])
    assert again["batch"] == counts(2, 2, 0, 0, OK=1, NG=1)
    (tmp_path / "sweeps" / f"{lost}.mcap").write_bytes(whole)
    assert batch(client, of="sweeps", last=100)["batch"] == counts(3, 2, 1, 0, OK=1, NG=2)
    lenient = batch(client, of="sweeps", last=2, policy={"sensitivity": 0.01})
    assert lenient["batch"] == counts(2, 0, 2, 0, OK=2)
    assert len(replayed(client)) == 5


def test_inspections_are_chosen_by_verdict_and_part(client: TestClient) -> None:
    for options, part in ((GOOD, "a-1"), (BAD, "a-2"), (BAD, "b-1")):
        inspection = begin(client, part)
        feed(client, inspection, frames(options))
        assert client.post(f"/v1/inspections/{inspection}/conclude").status_code == 200
    everything = batch(client, last=10)
    assert everything["batch"] == counts(3, 0, 3, 0, OK=1, NG=2)
    assert batch(client, last=10, verdict="NG", part="a-")["batch"] == counts(1, 1, 0, 0, NG=1)
    live = client.get("/v1/inspections?source=live").json()["items"]
    assert batch(client, ids=[live[0]["inspection_id"]])["batch"] == counts(1, 1, 0, 0, NG=1)
    # Replays have no recording of their own.
    again = batch(client, ids=[replayed(client)[0]["inspection_id"]])
    assert again["batch"] == counts(1, 0, 0, 1)
    assert "there is no recording" in again["said"][0]


def test_many_golden_sweeps_are_learnt_by_the_executor(client: TestClient, tmp_path: Path) -> None:
    golden = [material() / "golden.mcap", sweep(GOOD), sweep("unit=5&seed=5")]
    sweeps = [uploaded(client, each) for each in golden]
    answer = client.post(f"/v1/products/{PRODUCT}/appearances", json={"sweep_ids": sweeps})
    job = ended(client, answer.json()["job_id"])
    assert (job["state"], job["error"]) == ("done", None)
    assert job["appearance_id"] == learn_recordings(golden, tmp_path / "here").id
    whole = (tmp_path / "sweeps" / f"{sweeps[2]}.mcap").read_bytes()
    (tmp_path / "sweeps" / f"{sweeps[2]}.mcap").write_bytes(whole[: len(whole) // 3])
    answer = client.post(f"/v1/products/{PRODUCT}/appearances", json={"sweep_ids": sweeps})
    job = ended(client, answer.json()["job_id"])
    assert job["state"] == "failed"
    assert job["error"].startswith(f"sweep {sweeps[2]}: golden sweep 3 fits the reference sweep in ")


def test_workers_read_recordings_from_a_bucket(tmp_path: Path, buckets: Buckets) -> None:
    files = buckets.new()
    with station(tmp_path, files=files) as client:
        teach(service(client))
        good, lost = (uploaded(client, sweep(GOOD)) for _ in range(2))
        service(client).files.remove("sweep", lost)
        job = batch(client, of="sweeps", last=2)
        assert job["batch"] == counts(2, 0, 1, 1, OK=1)
        (why,) = job["said"]
        assert why.startswith(f"sweep {lost}: its recording: there is nothing by that name")
        (made,) = replayed(client)
        assert client.get(f"/v1/inspections/{made['inspection_id']}/result").json()["replay_of"] == f"sweep {good}"


def test_a_batch_that_was_cut_off_goes_on_where_it_was(tmp_path: Path) -> None:
    with station(tmp_path) as client:
        teach(service(client))
        ids = [uploaded(client, sweep(GOOD)) for _ in range(8)]
        answer = client.post("/v1/batches", json={"product_id": PRODUCT, "of": "sweeps", "ids": ids})
        while not (some := replayed(client)):
            threading.Event().wait(0.03)
    with station(tmp_path) as client:
        cut_off = client.get(f"/v1/jobs/{answer.json()['job_id']}").json()
        assert (cut_off["state"], "stopped" in cut_off["error"]) == ("failed", True)
        before = len(replayed(client))
        assert len(some) <= before < 8
        assert batch(client, of="sweeps", ids=ids)["batch"] == counts(8, before, 8 - before, 0, OK=8)


def test_a_job_is_cancelled_while_it_runs_or_waits(client: TestClient) -> None:
    did = list[str]()

    def endless(progress: Callable[[float], object]) -> Json:
        did.append("endless")
        while True:
            progress(0.5)
            threading.Event().wait(0.01)

    def waiting(progress: Callable[[float], object]) -> Json:
        did.append("waiting")
        return {}

    def begun(work: Work) -> str:
        assert client.portal is not None
        return client.portal.call(service(client).jobs.begin, "batch", PRODUCT, {}, work).job_id

    first, second = begun(endless), begun(waiting)
    for job in (second, first):
        answer = client.post(f"/v1/jobs/{job}/cancel")
        assert (answer.status_code, answer.json()["state"]) == (200, "failed"), answer.text
    # What comes next has its turn.
    done = batch(client, of="sweeps", ids=[uploaded(client, sweep(GOOD))])
    assert (done["state"], done["batch"]) == ("done", counts(1, 0, 1, 0, OK=1))
    assert did in ([], ["endless"])
    for job in (first, second):
        told = client.get(f"/v1/jobs/{job}").json()
        assert (told["state"], told["error"]) == ("failed", "it was cancelled by local")
    refused(client.post(f"/v1/jobs/{first}/cancel"), 409, "is failed, and changes no more")
    refused(client.post("/v1/jobs/none/cancel"), 404, "there is no job")


@pytest.fixture(scope="module")
def untouched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """A product that is learnt, and nothing inspected."""
    with station(tmp_path_factory.mktemp("untouched")) as client:
        teach(service(client))
        yield client


@pytest.mark.parametrize(
    ("asked", "status", "said"),
    [
        ({}, 422, "one of `ids` and `last` is needed"),
        ({"ids": ["a"], "last": 1}, 422, "one of `ids` and `last` is needed"),
        ({"ids": ["a"], "verdict": "NG"}, 422, "`verdict` and `part` go with `last`"),
        ({"of": "sweeps", "last": 1, "part": "a"}, 422, "`verdict` and `part` go with `last`"),
        ({"ids": ["0" * 32]}, 404, "there is no inspection"),
        ({"of": "sweeps", "ids": ["0" * 32]}, 404, "there is no sweep"),
        ({"last": 1, "recipe_id": "none"}, 404, "there is no recipe"),
        ({"last": 1}, 409, "no inspections of product 'plate' were chosen"),
        ({"product_id": "nobody", "last": 1}, 404, "there is no product"),
    ],
)
def test_what_is_wrong_is_told_before_anything_is_begun(
    untouched: TestClient, asked: dict[str, Any], status: int, said: str
) -> None:
    refused(untouched.post("/v1/batches", json={"product_id": PRODUCT, **asked}), status, said)
    assert untouched.get("/v1/jobs").json()["items"] == []
