"""A station with a product that is learnt, for the tests of the service; learnt once per process of the tests."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import struct
import tempfile
import time
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from fastapi.testclient import TestClient

from inspector.cameras import open_camera
from inspector.learner import learn_recordings
from inspector.pictures import encode_jpeg
from inspector.protocol import SentFrame
from inspector.recorder import record
from inspector.recording import SweepReader
from inspector.service.files import Files
from inspector.service.folder import DataFolder
from inspector.stores import open_store
from inspector.stores.records import StoredAppearance
from models.appearance import Appearance
from models.frame import Frame
from models.verdict import Policy

LINE = "simulated:?frames=40&size=240x180&part=plate&path=line"
GOOD, BAD = "unit=3&seed=3", "unit=2&seed=2&defect=extra&at=0.3"
PRODUCT, PART = "plate", "0007"


@cache
def material() -> Path:
    """A folder with `golden.mcap`, and what was learnt from it as `plate.appearance`."""
    folder = Path(tempfile.mkdtemp(prefix="station-"))
    with open_camera(f"{LINE}&unit=1&seed=1") as camera:
        record(camera, folder / "golden.mcap", lossless=True)
    learn_recordings([folder / "golden.mcap"], folder / "plate.appearance")
    return folder


@cache
def learnt() -> Appearance:
    return Appearance.from_bytes((material() / "plate.appearance").read_bytes())


def sweep(options: str = BAD) -> Path:
    """A recording of one part."""
    path = material() / f"{options}.mcap"
    if not path.exists():
        with open_camera(f"{LINE}&{options}") as camera:
            record(camera, path, lossless=True)
    return path


@cache
def frames(options: str = BAD) -> tuple[Frame, ...]:
    return tuple(SweepReader(sweep(options)))


def picture(frame: Frame) -> bytes:
    return (frame.encoded or encode_jpeg(frame.pixels)).data


def bomb(width: int, height: int) -> bytes:
    """A small PNG that announces so many pixels."""

    def part(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pixels = zlib.compress(bytes(min((width + 1) * height, 1 << 20)))
    return b"\x89PNG\r\n\x1a\n" + part(b"IHDR", header) + part(b"IDAT", pixels) + part(b"IEND", b"")


def sent(frame: Frame) -> bytes:
    """The frame as a binary message."""
    return SentFrame(frame.sequence, frame.t_ns, frame.encoder, picture(frame)).to_bytes()


def teach(service: Any, policy: Policy = Policy()) -> str:  # noqa: B008 (a frozen value)
    """The product is there, learnt, with an active recipe, whose id is returned."""
    path = Files(service.folder).local_appearance(learnt().id)
    if not path.exists():
        shutil.copy(material() / "plate.appearance", path)
    store, now = service.store, service.now_ns()
    store.ensure_product(PRODUCT, now)
    store.add_appearance(StoredAppearance(learnt().id, PRODUCT, now, (), {}, (), path.stat().st_size))
    recipe_id = f"r{now}"
    store.add_recipe(recipe_id, PRODUCT, learnt().id, asdict(policy), actor="test", t_ns=now)
    return recipe_id


def taught(data: Path, database: str | None = None) -> Path:
    """The folder of a service that does not run yet, in which the product is learnt; a database may be named."""
    with closing(DataFolder(data)) as folder, open_store(database or f"sqlite:{data / 'service.sqlite'}") as store:
        teach(SimpleNamespace(folder=folder, store=store, now_ns=time.time_ns))
    return data


def came_out(
    store: Any,
    recipe_id: str,
    verdicts: Sequence[str],
    *,
    moved_since: int,
    begun_ns: int,
    every_ns: int,
    first: int = 0,
) -> list[str]:
    """Parts stored as if they had been inspected; since one of them scores are higher from s = 0.48 to 0.54.

    They are numbered from `first`.
    """
    found = list[str]()
    for number, verdict in enumerate(verdicts, first):
        inspection_id, begun = f"part{number:03}", begun_ns + number * every_ns
        store.begin_inspection(
            inspection_id, PRODUCT, part_id=f"{number:04}", recipe_id=recipe_id, appearance_id=learnt().id, policy={},
            begun_ns=begun, source="live", is_simulated=False, recording="none",
        )  # fmt: skip
        score = 0.3 + 0.001 * (number % 7)
        profile = [score + 0.4 * (number >= moved_since and 24 <= bin <= 26) for bin in range(50)]
        store.conclude_inspection(
            inspection_id, "completed", verdict=verdict, ended_ns=begun + every_ns,
            result={"profile": profile}, scores=b"",
        )  # fmt: skip
        found.append(inspection_id)
    return found


def copied(data: Path, inspection_id: str, count: int) -> None:
    """That inspection over and over, as parts 00001, 00002, …, every fiftieth NG: without scores and recordings."""
    told = {
        "inspection_id": "printf('copy%05d', k)",
        "part_id": "printf('%05d', k)",
        "verdict": "CASE WHEN k % 50 = 7 THEN 'NG' ELSE 'OK' END",
        "begun_ns": "begun_ns + k",
        "recording": "'none'",
    }
    with closing(sqlite3.connect(data / "service.sqlite", timeout=30)) as database, database:
        known = [str(row[1]) for row in database.execute("PRAGMA table_info(inspections)")]
        names = [name for name in known if name != "number"]
        database.execute(
            f"WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n WHERE k < {count}) "
            f"INSERT INTO inspections ({', '.join(names)}) "
            f"SELECT {', '.join(told.get(name, name) for name in names)} FROM inspections, n "
            "WHERE inspection_id = ? ORDER BY k",
            [inspection_id],
        )


def remove_scores(data: Path, inspection_id: str) -> None:
    """Of an inspection that has ended, as housekeeping would in time."""
    with closing(sqlite3.connect(data / "service.sqlite", timeout=30)) as database, database:
        database.execute("DELETE FROM scores WHERE inspection_id = ?", [inspection_id])
        since = "UPDATE inspections SET scores_removed_ns = ? WHERE inspection_id = ?"
        database.execute(since, [time.time_ns(), inspection_id])


@contextmanager
def standing(service: Any) -> Iterator[None]:
    """Its scorers stand still meanwhile: what is sent waits."""
    scorers = [scorer.pid for scorer in service.inspections.pool.scorers]
    for scorer in scorers:
        os.kill(scorer, signal.SIGSTOP)
    try:
        yield
    finally:
        for scorer in scorers:
            os.kill(scorer, signal.SIGCONT)


def begin(client: TestClient, part: str = PART) -> str:
    answer = client.post("/v1/inspections", json={"product_id": PRODUCT, "part_id": part})
    assert answer.status_code == 201, answer.text
    return answer.json()["inspection_id"]


def post(client: TestClient, inspection: str, frame: Frame, **changes: Any) -> Any:
    """One frame by REST."""
    numbers = {"t_ns": frame.t_ns, "sequence": frame.sequence, "encoder": frame.encoder} | changes
    asked = {name: value for name, value in numbers.items() if value is not None}
    jpeg = {"content-type": "image/jpeg"}
    return client.post(f"/v1/inspections/{inspection}/frames", params=asked, content=picture(frame), headers=jpeg)


def feed(client: TestClient, inspection: str, those: Iterable[Frame] | None = None) -> None:
    for frame in frames() if those is None else those:
        assert post(client, inspection, frame).status_code == 200


class Stream:
    """A client of the stream that keeps every message."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.said: list[dict[str, Any]] = []

    def hear(self, kind: str) -> dict[str, Any]:
        """The next message of that kind; those before it are kept."""
        while True:
            self.said.append(json.loads(self.socket.receive_text()))
            if self.said[-1]["kind"] == kind:
                return self.said[-1]

    def kinds(self, *kinds: str) -> list[dict[str, Any]]:
        return [each for each in self.said if each["kind"] in kinds]
