"""The client: one digest by every way, broken connections, services that are busy, away, or say no."""

from __future__ import annotations

import http.server
import json
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inspector.client import (
    AbstractInspection,
    Client,
    InspectionEnded,
    NotSendable,
    NotUnderstood,
    ServiceRefused,
    ServiceUnreachable,
    paced,
)
from inspector.errors import NotARecording
from inspector.pictures import decode, encode_png
from inspector.recording import SweepReader, SweepWriter
from inspector.replay import replay
from inspector.service.service import Service
from models.frame import EncodedPicture, Frame
from models.verdict import Policy
from tests import patience
from tests.api.stations import BAD, GOOD, PART, PRODUCT, frames, learnt, material, sweep, teach
from tests.inspector.client.served import BrokenWay, served

WAYS = ("ws", "rest")


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Service]]:
    with served(tmp_path_factory.mktemp("station") / "data", window=8, scorers=1) as (url, service):
        teach(service)
        yield url, service


@pytest.fixture
def url(station: tuple[str, Service]) -> str:
    return station[0]


def offline(options: str = BAD) -> str:
    return replay(SweepReader(sweep(options)), learnt()).result.digest


class Time:
    """A clock that goes on only while somebody waits."""

    def __init__(self) -> None:
        self.now, self.waits = 0.0, list[float]()

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.waits.append(seconds)
        self.now += seconds


def begin(client: Client, **options: Any) -> AbstractInspection:
    return client.begin(PRODUCT, PART, **options)


def send(inspection: AbstractInspection, those: Iterable[Frame] | None = None) -> None:
    for frame in frames() if those is None else those:
        inspection.send(frame)


def state(url: str, inspection: AbstractInspection) -> dict[str, Any]:
    return patience.get(f"{url}/v1/inspections/{inspection.inspection_id}").json()


@pytest.mark.parametrize("options", [BAD, GOOD, f"{BAD}&jpeg=0&encoder=1&lost=0.1"])
@pytest.mark.parametrize("way", WAYS)
def test_by_either_way_the_digest_is_that_of_the_replay(url: str, way: str, options: str) -> None:
    with Client(url) as client, begin(client, transport=way) as inspection:
        send(inspection, SweepReader(sweep(options)))
        result = inspection.conclude()
    replayed = replay(SweepReader(sweep(options)), learnt()).result
    assert result["digest"] == replayed.digest
    assert result["frames_dropped"] == replayed.frames_dropped
    assert (result["product_id"], result["part_id"]) == (PRODUCT, PART)
    assert len(result["frames"]) == inspection.counts["scored"] == len(replayed.frames)


def test_deviations_and_an_early_ng_are_told_while_the_part_is_there(url: str) -> None:
    told: list[dict[str, Any]] = []
    with Client(url) as client, begin(client, on_message=told.append) as inspection:
        send(inspection)
        result = inspection.conclude()
    kinds = [each["kind"] for each in told]
    assert kinds.index("early_ng") < len(kinds) - 1 - kinds[::-1].index("scored")
    assert kinds.count("deviation_opened") == len(result["deviations"])
    assert kinds[-1] == "verdict"
    assert [each["sequence"] for each in told if each["kind"] == "scored"] == [frame.sequence for frame in frames()]


def test_what_the_service_says_is_heard_while_one_waits(url: str) -> None:
    with Client(url) as client:

        class Done(Exception):
            pass

        def hear(message: dict[str, Any]) -> None:
            if message["kind"] == "scored":
                raise Done

        inspection = begin(client, on_message=hear)
        inspection.send(frames()[0])
        with pytest.raises(Done):
            inspection.wait(600)
        inspection.abort("enough")


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("way", WAYS)
def test_over_connections_that_break_nothing_is_lost_and_nothing_scored_twice(url: str, way: str, seed: int) -> None:
    told: list[dict[str, Any]] = []
    with (
        BrokenWay(url, seed, most=80_000) as road,
        Client(road.url) as client,
        begin(client, transport=way, on_message=told.append) as inspection,
    ):
        send(inspection)
        result = inspection.conclude()
    assert road.breaks > 3
    assert [each["sequence"] for each in told if each["kind"] == "scored"] == [frame.sequence for frame in frames()]
    numbers = [each["n"] for each in told]
    assert numbers == sorted(set(numbers))
    assert result["digest"] == offline()
    assert result["frames_dropped"] == 0


