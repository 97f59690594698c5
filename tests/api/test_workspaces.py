"""Workspaces over HTTP: uploaded or learnt, a picture located as on the command line, a part tracked on a stream."""

from __future__ import annotations

import io
import json
import os
import signal
import zipfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from starlette.testclient import WebSocketDenialResponse

from api.app import create_app
from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.cameras.simulated.canvas import HEIGHT, WIDTH
from inspector.cameras.simulated.render import Pose
from inspector.following import learn_displacements
from inspector.labels import read_labels
from inspector.pictures import encode_png
from inspector.protocol import SentFrame
from inspector.settings import read_settings
from inspector.workspaces import learn_labels, located_record
from models.frame import Frame
from models.workspace import Workspace
from tests.api.stations import Stream, begin, bomb, feed, frames, learnt, sweep, teach
from tests.api.test_round import ended
from tests.inspector.test_workspaces import recorded
from tests.patience import until

BEYOND = '{"kind": "hand", "place": {"x_px": NaN, "y_px": 0}}'
JPEG = {"content-type": "image/jpeg"}
ZIP = {"content-type": "application/zip"}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    settings = read_settings(data=tmp_path_factory.mktemp("station") / "data", scorers=1)
    app = create_app(settings)
    with TestClient(app, base_url="http://127.0.0.1") as client:
        teach(app.state.service)
        yield client


@cache
def camera() -> SimulatedCamera:
    camera = open_camera("simulated:?size=160x120&seed=5")
    assert isinstance(camera, SimulatedCamera)
    return camera


@cache
def workspace() -> Workspace:
    return learn_displacements(camera())


def seen(x: float, y: float, number: int = 0, *, covered: bool = False) -> Frame:
    """A part that lies off by x and y, px of the frame."""
    return camera().look(Pose(WIDTH / 2 - 2 * x, HEIGHT / 2 - 2 * y), number, covered=covered)


def jpeg(frame: Frame) -> bytes:
    assert frame.encoded is not None
    return frame.encoded.data


@pytest.fixture(scope="module")
def uploaded(client: TestClient) -> str:
    answer = client.post("/v1/workspaces?name=jig", content=workspace().to_bytes())
    assert answer.status_code == 201, answer.text
    return answer.json()["workspace_id"]


def test_what_was_learnt_elsewhere_is_kept_listed_and_given_back(client: TestClient, uploaded: str) -> None:
    assert uploaded == workspace().id
    told = client.get(f"/v1/workspaces/{uploaded}").json()
    assert told["name"] == "jig"
    assert told["parameters"] == [{"name": "x_px", "period": None}, {"name": "y_px", "period": None}]
    assert (told["objects"], told["pictures"], told["source"]) == (["part"], 81, "upload")
    assert told in client.get("/v1/workspaces").json()["items"]
    assert client.get(f"/v1/workspaces/{uploaded}/file").content == workspace().to_bytes()
    again = client.post("/v1/workspaces?name=other", content=workspace().to_bytes())
    assert (again.status_code, again.json()) == (201, told)


def test_what_is_no_workspace_is_refused(client: TestClient) -> None:
    changed = bytearray(workspace().to_bytes())
    changed[5000] ^= 1
    damaged = client.post("/v1/workspaces", content=bytes(changed))
    assert damaged.status_code == 422
    assert damaged.json()["detail"].startswith("the workspace: the workspace is damaged")
    assert client.post("/v1/workspaces", content=b"\x89PNG\r\n and more").status_code == 415
    assert client.post("/v1/workspaces", content=b"").status_code == 415
    assert client.post("/v1/workspaces", content=b"{}", headers={"content-type": "application/json"}).status_code == 415
    assert client.get("/v1/workspaces/sha256:0").status_code == 404


def test_a_picture_is_located_as_on_the_command_line(client: TestClient, uploaded: str) -> None:
    frame = seen(3.3, -5.1)
    answer = client.post(f"/v1/workspaces/{uploaded}/locate", content=jpeg(frame), headers=JPEG)
    assert answer.status_code == 200
    assert answer.json() == located_record(workspace().locate(frame.pixels), workspace())
    assert answer.json()["q"] == pytest.approx({"x_px": 3.3, "y_px": -5.1}, abs=0.2)


