"""The service is asked to stop in the middle of inspections: what is in flight is scored, the rest is told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from inspector.recording import SweepReader
from tests import patience
from tests.api.stations import PRODUCT, frames, sent, taught
from tests.patience import until
from tests.postgresql import server
from tests.system.serving import PROGRAM, serve


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return taught(tmp_path / "data")


def test_what_is_in_flight_is_scored_files_are_closed_and_the_rest_is_aborted_and_told(data: Path):
    said: list[dict[str, Any]] = []
    with serve(data) as served:
        asked = {"product_id": PRODUCT, "part_id": "half"}
        inspection = patience.post(f"{served.url}/v1/inspections", json=asked).json()["inspection_id"]
        with connect(f"{served.url.replace('http', 'ws')}/v1/inspections/{inspection}/stream") as stream:
            for frame in frames()[:20]:
                stream.send(sent(frame))
            while not any(each["kind"] == "scored" for each in said):
                said.append(json.loads(stream.recv()))
            served.process.terminate()
            with pytest.raises(ConnectionClosed) as closed:
                said += map(json.loads, iter(stream.recv, None))
        assert served.process.wait(patience.SECONDS) == 0
    scored = [each["sequence"] for each in said if each["kind"] == "scored"]
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1012
    assert said[-1]["kind"] == "aborted"
    assert said[-1]["reason"] == "the service was stopped"
    result = said[-1]["result"]
    assert (result["result_state"], result["verdict"], result["is_partial"]) == ("aborted", "INCOMPLETE", True)
    assert len(result["frames"]) == len(scored)
    assert scored == [frame.sequence for frame in frames()[: len(scored)]]
    recording = SweepReader(data / "inspections" / f"{inspection}.mcap")
    assert [frame.sequence for frame in recording] == scored
    assert recording.losses == ()
    with serve(data) as served:
        known = patience.get(f"{served.url}/v1/inspections/{inspection}/result").json()
    assert known == result


def recorded(path: Path) -> tuple[list[int], tuple[str, ...]]:
    """The frames of a recording by their numbers, and what it lacks."""
    recording = SweepReader(path)
    return [frame.sequence for frame in recording], recording.losses


def test_a_database_that_does_not_answer_does_not_hold_up_the_end(tmp_path: Path):
    """Its recording is closed all the same, and others take the inspection when the database is back."""
    impatient = f"from inspector import serving; serving.GRACE_SECONDS = 2; {PROGRAM}"
    with server() as postgresql:
        database = postgresql.new_database()
        data, told = taught(tmp_path / "data", database), list[dict[str, Any]]()
        with serve(data, program=impatient, database=database) as served:
            asked = {"product_id": PRODUCT, "part_id": "half"}
            inspection = patience.post(f"{served.url}/v1/inspections", json=asked).json()["inspection_id"]
            with connect(f"{served.url.replace('http', 'ws')}/v1/inspections/{inspection}/stream") as stream:
                for frame in frames()[:20]:
                    stream.send(sent(frame))
                while {"kind": "saved", "next_sequence": 20} not in told:
                    told.append(json.loads(stream.recv()))
                with postgresql.asleep():
                    served.process.terminate()
                    with pytest.raises(ConnectionClosed):
                        told += map(json.loads, iter(stream.recv, None))
                    assert served.process.wait(patience.SECONDS) == 1
        assert "not stopped in time" in served.log.read_text()
        # Who scores outlives the service for a moment, and closes it.
        until(lambda: recorded(data / "inspections" / f"{inspection}.mcap") == ([*range(20)], ()), served.log.read_text)
        with serve(data, database=database) as served:
            assert patience.post(f"{served.url}/v1/inspections/{inspection}/conclude").json()["frames_scored"] == 20