@pytest.mark.parametrize("way", WAYS)
def test_a_picture_that_is_none_is_told_and_counted_and_the_inspection_goes_on(url: str, way: str) -> None:
    told: list[dict[str, Any]] = []
    cut = EncodedPicture("jpeg", frames()[1].encoded.data[:-300])
    with Client(url) as client, begin(client, transport=way, on_message=told.append) as inspection:
        for number, frame in enumerate(frames()):
            inspection.send(frame if number != 1 else Frame(frame.pixels, frame.t_ns, frame.sequence, encoded=cut))
        result = inspection.conclude()
    refused = [each for each in told if each["kind"] == "refused"]
    assert [each["sequence"] for each in refused] == [frames()[1].sequence]
    assert "jpeg" in refused[0]["why"]
    assert result["frames_dropped"] == inspection.counts["refused"] == 1


@pytest.mark.parametrize("way", WAYS)
def test_a_frame_without_bytes_of_its_own_goes_without_loss(url: str, way: str) -> None:
    bare = [Frame(frame.pixels, frame.t_ns, frame.sequence) for frame in frames()]
    with Client(url) as client, begin(client, transport=way) as inspection:
        send(inspection, bare)
        assert inspection.conclude()["digest"] == offline()
    assert (decode(encode_png(bare[0].pixels)) == bare[0].pixels).all()


@pytest.mark.parametrize("way", WAYS)
def test_who_leaves_without_concluding_aborts(url: str, way: str) -> None:
    with Client(url) as client:
        with pytest.raises(NotSendable), begin(client, transport=way) as inspection:
            send(inspection, (*frames()[:3], frames()[0]))
        found = state(url, inspection)
        assert (found["state"], found["reason"]) == ("aborted", "the line broke off: NotSendable")
        with begin(client, transport=way) as inspection:
            inspection.send(frames()[0])
        assert "without concluding" in state(url, inspection)["reason"]


@pytest.mark.parametrize("way", WAYS)
def test_an_inspection_that_the_service_ended_is_told_so(url: str, way: str) -> None:
    with Client(url) as client, begin(client, transport=way) as inspection:
        inspection.send(frames()[0])
        ending = f"{url}/v1/inspections/{inspection.inspection_id}/abort"
        patience.post(ending, json={"reason": "the door was opened"})
        with pytest.raises(ServiceRefused) as said:
            send(inspection, frames()[1:])
    if way == "ws":
        assert isinstance(said.value, InspectionEnded)
        assert "the door was opened" in str(said.value)
    assert said.value.status == 409


def test_another_connection_that_takes_over_is_told_to_the_one_before(url: str) -> None:
    with Client(url) as client, begin(client) as old:
        from inspector.client.streaming import StreamedInspection

        begun = {name: getattr(old, name) for name in ("inspection_id", "recipe_id", "appearance_id")}
        new = StreamedInspection(client._asker, begun, lambda message: None)
        with pytest.raises(InspectionEnded, match="taken it over"):
            old.wait(600)
        new.abort("enough")


def test_what_the_service_refuses_is_a_sentence(url: str) -> None:
    with Client(url) as client:
        with pytest.raises(ServiceRefused, match=r"Not found: .*'nothing'") as said:
            client.begin("nothing", PART)
        assert said.value.status == 404
        with pytest.raises(ServiceRefused, match="recipe"):
            client.begin(PRODUCT, PART, recipe_id="none")
        with pytest.raises(ServiceRefused, match="part_id"):
            client.begin(PRODUCT, "")


def test_who_has_no_token_or_a_wrong_one_is_refused(tmp_path: Path) -> None:
    with served(tmp_path / "data", require_token=True) as (url, service):
        teach(service)
        right = service.access.make("line", "operator", "test")[1]
        for token, said in ((None, "asks for a token"), ("wrong", "not known here")):
            with Client(url, token) as client, pytest.raises(ServiceRefused, match=said) as refused:
                begin(client)
            assert refused.value.status == 401
            assert refused.value.kind == "urn:inspector:access-refused"
        for way in WAYS:
            with Client(url, right) as client, begin(client, transport=way) as inspection:
                inspection.send(frames()[0])
                assert inspection.conclude()["frames_scored"] == 1