def test_what_cannot_be_located_is_said(client: TestClient, uploaded: str) -> None:
    route = f"/v1/workspaces/{uploaded}/locate"
    unknown = client.post(route, content=jpeg(seen(0, 0, covered=True)), headers=JPEG).json()
    assert (unknown["object"], unknown["q"], unknown["state"]) == (None, None, "unknown")
    small = client.post(route, content=encode_png(seen(0, 0).pixels[:50]).data, headers={"content-type": "image/png"})
    assert (small.status_code, small.json()["type"]) == (422, "urn:inspector:picture-refused")
    cut = client.post(route, content=jpeg(seen(0, 0))[:-900], headers=JPEG)
    assert cut.status_code == 422
    assert client.post(route, content=b"x", headers={"content-type": "text/plain"}).status_code == 415
    nowhere = client.post("/v1/workspaces/sha256:0/locate", content=jpeg(seen(0, 0)), headers=JPEG)
    assert nowhere.status_code == 404


def labelled(folder: Path, count: int = 5) -> Path:
    """A folder of pictures on a turntable that is none, and their labels."""
    rows = ["file,object,x_px,angle_deg"]
    for x in range(2):
        for k in range(count):
            name = f"pictures/{x}-{k}.jpg"
            (folder / "pictures").mkdir(exist_ok=True)
            (folder / name).write_bytes(jpeg(seen(4 * x, 2 * k, 10 * x + k)))
            rows.append(f"{name},cup,{4 * x},{72 * k}")
    (folder / "labels.csv").write_text("\n".join(rows))
    return folder / "labels.csv"


def zipped(files: dict[str, bytes]) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return data.getvalue()


