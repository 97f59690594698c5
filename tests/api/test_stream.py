"""The stream: one digest by every way, credits, broken connections, and clients that are rude, slow or silent."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from starlette.testclient import WebSocketDenialResponse
from starlette.websockets import WebSocketDisconnect

from api.app import create_app
from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.settings import read_settings
from tests.api.stations import GOOD, Stream, begin, feed, frames, learnt, post, sent, standing, sweep, teach

HERE = "http://127.0.0.1"
WINDOW = 8


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    settings = read_settings(data=tmp_path_factory.mktemp("station") / "data", scorers=1, window=WINDOW)
    app = create_app(settings)
    with TestClient(app, base_url=HERE) as client:
        teach(app.state.service)
        yield client


def stream(client: TestClient, inspection: str, after: int = -1) -> Any:
    return client.websocket_connect(f"ws://127.0.0.1/v1/inspections/{inspection}/stream?after={after}")


def push(talk: Stream, window: int, those: Any = None) -> None:
    """All frames, never more unanswered than there are credits."""
    unanswered = 0
    for frame in frames() if those is None else those:
        if unanswered == window:
            talk.hear("scored")
            unanswered -= 1
        talk.socket.send_bytes(sent(frame))
        unanswered += 1


def test_by_stream_by_rest_and_replayed_the_digest_is_the_same(client: TestClient, tmp_path: Path):
    by_stream, by_rest = begin(client), begin(client)
    with stream(client, by_stream) as socket:
        talk = Stream(socket)
        ready = talk.hear("ready")
        push(talk, ready["credits"])
        socket.send_json({"kind": "conclude"})
        streamed = talk.hear("verdict")["result"]
    feed(client, by_rest)
    posted = client.post(f"/v1/inspections/{by_rest}/conclude").json()
    offline = replay(SweepReader(sweep()), learnt()).result
    assert streamed["digest"] == posted["digest"] == offline.digest
    assert streamed["verdict"] == posted["verdict"] == offline.verdict == "NG"
    assert streamed["frames_dropped"] == posted["frames_dropped"] == 0
    # What was recorded is what was scored.
    recorded = tmp_path / "recorded.mcap"
    recorded.write_bytes(client.get(f"/v1/inspections/{by_stream}/recording").content)
    assert replay(SweepReader(recorded), learnt()).result.digest == offline.digest


def test_every_message_is_numbered_and_deviations_are_told_as_they_come(client: TestClient):
    inspection = begin(client)
    with stream(client, inspection) as socket:
        talk = Stream(socket)
        talk.hear("ready")
        push(talk, 8)
        so_far = client.get(f"/v1/inspections/{inspection}").json()["so_far"]
        socket.send_json({"kind": "conclude"})
        result = talk.hear("verdict")["result"]
    # Who comes later hears of it, too; when it is over, the result tells.
    found = talk.kinds("deviation_opened", "deviation_closed", "early_ng")
    assert {"deviation_opened", "early_ng"} <= {each["kind"] for each in so_far}
    assert so_far == found[: len(so_far)]
    assert client.get(f"/v1/inspections/{inspection}").json()["so_far"] is None
    numbered = [each for each in talk.said if each["kind"] != "ready"]
    assert [each["n"] for each in numbered] == list(range(len(numbered)))
    opened, early = talk.kinds("deviation_opened"), talk.kinds("early_ng")
    assert len(opened) == len(result["deviations"])
    assert len(early) == 1
    assert early[0]["n"] < talk.kinds("scored")[-1]["n"], "NG is told while the part is still under the camera"


def test_a_broken_connection_loses_nothing_and_nothing_is_scored_twice(client: TestClient):
    inspection = begin(client)
    with stream(client, inspection) as socket:
        talk = Stream(socket)
        talk.hear("ready")
        push(talk, 4, frames()[:20])
        # It breaks with frames on their way and answers that nobody heard.
    with stream(client, inspection, after=talk.said[-1].get("n", -1)) as socket:
        again = Stream(socket)
        ready = again.hear("ready")
        # A careful client sends once more all that it does not know to have come.
        for frame in frames()[15:20]:
            socket.send_bytes(sent(frame))
        push(again, 3, [frame for frame in frames() if frame.sequence >= max(20, ready["next_sequence"])])
        socket.send_json({"kind": "conclude"})
        result = again.hear("verdict")["result"]
    scored = [each["sequence"] for each in (*talk.kinds("scored"), *again.kinds("scored"))]
    assert scored == [frame.sequence for frame in frames()]
    assert result["digest"] == replay(SweepReader(sweep()), learnt()).result.digest


@pytest.mark.parametrize(("after", "first"), [(2, 3), (999, 0)])
def test_after_the_verdict_a_late_connection_hears_all_of_it_again(client: TestClient, after: int, first: int):
    inspection = begin(client)
    feed(client, inspection, frames()[:6])
    client.post(f"/v1/inspections/{inspection}/conclude")
    with stream(client, inspection, after=after) as socket:
        talk = Stream(socket)
        talk.hear("verdict")
        assert talk.said[1]["n"] == first
        with pytest.raises(WebSocketDisconnect):
            socket.receive_text()


def test_a_second_connection_takes_over(client: TestClient):
    inspection = begin(client)
    with stream(client, inspection) as old, stream(client, inspection) as new:
        Stream(new).hear("ready")
        Stream(old).hear("ready")
        with pytest.raises(WebSocketDisconnect) as ended:
            old.receive_text()
        assert ended.value.code == 4409
        new.send_bytes(sent(frames()[0]))
        assert Stream(new).hear("scored")["sequence"] == frames()[0].sequence


def test_what_is_sent_beyond_the_credits_is_dropped_counted_and_recorded(client: TestClient):
    inspection = begin(client)
    with stream(client, inspection) as socket:
        talk = Stream(socket)
        talk.hear("ready")
        with standing(client.app.state.service):  # type: ignore[attr-defined]
            for frame in frames():
                socket.send_bytes(sent(frame))
            for frame in frames()[WINDOW:]:
                assert talk.hear("dropped")["sequence"] == frame.sequence
        socket.send_json({"kind": "conclude"})
        result = talk.hear("verdict")["result"]
    assert {each["sequence"] for each in talk.kinds("scored")} == {frame.sequence for frame in frames()[:WINDOW]}
    assert len(result["frames"]) == WINDOW
    assert result["frames_dropped"] == len(frames()) - WINDOW
    told = client.get("/metrics").text
    assert f'inspector_frames_total{{outcome="dropped",product="plate"}} {len(frames()) - WINDOW}.0' in told


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (b"short", "a message of 5 bytes"),
        ("nonsense", "not understood"),
        ('{"kind": "conclude", "stopped": "maybe"}', "not understood"),
        ('{"kind": "begin"}', "not understood"),
    ],
)
def test_a_message_that_is_none_is_a_problem_and_the_inspection_goes_on(
    client: TestClient, message: str | bytes, said: str
):
    inspection = begin(client)
    with stream(client, inspection) as socket:
        talk = Stream(socket)
        socket.send_bytes(message) if isinstance(message, bytes) else socket.send_text(message)
        problem = talk.hear("problem")
        assert said in problem["detail"]
        assert problem["status"] == 422
        socket.send_bytes(sent(frames()[0]))
        talk.hear("scored")


def test_what_is_no_picture_is_refused_and_counts_as_dropped(client: TestClient):
    inspection = begin(client)
    with stream(client, inspection) as socket:
        talk = Stream(socket)
        first, second = frames()[:2]
        socket.send_bytes(sent(first)[:-300])
        assert "jpeg" in talk.hear("refused")["why"]
        socket.send_bytes(sent(second))
        talk.hear("scored")
    assert client.post(f"/v1/inspections/{inspection}/conclude").json()["frames_dropped"] == 1


def test_frames_after_conclude_are_told_so(client: TestClient):
    inspection = begin(client)
    with stream(client, inspection) as socket:
        talk = Stream(socket)
        socket.send_bytes(sent(frames()[0]))
        socket.send_json({"kind": "conclude"})
        socket.send_bytes(sent(frames()[1]))
        talk.hear("verdict")
        while not talk.kinds("problem"):
            talk.hear("problem")
    assert "takes no more frames" in talk.kinds("problem")[0]["detail"]


def test_a_stream_of_nothing_known_is_denied_in_words(client: TestClient):
    with pytest.raises(Exception) as denied, stream(client, "0" * 32):  # noqa: PT011 (the test client's own)
        pass
    response: Any = denied.value
    assert response.status_code == 404
    assert "no inspection" in response.json()["detail"]


@pytest.mark.parametrize(
    ("asked", "said"), [("no%20id/stream", "path.inspection_id"), ("none/stream?after=x", "query.after")]
)
def test_a_stream_that_is_asked_for_wrongly_is_denied_in_words(client: TestClient, asked: str, said: str):
    with (
        pytest.raises(WebSocketDenialResponse) as denied,
        client.websocket_connect(f"ws://127.0.0.1/v1/inspections/{asked}"),
    ):
        pass
    assert denied.value.status_code == 422
    assert denied.value.headers["content-type"] == "application/problem+json"
    assert denied.value.json()["detail"].startswith(said)


def test_good_and_bad_at_once_do_not_mix(client: TestClient):
    good, bad = begin(client), begin(client)
    for one, other in zip(frames(GOOD), frames(), strict=False):
        assert post(client, good, one).status_code == 200
        assert post(client, bad, other).status_code == 200
    assert client.post(f"/v1/inspections/{good}/conclude").json()["verdict"] == "OK"
    assert client.post(f"/v1/inspections/{bad}/conclude").json()["verdict"] == "NG"
