"""Clients that are silent, slow or rude hold up nobody: others are inspected to the end, without a drop."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import httpx2
import pytest
from websockets.sync.client import ClientConnection, connect

from tests import patience
from tests.api.stations import GOOD, PRODUCT, frames, picture, sent, taught
from tests.system.serving import Served, serve


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serve(taught(tmp_path_factory.mktemp("rude") / "data"), max_subscribers="4") as served:
        yield served


@pytest.fixture
def client(served: Served) -> Iterator[httpx2.Client]:
    with httpx2.Client(base_url=served.url, timeout=patience.SECONDS) as client:
        yield client


def begin(client: httpx2.Client, part: str) -> str:
    answer = client.post("/v1/inspections", json={"product_id": PRODUCT, "part_id": part})
    return answer.raise_for_status().json()["inspection_id"]


def stream(served: Served, inspection: str, **options: Any) -> ClientConnection:
    url = f"{served.url.replace('http', 'ws')}/v1/inspections/{inspection}/stream"
    return connect(url, compression=None, max_size=None, **options)


def inspected(served: Served, client: httpx2.Client, part: str) -> dict[str, Any]:
    """A part inspected by a decent client."""
    with stream(served, begin(client, part)) as socket:
        credit, unanswered = json.loads(socket.recv())["credits"], 0
        for frame in frames(GOOD):
            while unanswered >= credit:
                unanswered -= json.loads(socket.recv())["kind"] == "scored"
            socket.send(sent(frame))
            unanswered += 1
        socket.send('{"kind": "conclude"}')
        while (said := json.loads(socket.recv()))["kind"] != "verdict":
            pass
    return said["result"]


def test_who_sends_and_never_reads(served: Served, client: httpx2.Client):
    with stream(served, begin(client, "silent"), max_queue=1, close_timeout=0.1) as silent:
        for turn in range(5):
            for frame in frames():
                silent.send(sent(frame) if turn == 0 else b"rubbish")
        result = inspected(served, client, "decent")
    assert (result["verdict"], result["frames_dropped"]) == ("OK", 0)


def test_who_opens_a_request_and_never_ends_it(served: Served, client: httpx2.Client):
    host, port = served.url.removeprefix("http://").split(":")
    inspection = begin(client, "slow")
    with ExitStack() as stack:
        for _ in range(20):
            slow = stack.enter_context(socket.create_connection((host, int(port))))
            head = f"POST /v1/inspections/{inspection}/frames HTTP/1.1\r\nHost: {host}:{port}\r\n"
            slow.sendall((head + "Content-Type: image/jpeg\r\nContent-Length: 100000\r\n\r\n").encode() + bytes(10))
        result = inspected(served, client, "decent")
    assert (result["verdict"], result["frames_dropped"]) == ("OK", 0)


def test_who_listens_to_events_and_never_reads(served: Served, client: httpx2.Client):
    host, port = served.url.removeprefix("http://").split(":")
    with ExitStack() as stack:
        for _ in range(4):
            deaf = stack.enter_context(socket.create_connection((host, int(port))))
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
            deaf.sendall(f"GET /v1/events HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
            assert deaf.recv(12) == b"HTTP/1.1 200"
        assert client.get("/v1/events").status_code == 503
        result = inspected(served, client, "decent")
    assert (result["verdict"], result["frames_dropped"]) == ("OK", 0)
    patience.until(lambda: has_room(client))


def has_room(client: httpx2.Client) -> bool:
    """Whether somebody may listen to events."""
    with client.stream("GET", "/v1/events") as answer:
        return answer.status_code == 200


def told(answer: httpx2.Response) -> Iterator[tuple[int, str, dict[str, Any]]]:
    """Number, kind and data of each event, as they come; the first, how the station is, has no number."""
    fields: dict[str, str] = {}
    for line in answer.iter_lines():
        name, _, value = line.partition(": ")
        if line:
            fields[name] = value
        else:
            if "id" in fields:
                yield int(fields["id"].rpartition("-")[2]), fields["event"], json.loads(fields["data"])
            fields = {}


def until_verdict(answer: httpx2.Response, part: str) -> list[tuple[int, str, dict[str, Any]]]:
    heard: list[tuple[int, str, dict[str, Any]]] = []
    for event in told(answer):
        heard.append(event)
        if event[1] == "verdict" and event[2]["part_id"] == part:
            break
    return heard


def test_who_listens_hears_the_part_from_begin_to_verdict(served: Served, client: httpx2.Client):
    with client.stream("GET", "/v1/events") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        inspection = begin(client, "heard")
        with stream(served, inspection, close_timeout=0.1) as socket:
            for frame in frames()[:25]:
                socket.send(sent(frame))
            socket.send('{"kind": "conclude", "stopped": true}')
            heard = until_verdict(answer, "heard")
    mine = [(kind, data) for _, kind, data in heard if data.get("inspection_id") == inspection]
    kinds = [kind for kind, _ in mine]
    assert (kinds[0], kinds[-1]) == ("begun", "verdict")
    assert {"deviation_opened", "early_ng"} <= set(kinds)
    scores = [frame for kind, data in mine if kind == "scores" for frame in data["frames"]]
    assert [index for index, *_ in scores] == list(range(25))
    numbers = [number for number, _, _ in heard]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_who_comes_back_to_events_hears_what_came_after_and_nothing_twice(served: Served, client: httpx2.Client):
    with client.stream("GET", "/v1/events") as answer:
        inspected(served, client, "first")
        last_id = next(line.partition(": ")[2] for line in answer.iter_lines() if line.startswith("id: "))
    with client.stream("GET", "/v1/events", headers={"last-event-id": last_id}) as answer:
        inspected(served, client, "second")
        numbers = [number for number, _, _ in until_verdict(answer, "second")]
    first = int(last_id.rpartition("-")[2]) + 1
    assert len(numbers) > 3
    assert numbers == list(range(first, first + len(numbers)))


def test_pictures_by_post_beside_all_that(served: Served, client: httpx2.Client):
    inspection = begin(client, "post")
    for frame in frames(GOOD):
        numbers = {"t_ns": frame.t_ns, "sequence": frame.sequence}
        path, jpeg = f"/v1/inspections/{inspection}/frames", {"content-type": "image/jpeg"}
        assert client.post(path, params=numbers, content=picture(frame), headers=jpeg).status_code == 200
    assert client.post(f"/v1/inspections/{inspection}/conclude").json()["verdict"] == "OK"