def test_where_nobody_is_nobody_is_waited_for(port: int) -> None:
    clock = Time()
    said = rf"127\.0\.0\.1:{port} does not answer: .*refused"
    with (
        Client(f"http://127.0.0.1:{port}", clock=clock, sleep=clock.sleep) as client,
        pytest.raises(ServiceUnreachable, match=said),
    ):
        begin(client)
    assert clock.waits == []


@pytest.mark.parametrize("way", WAYS)
def test_a_service_that_went_away_is_waited_for_as_long_as_asked(tmp_path: Path, port: int, way: str) -> None:
    clock = Time()
    with ExitStack() as stack:
        with served(tmp_path / "data", port) as (url, service):
            teach(service)
            client = stack.enter_context(Client(url, timeout=60, patience=20, clock=clock, sleep=clock.sleep))
            inspection = begin(client, transport=way)
        with pytest.raises(ServiceUnreachable if way == "rest" else (ServiceUnreachable, InspectionEnded)):
            send(inspection)
    if way == "rest":
        assert 15 < sum(clock.waits) <= 20
        assert clock.waits[:4] == pytest.approx([0.1, 0.2, 0.4, 0.8])


@contextmanager
def answering(*answers: tuple[int, dict[str, str], bytes]) -> Iterator[tuple[str, list[tuple[str, dict[str, str]]]]]:
    """A server that gives these answers, one after the other, and what it was asked."""
    asked: list[tuple[str, dict[str, str]]] = []
    left = iter(answers)

    class Handler(http.server.BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_POST(self) -> None:
            self.rfile.read(int(self.headers.get("content-length", 0)))
            asked.append((self.path, {name.lower(): value for name, value in self.headers.items()}))
            status, headers, body = next(left)
            self.send_response(status)
            for name, value in (headers | {"Content-Length": str(len(body))}).items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

        do_GET = do_POST

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", asked
        finally:
            server.shutdown()
            thread.join()


def problem(status: int, type: str = "urn:inspector:busy", **headers: str) -> tuple[int, dict[str, str], bytes]:
    said = {"type": type, "title": "No room", "status": status, "detail": "3 frames wait already"}
    return status, {name.replace("_", "-"): value for name, value in headers.items()}, json.dumps(said).encode()


BEGUN = (201, {}, json.dumps({"inspection_id": "i", "recipe_id": "r", "appearance_id": "a"}).encode())
SCORED = (200, {}, b'{"n": 0, "kind": "scored", "sequence": 0}')


def test_who_is_busy_is_asked_again_when_they_said() -> None:
    clock = Time()
    busy = [problem(503, Retry_After="5"), problem(503), (502, {}, b"<html>"), problem(409, Retry_After="1")]
    busy.append((500, {}, b"Internal Server Error"))
    answers = (*busy, BEGUN, problem(503, Retry_After="2"), SCORED)
    with answering(*answers) as (url, asked), Client(url, clock=clock, sleep=clock.sleep) as client:
        inspection = begin(client, transport="rest")
        inspection.send(frames()[0])
    assert clock.waits == pytest.approx([5, 0.1, 0.2, 1, 0.8, 2])
    assert inspection.counts == {"scored": 1}
    keys = {headers["idempotency-key"] for path, headers in asked if path == "/v1/inspections"}
    assert len(keys) == 1, "the same order each time: it begins one inspection"
    posts = [path for path, _ in asked if path.startswith("/v1/inspections/i/frames?")]
    assert len(posts) == 2
    assert len(set(posts)) == 1


def test_where_one_service_is_full_another_id_is_tried_at_once() -> None:
    clock = Time()
    full = problem(503, type="urn:inspector:at-capacity", Retry_After="5")
    with answering(full, full, BEGUN, SCORED) as (url, asked), Client(url, clock=clock, sleep=clock.sleep) as client:
        begin(client, transport="rest").send(frames()[0])
    assert clock.waits == pytest.approx([0.1])
    ids = [headers["x-session-id"] for _, headers in asked]
    assert len({*ids[:3]}) == 3
    assert ids[3] == ids[2], "it stays with the one that had room"


def test_who_is_busy_for_too_long_has_refused() -> None:
    clock = Time()
    busy = [problem(503, Retry_After="7")] * 5
    with (
        answering(*busy) as (url, asked),
        Client(url, patience=20, clock=clock, sleep=clock.sleep) as client,
        pytest.raises(ServiceRefused, match="No room: 3 frames wait already"),
    ):
        begin(client)
    assert clock.waits == [7, 7]
    assert len(asked) == 3


@pytest.mark.parametrize(
    "answer", [(404, {}, b"<html>nothing</html>"), (200, {}, b"hello"), (200, {}, b'{"ok": true}')]
)
def test_somebody_else_behind_the_url_is_told_from_the_service(answer: Any) -> None:
    with answering(answer) as (url, _), Client(url) as client, pytest.raises(NotUnderstood, match="is it one"):
        begin(client)


@pytest.mark.parametrize(
    "url",
    ["", "station", "ftp://station", "http://", "http://a:b@station", "http://station?x=1", "http://station:99999"],
)
def test_a_url_of_no_service_is_refused(url: str) -> None:
    with pytest.raises(NotSendable, match="allowed is http://HOST:PORT"):
        Client(url)


@pytest.mark.parametrize("token", ["", "two words", "ä", "line\n"])
def test_a_token_that_no_header_holds_is_refused_and_not_shown(token: str) -> None:
    with pytest.raises(NotSendable, match="the token cannot be sent"):
        Client("http://station", token)


@pytest.mark.parametrize(("name", "value"), [("sequence", 2**32), ("sequence", -1), ("t_ns", -1), ("t_ns", 2**63)])
def test_a_frame_whose_numbers_do_not_travel_is_refused(url: str, name: str, value: int) -> None:
    first = frames()[0]
    numbers = {"t_ns": first.t_ns, "sequence": 0} | {name: value}
    frame = Frame(first.pixels, **numbers)
    with (
        Client(url) as client,
        begin(client, transport="rest") as inspection,
        pytest.raises(NotSendable, match="allowed are"),
    ):
        inspection.send(frame)


def test_a_frame_that_comes_twice_is_refused(url: str) -> None:
    with Client(url) as client, begin(client) as inspection:
        inspection.send(frames()[5])
        for frame in frames()[4:6]:
            with pytest.raises(NotSendable, match=f"allowed are numbers above {frames()[5].sequence}"):
                inspection.send(frame)


def test_a_product_is_taught_and_the_same_is_learnt_as_from_the_files(tmp_path: Path) -> None:
    told: list[float] = []
    with served(tmp_path / "data") as (url, _), Client(url, sleep=lambda seconds: time.sleep(seconds / 10)) as client:
        golden = client.upload_sweep(material() / "golden.mcap", "new", "master")
        appearance_id = client.learn("new", [golden], on_progress=told.append)
        assert appearance_id == learnt().id
        assert told == sorted(told)
        assert told[-1] == 1
        strict = client.make_recipe("new", appearance_id, policy={"sensitivity": 2.0}, note="strict")
        usual = client.make_recipe("new", activate=False)
        for recipe_id, policy in ((None, Policy(sensitivity=2.0)), (usual, Policy())):
            with client.begin("new", PART, recipe_id=recipe_id) as inspection:
                send(inspection)
                assert inspection.recipe_id == (recipe_id or strict)
                assert inspection.conclude()["digest"] == replay(SweepReader(sweep()), learnt(), policy).result.digest
        black = tmp_path / "black.mcap"
        with SweepWriter(black) as writer:
            for frame in frames()[:10]:
                writer.write(Frame(np.zeros_like(frame.pixels), frame.t_ns, frame.sequence))
        with pytest.raises(ServiceRefused, match="Not learnt: "):
            client.learn("new", [client.upload_sweep(black, "new")])
        with pytest.raises(ServiceRefused, match="Recording not readable"):
            client.upload_sweep(material() / "plate.appearance", "new")
        with pytest.raises(NotARecording, match="No such file"):
            client.upload_sweep(tmp_path / "nothing.mcap", "new")


def test_at_its_own_pace_each_frame_goes_when_it_was_taken() -> None:
    clock, gone = Time(), list[float]()
    for frame in paced(frames(), clock, clock.sleep):
        gone.append(clock.now)
        # The line is slow at first: the time is made up for, nothing is left out.
        clock.now += 0.5 if frame is frames()[3] else 0.001
    taken = [(frame.t_ns - frames()[0].t_ns) / 1e9 for frame in frames()]
    assert gone[:4] == pytest.approx(taken[:4])
    assert gone[-1] == pytest.approx(taken[-1])
    assert all(at >= due - 1e-9 for at, due in zip(gone, taken, strict=True))
