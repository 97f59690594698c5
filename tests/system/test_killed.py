"""The service is killed in the middle of its work, again and again: nothing that was told is lost, nothing hangs.

Twenty kills, by hand: INSPECTOR_KILLS=20 python -m pytest tests/system/test_killed.py
"""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx2
import pytest

from inspector.recording import SweepReader
from tests import patience
from tests.api.stations import PRODUCT, frames, picture, taught
from tests.system.serving import Served, serve

KILLS = int(os.environ.get("INSPECTOR_KILLS", "3"))
LINES = 3
FLUSHED_SECONDS = 2.0
"""Recordings are brought to the disk every second, on a machine that has a processor for whoever wants one."""


@dataclass
class Line:
    """A line that inspects one part after the other until the service is gone, and notes what it was told."""

    url: str
    number: int
    begun: list[str] = field(default_factory=list[str])
    digests: dict[str, str] = field(default_factory=dict[str, str])
    answered: dict[str, list[float]] = field(default_factory=dict[str, list[float]])
    refused: list[str] = field(default_factory=list[str])

    def run(self) -> None:
        with suppress(httpx2.TransportError), httpx2.Client(base_url=self.url, timeout=patience.SECONDS) as client:
            while True:
                self._part(client)

    def _part(self, client: httpx2.Client) -> None:
        asked = {"product_id": PRODUCT, "part_id": f"{self.number}-{len(self.begun)}"}
        inspection = self._ok(client.post("/v1/inspections", json=asked))["inspection_id"]
        self.begun.append(inspection)
        self.answered[inspection] = []
        path = f"/v1/inspections/{inspection}"
        jpeg = {"content-type": "image/jpeg"}
        for frame in frames():
            numbers = {"t_ns": frame.t_ns, "sequence": frame.sequence}
            self._ok(client.post(f"{path}/frames", params=numbers, content=picture(frame), headers=jpeg))
            self.answered[inspection].append(time.monotonic())
            # As a camera would, slowly enough that a kill finds several parts half done.
            time.sleep(0.02)
        self.digests[inspection] = self._ok(client.post(f"{path}/conclude"))["digest"]

    def _ok(self, answer: httpx2.Response) -> Any:
        if answer.status_code >= 400:
            self.refused.append(answer.text)
        return answer.raise_for_status().json()


def killed(served: Served, seconds: float, *, everybody: bool, wait_for_one: bool) -> tuple[list[Line], float]:
    """Lines at work for so long; then the service is killed, with its scorers or without.

    Told is, too, since when what was answered may not be on the disk.
    """
    frames()
    lines = [Line(served.url, number) for number in range(LINES)]
    threads = [threading.Thread(target=line.run) for line in lines]
    for thread in threads:
        thread.start()
    if wait_for_one:
        patience.until(lambda: any(line.digests for line in lines))
    time.sleep(seconds)
    flushed = time.monotonic() - FLUSHED_SECONDS * patience.crowded()
    if everybody:
        os.killpg(served.process.pid, signal.SIGKILL)
    else:
        served.process.kill()
    served.process.wait()
    for thread in threads:
        thread.join(patience.SECONDS)
    return lines, flushed


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return taught(tmp_path / "data")


def test_after_a_kill_nothing_that_was_told_is_lost_and_nothing_hangs(data: Path):
    moments = random.Random(7)
    told: dict[str, str] = {}
    for number in range(KILLS):
        with serve(data) as served:
            lines, flushed = killed(served, moments.uniform(0.5, 4), everybody=number % 2 == 0, wait_for_one=not told)
        assert [said for line in lines for said in line.refused] == []
        for line in lines:
            told |= line.digests
        with serve(data) as served, httpx2.Client(base_url=served.url, timeout=patience.SECONDS) as client:
            assert client.get("/v1/inspections?state=processing").json()["items"] == []
            for inspection, digest in told.items():
                assert client.get(f"/v1/inspections/{inspection}/result").json()["digest"] == digest
            for line in lines:
                for inspection in line.begun:
                    check(client, data, inspection, line, flushed)
    assert told


def check(client: httpx2.Client, data: Path, inspection: str, line: Line, flushed: float) -> None:
    """It ended one way or the other, and what should be on the disk is."""
    known = client.get(f"/v1/inspections/{inspection}").json()
    times = line.answered[inspection]
    safe = len(times) if inspection in line.digests else sum(each < flushed for each in times)
    if inspection in line.digests:
        assert known["state"] == "completed"
    else:
        # Concluded just now and not told, or aborted by the next start.
        assert known["state"] in ("completed", "aborted")
    assert known["recording"] in ("kept", "none")
    path = data / "inspections" / f"{inspection}.mcap"
    if known["recording"] == "none" or not safe:
        assert not safe
        return
    recorded = [(frame.sequence, frame.encoded.data if frame.encoded else b"") for frame in SweepReader(path)]
    assert len(recorded) >= safe
    assert recorded == [(frame.sequence, picture(frame)) for frame in frames()[: len(recorded)]]
