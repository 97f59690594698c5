"""`inspector push`: a recording to a service and its verdict back; exit codes; one line where it cannot be."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from inspector.cli import run
from inspector.pictures import encode_png
from inspector.recording import SweepReader, SweepWriter
from inspector.replay import replay
from models.frame import Frame
from tests import patience
from tests.api.stations import GOOD, PART, PRODUCT, frames, learnt, sweep, teach
from tests.inspector.client.served import BrokenWay, served
from tests.inspector.line import cut

Captured = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("station") / "data") as (url, service):
        teach(service)
        yield url


def pushed(capsys: Captured, path: Path, url: str, *options: object) -> tuple[int, str, str]:
    """Exit code, stdout, stderr."""
    capsys.readouterr()
    asked = ["push", path, "--url", url, "--product", PRODUCT, "--part", PART, *options]
    code = run([str(each) for each in asked])
    return code, *capsys.readouterr()


def respaced(path: Path, interval_ns: int) -> Path:
    """The bad part, swept at another pace."""
    with SweepWriter(path) as writer:
        for number, frame in enumerate(frames()):
            writer.write(replace(frame, t_ns=frames()[0].t_ns + number * interval_ns))
    return path


@pytest.mark.parametrize("way", ["ws", "rest"])
def test_it_prints_what_replay_prints_and_writes_the_result_of_the_service(
    url: str, way: str, tmp_path: Path, capsys: Captured
) -> None:
    path, out = respaced(tmp_path / "part.mcap", 1_000_000), tmp_path / "part.json"
    code, pushed_out, err = pushed(capsys, path, url, "--transport", way, "--json", out)
    assert (code, err) == (0, "")
    assert run(["replay", str(path), "--appearance", str(_learnt(tmp_path))]) == 0
    assert pushed_out == capsys.readouterr().out
    record = json.loads(out.read_text())
    assert record["digest"] == replay(SweepReader(path), learnt()).result.digest
    assert (record["part_id"], record["is_simulated"], record["verdict"]) == (PART, False, "NG")
    assert len(record["frames"]) == len(frames())
    code, said, err = pushed(capsys, path, url, "--json", out)
    assert (code, said, err) == (1, "", f"inspector: {out} exists already; name another file, or remove it first\n")


def _learnt(folder: Path) -> Path:
    (folder / "plate.appearance").write_bytes(learnt().to_bytes())
    return folder / "plate.appearance"


def test_only_who_asks_hears_of_a_verdict_by_the_exit_code(url: str, capsys: Captured) -> None:
    flat_out = ("--pace", "flat-out")
    assert pushed(capsys, sweep(), url, *flat_out)[0] == 0
    assert pushed(capsys, sweep(), url, *flat_out, "--fail-on-ng")[0] == 3
    assert pushed(capsys, sweep(GOOD), url, *flat_out, "--fail-on-ng")[0] == 0


def test_what_the_recording_has_lost_is_a_warning(url: str, tmp_path: Path, capsys: Captured) -> None:
    path = cut(sweep(), tmp_path / "cut.mcap", 0.6)
    code, out, err = pushed(capsys, path, url, "--pace", "flat-out")
    assert code == 0
    assert out.startswith(f"{path}: INCOMPLETE\n")
    assert err.startswith(f"inspector: warning: {path}: ")


def test_what_the_service_could_not_use_is_a_warning(url: str, tmp_path: Path, capsys: Captured) -> None:
    path = tmp_path / "odd.mcap"
    with SweepWriter(path) as writer:
        for number, frame in enumerate(frames()):
            small = frame.pixels[:90]
            odd = Frame(small, frame.t_ns, frame.sequence, encoded=encode_png(small))
            writer.write(odd if number in (3, 4) else frame)
    code, out, err = pushed(capsys, path, url, "--pace", "flat-out")
    assert code == 0
    assert "2 dropped" in out
    assert err.startswith(f"inspector: warning: {path}: 2 frames were refused by the service; the first: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--product", "nothing"), "Not found: "),
        (("--recipe", "none"), "Not found: "),
        (("--url", "http://127.0.0.1:1"), "http://127.0.0.1:1 does not answer: "),
        (("--url", "station"), "url 'station' cannot be sent: allowed is http://HOST:PORT"),
        (("--topic", "/other"), "no pictures on topic /other"),
    ],
)
def test_what_cannot_be_is_one_line(url: str, options: tuple[str, ...], said: str, capsys: Captured) -> None:
    code, out, err = pushed(capsys, sweep(), url, *options)
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert said in err


def test_what_is_no_recording_begins_nothing(url: str, tmp_path: Path, capsys: Captured) -> None:
    (tmp_path / "a.mcap").write_bytes(b"nothing")
    before = _inspections(url)
    assert pushed(capsys, tmp_path / "a.mcap", url)[0] == 1
    assert _inspections(url) == before


def test_wrong_usage_is_2(url: str, capsys: Captured) -> None:
    assert pushed(capsys, sweep(), url, "--transport", "pigeon")[0] == 2
    assert run(["push", str(sweep()), "--url", url, "--product", PRODUCT]) == 2


def test_the_token_of_the_environment_is_shown(
    tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(tmp_path / "data", require_token=True) as (url, service):
        teach(service)
        code, _, err = pushed(capsys, sweep(), url)
        assert code == 1
        assert "No valid token" in err
        monkeypatch.setenv("INSPECTOR_TOKEN", service.access.make("line", "operator", "test")[1])
        assert pushed(capsys, sweep(), url, "--pace", "flat-out")[0] == 0


def test_a_way_that_breaks_is_nothing_to_talk_about(url: str) -> None:
    with BrokenWay(url, seed=4, most=80_000) as road:
        process = started(sweep(), road.url, "--part", "broken", "--pace", "flat-out")
        out, err = process.communicate(timeout=600)
    assert road.breaks > 3
    assert (process.returncode, err) == (0, "")
    assert f"digest {replay(SweepReader(sweep()), learnt()).result.digest}\n" in out


def started(path: Path, url: str, *options: str) -> subprocess.Popen[str]:
    # Where the tests run in the background, Ctrl-C is ignored, and processes inherit that.
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{heard}; from inspector.cli import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, "push", path, "--url", url, "--product", PRODUCT, *options],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )


def test_ctrl_c_aborts_the_inspection_and_says_so(url: str, tmp_path: Path) -> None:
    # At its own pace this sweep takes an hour.
    path = respaced(tmp_path / "slow.mcap", 90_000_000_000)
    process = started(path, url, "--part", "slow")
    try:
        while not (mine := [each for each in _inspections(url) if each["part_id"] == "slow" and each["frames_scored"]]):
            assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=600)
    finally:
        process.kill()
        process.communicate()
    inspection_id = mine[0]["inspection_id"]
    warning = f"inspector: warning: interrupted; inspection {inspection_id} is aborted at the service\n"
    assert (process.returncode, out, err) == (130, "", warning)
    ended = patience.get(f"{url}/v1/inspections/{inspection_id}").json()
    assert (ended["state"], ended["reason"]) == ("aborted", "interrupted at the line")


def _inspections(url: str) -> list[dict[str, object]]:
    return patience.get(f"{url}/v1/inspections").json()["items"]
