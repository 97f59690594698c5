"""Another part under the camera: told while the sweep runs, which one it is, and the same by replay and offline."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from inspector.cameras import open_camera
from inspector.learner import learn_recordings, load_appearance
from inspector.others import Others
from inspector.pictures import decode, encode_jpeg
from inspector.recorder import record
from inspector.recording import SweepReader
from inspector.replay import replay
from inspector.result_json import result_record
from inspector.service.events import Events
from inspector.settings import read_settings
from inspector.stores.records import StoredAppearance
from models.frame import EncodedPicture, Frame
from models.verdict import Policy
from tests.api.stations import GOOD, LINE, Stream, begin, feed, frames, learnt, picture, sent, teach

OTHER = "casting"
HERE = "http://127.0.0.1"


@cache
def casting() -> Path:
    """A folder with another product: `golden.mcap`, `casting.appearance`, and `part.mcap`, which is one."""
    folder = Path(tempfile.mkdtemp(prefix="another-"))
    for name, options in (("golden", "unit=1&seed=1"), ("part", GOOD)):
        with open_camera(f"{LINE.replace('plate', OTHER)}&{options}") as camera:
            record(camera, folder / f"{name}.mcap", lossless=True)
    learn_recordings([folder / "golden.mcap"], folder / "casting.appearance")
    return folder


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    app = create_app(read_settings(data=tmp_path_factory.mktemp("station") / "data", scorers=1))
    with TestClient(app, base_url=HERE) as client:
        service = app.state.service
        teach(service)
        path = casting() / "casting.appearance"
        known = load_appearance(path).id
        shutil.copy(path, service.files.local_appearance(known))
        now = service.now_ns()
        service.store.ensure_product(OTHER, now)
        service.store.add_appearance(StoredAppearance(known, OTHER, now, (), {}, (), path.stat().st_size))
        service.store.add_recipe("rc", OTHER, known, asdict(Policy()), actor="test", t_ns=now)
        yield client


def streamed(client: TestClient, those: list[Frame]) -> tuple[str, Stream, dict[str, Any]]:
    """Frame by frame, each answered before the next one comes, and what is said once the part is known."""
    inspection = begin(client)
    with client.websocket_connect(f"ws://127.0.0.1/v1/inspections/{inspection}/stream") as socket:
        talk = Stream(socket)
        talk.hear("ready")
        for each in those:
            socket.send_bytes(sent(each))
            talk.hear("scored")
        socket.send_json({"kind": "conclude"})
        result = talk.hear("verdict")["result"]
    return inspection, talk, result


def offline(recording: Path) -> dict[str, Any]:
    others = Others().of({OTHER: casting() / "casting.appearance"})
    return result_record(replay(SweepReader(recording), learnt(), others=others).result, {}, is_simulated=True)


def test_another_part_is_told_early_by_its_name_and_alike_by_every_way(client: TestClient):
    inspection, talk, result = streamed(client, list(SweepReader(casting() / "part.mcap")))
    (early,) = talk.kinds("early_invalid")
    assert early["index"] < 40 / 6
    assert "another part" in early["reason"]
    (named,) = talk.kinds("recognised")
    assert (named["part"], named["turned"]) == (OTHER, False)
    assert result["verdict"] == "INVALID"
    assert result["recognised"]["part"] == OTHER
    assert result["reasons"][0] == named["sentence"]
    stored = client.get(f"/v1/inspections/{inspection}/result").json()
    again = client.post("/v1/replays", json={"inspection_id": inspection}).json()
    alone = offline(casting() / "part.mcap")
    for each in (stored, again, alone):
        for name in ("verdict", "reasons", "recognised", "digest"):
            assert each[name] == result[name], name


def test_a_part_upside_down_is_told_so(client: TestClient):
    turned: list[Frame] = []
    for number, each in enumerate(reversed(frames(GOOD))):
        pixels = cv2.rotate(decode(EncodedPicture("jpeg", picture(each))), cv2.ROTATE_180)
        turned.append(Frame(pixels, frames(GOOD)[number].t_ns, number, encoded=encode_jpeg(pixels)))
    _, talk, result = streamed(client, turned)
    assert len(talk.kinds("early_invalid")) == 1
    assert (result["verdict"], result["recognised"]["part"], result["recognised"]["turned"]) == ("INVALID", None, True)
    assert "upside down" in result["reasons"][0]


def test_dashboards_are_told(client: TestClient, monkeypatch: pytest.MonkeyPatch):
    told: dict[str, dict[str, Any]] = {}
    publish = Events.publish

    def heard(events: Events, kind: str, **facts: Any) -> None:
        told[kind] = facts
        publish(events, kind, **facts)

    monkeypatch.setattr(Events, "publish", heard)
    inspection, _, _ = streamed(client, list(SweepReader(casting() / "part.mcap")))
    assert told["early_invalid"]["inspection_id"] == told["recognised"]["inspection_id"] == inspection
    assert OTHER in told["recognised"]["sentence"]


def test_the_right_part_is_not_doubted_and_an_aborted_one_is_not_named(client: TestClient):
    _, talk, result = streamed(client, list(frames(GOOD)))
    assert talk.kinds("early_invalid", "recognised", "part_found") == []
    assert (result["verdict"], result["recognised"]) == ("OK", None)
    inspection = begin(client)
    feed(client, inspection, list(SweepReader(casting() / "part.mcap"))[:10])
    client.post(f"/v1/inspections/{inspection}/abort", json={"reason": "the line stopped"})
    aborted = client.get(f"/v1/inspections/{inspection}/result").json()
    assert (aborted["result_state"], aborted["recognised"]) == ("aborted", None)
