"""docker/haproxy.cfg with real servers that are really killed: where requests go, and that none is lost."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from hashlib import md5
from pathlib import Path
from typing import Any

import httpx2
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests import patience
from tests.system.proxying import Proxy, proxy

IDS = [md5(b"%d" % number).hexdigest() for number in range(24)]
"""The same in every run: each of three services gets some."""
PICTURE = bytes(200_000)


class Line:
    """Small services behind the proxy."""

    def __init__(self, front: Proxy, held: ExitStack) -> None:
        self.front, self._held = front, held
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        each_anew = httpx2.Limits(max_keepalive_connections=0)
        self._http = held.enter_context(httpx2.Client(base_url=front.url, timeout=patience.SECONDS, limits=each_anew))

    def start(self, number: int) -> str:
        """One more, of that address, which the name server knows from now on; returns when requests come to it."""
        address = self.front.address(number)
        command = [sys.executable, "-m", "tests.system.small_node", address, str(self.front.port)]
        process = self.running[address] = subprocess.Popen(command)
        self._held.callback(process.wait)
        self._held.callback(process.kill)
        if address not in self.front.names.addresses:
            self.front.names.addresses.append(address)
        self.until(lambda: address in {self.ask("GET", "/anything").get("node") for _ in range(8)})
        return address

    def kill(self, address: str) -> None:
        """With SIGKILL."""
        process = self.running.pop(address)
        process.kill()
        process.wait()

    def ask(self, method: str, path: str, **more: Any) -> dict[str, Any]:
        """The answer of whoever got the request; each over a connection of its own."""
        answer = self._http.request(method, path, **more)
        return answer.json() | {"status": answer.status_code, "retry": answer.headers.get("retry-after")}

    def frame(self, inspection: str, **more: Any) -> dict[str, Any]:
        """One picture for that inspection."""
        return self.ask("POST", f"/v1/inspections/{inspection}/frames", content=PICTURE, **more)

    def places(self) -> dict[str, str]:
        """Which service each inspection is on."""
        answers = {id: self.frame(id) for id in IDS}
        assert {answer["status"] for answer in answers.values()} == {200}
        return {id: answer["node"] for id, answer in answers.items()}

    def stream(self, inspection: str) -> Any:
        """A WebSocket."""
        url = f"{self.front.url.replace('http', 'ws')}/v1/inspections/{inspection}/stream"
        return connect(url, proxy=None, open_timeout=patience.SECONDS)

    def until(self, happened: Callable[[], bool]) -> None:
        """Wait for it."""
        patience.until(happened, self.front.log.read_text)


@contextmanager
def line(folder: Path, count: int) -> Iterator[Line]:
    with proxy(folder) as front, ExitStack() as held:
        started = Line(front, held)
        for number in range(count):
            started.start(number)
        yield started


@pytest.fixture
def two(tmp_path: Path) -> Iterator[Line]:
    with line(tmp_path, 2) as started:
        yield started


def test_an_inspection_stays_where_its_id_says_and_who_says_none_gets_one(two: Line) -> None:
    before = two.places()
    assert set(before.values()) == {*two.running}
    assert two.places() == before
    for id, node in before.items():
        begun = two.ask("POST", "/v1/inspections", headers={"X-Session-Id": id})
        assert (begun["node"], begun["key"]) == (node, id)
        # Where the two differ, the path is meant: that is the inspection that gets the picture.
        assert two.frame(id, headers={"X-Session-Id": "other"})["key"] == id
    made = [two.ask("POST", "/v1/inspections")["key"] for _ in range(10)]
    assert len({*made}) == 10
    assert all(re.fullmatch(r"[0-9a-f]{32}", key) for key in made)
    assert two.ask("GET", "/v1/inspections")["key"] is None


def test_after_a_kill_no_request_fails_and_only_its_own_inspections_move(two: Line) -> None:
    before = two.places()
    gone, stays = two.running
    two.kill(gone)
    assert {*two.places().values()} == {stays}
    two.start(0)
    two.until(lambda: two.places() == before)


def test_what_a_dying_service_took_is_asked_of_the_next_where_twice_is_once(two: Line) -> None:
    gone, stays = two.running
    mine = next(id for id, node in two.places().items() if node == gone)
    answer = two.frame(mine, params={"sequence": 7, "die": gone})
    told = [answer.get(name) for name in ("status", "node", "bytes")]
    assert told == [200, stays, len(PICTURE)], two.front.log.read_text()
    two.running.pop(gone).wait()
    two.start(0)
    mine = next(id for id, node in two.places().items() if node == gone)
    told = two.frame(mine, params={"die": gone})
    assert (told["status"], told["type"], told["retry"]) == (502, "urn:inspector:gateway", "1")


def test_a_killed_services_streams_break_at_once_and_go_on_elsewhere_the_others_do_not_notice(two: Line) -> None:
    gone, stays = two.running
    places = two.places()
    mine, others = (next(id for id, node in places.items() if node == each) for each in (gone, stays))
    with two.stream(mine) as broken, two.stream(others) as whole:
        assert (broken.recv(), whole.recv()) == (gone, stays)
        two.kill(gone)
        with pytest.raises(ConnectionClosed):
            broken.recv(patience.SECONDS)
        with two.stream(mine) as again:
            assert again.recv() == stays
        whole.send(b"still here")
        assert whole.recv() == b"still here"


def test_who_is_not_ready_gets_nothing_new_and_keeps_its_streams(two: Line) -> None:
    tired, fresh = two.running
    mine = next(id for id, node in two.places().items() if node == tired)
    with two.stream(mine) as stream:
        stream.recv()
        patience.post(f"http://{tired}:{two.front.port}/ready/false").raise_for_status()
        two.until(lambda: {*two.places().values()} == {fresh})
        stream.send(b"still here")
        assert stream.recv() == b"still here"


def test_one_more_that_the_name_server_knows_gets_a_share_and_the_rest_stays(two: Line) -> None:
    before = two.places()
    third = two.start(2)
    after = two.places()
    assert {after[id] for id in IDS if after[id] != before[id]} == {third}
    two.front.names.addresses.remove(third)
    two.until(lambda: third not in two.places().values())
    assert two.places() == before


def test_where_no_service_is_that_is_told_as_a_problem(tmp_path: Path) -> None:
    with line(tmp_path, 0) as empty:
        told = empty.ask("GET", "/v1/products")
    assert (told["status"], told["type"], told["retry"]) == (503, "urn:inspector:gateway", "1")