def packed(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def job(client: TestClient, answer: Any) -> dict[str, Any]:
    """As it is when it has ended."""
    assert answer.status_code == 202, answer.text
    return ended(client, answer.json()["job_id"])


def test_labelled_pictures_are_learnt_to_what_the_command_line_makes_of_them(
    client: TestClient, tmp_path: Path
) -> None:
    labels = labelled(tmp_path)
    archive = zipped({**packed(tmp_path), "__MACOSX/._labels.csv": b"x", ".DS_Store": b"x"})
    told = job(client, client.post("/v1/workspaces?periodic=angle_deg=360&name=cups", content=archive, headers=ZIP))
    assert (told["state"], told["error"], told["kind"], told["product_id"]) == ("done", None, "workspace", None)
    offline = learn_labels(read_labels(labels, {"angle_deg": 360.0}), tmp_path / "offline.workspace")
    assert told["workspace_id"] == offline.id
    stored = client.get(f"/v1/workspaces/{offline.id}").json()
    assert stored["parameters"][1] == {"name": "angle_deg", "period": 360}
    assert (stored["source"], stored["name"], stored["pictures"]) == ("pictures", "cups", 10)


def test_a_recording_that_tells_its_labels_is_learnt(client: TestClient, tmp_path: Path) -> None:
    path = recorded(tmp_path / "part.mcap", lambda x: {"object": "part", "q": {"x": x}})
    told = job(client, client.post("/v1/workspaces", content=path.read_bytes()))
    assert (told["state"], told["error"]) == ("done", None)
    offline = learn_labels(read_labels(path), tmp_path / "offline.workspace")
    assert told["workspace_id"] == offline.id
    silent = job(client, client.post("/v1/workspaces", content=sweep().read_bytes()))
    assert (silent["state"], silent["error"].partition(";")[0]) == ("failed", "the upload: nothing on /workspace/q")


def test_an_archive_reads_nothing_but_itself(client: TestClient, tmp_path: Path) -> None:
    labelled(tmp_path)
    files = packed(tmp_path)
    rows = files["labels.csv"].decode()
    outside = tmp_path / "pictures" / "0-0.jpg"
    wrong = {
        "is not in the archive": files | {"labels.csv": rows.replace("pictures/0-0.jpg", str(outside)).encode()},
        "'0-9.jpg', which is not": files | {"labels.csv": rows.replace("0-0.jpg", "0-9.jpg").encode()},
        "a file in it is called '../x.csv'": {"../x.csv": b""},
        "2 CSV files in it": files | {"more.csv": b""},
        "0 CSV files in it": {"a.jpg": b""},
        "no picture at": files | {"labels.csv": rows.rpartition("\n")[0].encode()},
    }
    for sentence, content in wrong.items():
        told = job(client, client.post("/v1/workspaces", content=zipped(content), headers=ZIP))
        assert told["state"] == "failed"
        assert sentence in told["error"]
        assert str(tmp_path.parent) not in told["error"].replace(str(outside.parent), "")
    large = zipped(files | {"pictures/0-0.jpg": bomb(60_000, 60_000)})
    told = job(client, client.post("/v1/workspaces", content=large, headers=ZIP))
    assert told["error"].startswith("pictures/0-0.jpg: ")
    assert told["error"].endswith("60000x60000 pixels announced, allowed are 64000000 in all")
    broken = job(client, client.post("/v1/workspaces", content=zipped(files)[:-300], headers=ZIP))
    assert "allowed is a ZIP archive" in broken["error"]
    wrong_period = client.post("/v1/workspaces?periodic=angle", content=zipped(files), headers=ZIP)
    assert wrong_period.status_code == 422


def tracked(client: TestClient, name: str) -> Any:
    return client.websocket_connect(f"ws://127.0.0.1/v1/workspaces/{name}/track")


def nothing_tracked(client: TestClient) -> None:
    """Connections that were closed are forgotten soon, not at once."""
    until(lambda: not [*client.app.state.service.locating.loads()])  # type: ignore[attr-defined]


def send(socket: Any, frame: Frame) -> None:
    socket.send_bytes(SentFrame(frame.sequence, frame.t_ns, None, jpeg(frame)).to_bytes())


def test_a_part_is_tracked_lost_and_found_again(client: TestClient, uploaded: str) -> None:
    with tracked(client, uploaded) as socket:
        talk = Stream(socket)
        ready = talk.hear("ready")
        assert (ready["credits"], ready["workspace_id"], ready["objects"]) == (2, uploaded, ["part"])
        for n in range(16):
            send(socket, seen(n - 8, 4 - n / 2, n, covered=8 <= n < 11))
            talk.hear("located")
    told = talk.kinds("located")
    assert [each["sequence"] for each in told] == list(range(16))
    states = [each["tracking"] for each in told]
    assert states == ["tracking"] * 8 + ["lost"] * 3 + ["recovered"] + ["tracking"] * 4
    assert told[9]["q"] is None
    assert told[9]["place"] == pytest.approx({"x_px": 1, "y_px": -0.5}, abs=0.5)
    assert told[-1]["q"] == pytest.approx({"x_px": 7, "y_px": -3.5}, abs=0.2)
    assert told[-1]["velocity"] == pytest.approx({"x_px": 30, "y_px": -15}, abs=4)


def test_a_hand_that_moves_with_the_part_says_where_it_is(client: TestClient, uploaded: str) -> None:
    with tracked(client, uploaded) as socket:
        talk = Stream(socket)
        for n in range(10):
            socket.send_json({"kind": "hand", "place": {"x_px": 3 * n, "y_px": 100}})
            send(socket, seen(1, 2, n))
            last = talk.hear("located")
    assert last["q"] == pytest.approx({"x_px": 1, "y_px": 2}, abs=0.2)
    assert last["place"] == pytest.approx({"x_px": 28, "y_px": 102}, abs=0.3)
    assert last["velocity"] == pytest.approx({"x_px": 90, "y_px": 0}, abs=5)


def test_every_frame_is_answered_and_of_too_many_the_newest_is_located(client: TestClient, uploaded: str) -> None:
    with tracked(client, uploaded) as socket:
        talk = Stream(socket)
        talk.hear("ready")
        for n in range(30):
            send(socket, seen(0, 0, n))
        send(socket, seen(0, 0, 29))
        while len(answers := talk.kinds("located", "dropped", "duplicate")) < 31:
            talk.said.append(json.loads(socket.receive_text()))
    assert sorted(each["sequence"] for each in answers if each["kind"] != "duplicate") == list(range(30))
    located = [each["sequence"] for each in answers if each["kind"] == "located"]
    assert located == sorted(located)
    assert located[-1] == 29


def test_what_is_tracked_counts_as_work_and_is_forgotten_with_its_connection(client: TestClient, uploaded: str) -> None:
    nothing_tracked(client)
    locating = client.app.state.service.locating  # type: ignore[attr-defined]
    with tracked(client, uploaded) as socket:
        talk = Stream(socket)
        for n in range(16):
            send(socket, seen(0, 0, n))
            talk.hear("located")
        ((_, share),) = locating.loads()
        assert 0 < share < 1
    nothing_tracked(client)


def test_no_more_parts_are_tracked_than_may_be(
    client: TestClient, uploaded: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing_tracked(client)
    monkeypatch.setattr(client.app.state.service.locating, "_most", 1)  # type: ignore[attr-defined]
    with tracked(client, uploaded) as socket:
        Stream(socket).hear("ready")
        with pytest.raises(WebSocketDenialResponse) as refused, tracked(client, uploaded):
            pass
    assert (refused.value.status_code, refused.value.headers["retry-after"]) == (503, "5")


def test_what_is_not_understood_is_said_and_tracking_goes_on(client: TestClient, uploaded: str) -> None:
    with tracked(client, uploaded) as socket:
        talk = Stream(socket)
        for wrong in ("conclude", '{"kind": "hand", "place": {"x_px": 1}}', BEYOND):
            socket.send_text(wrong)
            assert "is not understood" in talk.hear("problem")["detail"]
        socket.send_bytes(b"short")
        assert talk.hear("problem")["type"] == "urn:inspector:bad-frame"
        socket.send_bytes(SentFrame(0, 0, None, b"no picture").to_bytes())
        assert talk.hear("refused")["sequence"] == 0
        send(socket, seen(0, 0, 1))
        assert talk.hear("located")["tracking"] == "tracking"


def test_nothing_is_tracked_by_a_workspace_that_is_not_there(client: TestClient) -> None:
    with pytest.raises(WebSocketDenialResponse) as refused, tracked(client, "sha256:0"):
        pass
    assert refused.value.status_code == 404


def test_a_workspace_whose_file_was_damaged_is_said_before_any_frame(client: TestClient) -> None:
    other = learn_displacements(camera(), count=4)
    assert client.post("/v1/workspaces", content=other.to_bytes()).status_code == 201
    files = client.app.state.service.files  # type: ignore[attr-defined]
    files.local("workspace", other.id).write_bytes(other.to_bytes()[:-1])
    with pytest.raises(WebSocketDenialResponse) as refused, tracked(client, other.id):
        pass
    assert refused.value.status_code == 500
    assert refused.value.json()["title"] == "Stored file damaged"
    located = client.post(f"/v1/workspaces/{other.id}/locate", content=jpeg(seen(0, 0)), headers=JPEG)
    assert located.status_code == 500


def test_locating_changes_nothing_of_an_inspection(client: TestClient, uploaded: str) -> None:
    alone, beside = begin(client), begin(client)
    feed(client, alone)
    for n, frame in enumerate(frames()):
        feed(client, beside, [frame])
        assert client.post(f"/v1/workspaces/{uploaded}/locate", content=jpeg(seen(n % 8, 0)), headers=JPEG).is_success
    results = [client.post(f"/v1/inspections/{name}/conclude").json() for name in (alone, beside)]
    assert results[0]["digest"] == results[1]["digest"]
    assert results[0]["appearance_id"] == learnt().id


def test_when_the_process_ends_the_connection_is_closed_and_a_new_one_works(client: TestClient, uploaded: str) -> None:
    scorer = client.app.state.service.inspections.pool.scorers[0]  # type: ignore[attr-defined]
    with tracked(client, uploaded) as socket:
        talk = Stream(socket)
        send(socket, seen(0, 0, 0))
        talk.hear("located")
        os.kill(scorer.pid, signal.SIGKILL)
        assert socket.receive()["code"] == 1012
    until(lambda: client.post(f"/v1/workspaces/{uploaded}/locate", content=jpeg(seen(0, 0)), headers=JPEG).is_success)


def test_when_the_service_stops_connections_are_closed_and_nothing_new_is_taken(tmp_path: Path) -> None:
    app = create_app(read_settings(data=tmp_path / "data", scorers=1))
    with TestClient(app, base_url="http://127.0.0.1") as client:
        name = client.post("/v1/workspaces", content=workspace().to_bytes()).json()["workspace_id"]
        with tracked(client, name) as socket:
            Stream(socket).hear("ready")
            app.state.service.locating.stop()
            assert socket.receive()["code"] == 1012
        located = client.post(f"/v1/workspaces/{name}/locate", content=jpeg(seen(0, 0)), headers=JPEG)
        assert (located.status_code, located.json()["type"]) == (503, "urn:inspector:stopping")


def test_a_service_begins_with_workspaces_that_it_has_and_with_one_that_is_damaged(tmp_path: Path) -> None:
    settings = read_settings(data=tmp_path / "data", scorers=1)
    with TestClient(create_app(settings), base_url="http://127.0.0.1") as client:
        name = client.post("/v1/workspaces", content=workspace().to_bytes()).json()["workspace_id"]
    path = tmp_path / "data" / "workspaces" / f"{name.removeprefix('sha256:')}.workspace"
    for kept, status in ((path.read_bytes(), 200), (b"nothing", 500)):
        path.write_bytes(kept)
        with TestClient(create_app(settings), base_url="http://127.0.0.1") as client:
            located = client.post(f"/v1/workspaces/{name}/locate", content=jpeg(seen(0, 0)), headers=JPEG)
            assert located.status_code == status
            assert client.get("/readyz").status_code == 200
