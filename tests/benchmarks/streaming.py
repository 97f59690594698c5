"""How many cameras can one service hold, and what does serving cost beside scoring?

Run by hand, on an otherwise idle machine: python -m tests.benchmarks.streaming [--seconds 60] [--streams 8 12]

A service (`inspector serve`) and the clients are processes of their own. Every camera sends 320x240 JPEGs at 30 frames
a second over a WebSocket of its own, in sweeps of nine seconds, one part after the other, whatever the service answers.
Counted is what became of every frame, and how long it took from the last byte sent to the score received, the
client's own delays included. Then one stream comes as fast as its credits allow, to a service that has one core for all
its processes; its rate is compared with decoding and scoring the same frames in a bare loop on that core, in turns.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import cv2
import httpx2
from websockets.asyncio.client import connect

from inspector.cameras import open_camera
from inspector.learner import learn_recordings, load_appearance
from inspector.pictures import decode, encode_jpeg
from inspector.protocol import SentFrame
from inspector.recorder import record
from inspector.recording import SweepReader
from inspector.service.files import Files
from inspector.service.folder import DataFolder
from inspector.stores import open_store
from inspector.stores.records import StoredAppearance
from models.frame import EncodedPicture, Frame
from models.inspection import begin, conclude, step
from models.verdict import Policy

FPS = 30.0
PRODUCT = "plate"
GOLDEN = ("unit=1&seed=1", "unit=2&seed=2&place=1,-1,0.1")
PART = "unit=3&seed=13"
PATIENCE = 60.0


def prepare(folder: Path, camera_options: str = "") -> None:
    """Two golden sweeps, what is learnt of them, and the sweep that every camera sends."""
    for name, options in zip(("golden-1", "golden-2", "part"), (*GOLDEN, PART), strict=True):
        with open_camera(f"simulated:?{options}{camera_options}") as camera:
            record(camera, folder / f"{name}.mcap", lossless=True)
    learn_recordings([folder / "golden-1.mcap", folder / "golden-2.mcap"], folder / "plate.appearance")


def teach(folder: Path, data: Path, database: str | None = None) -> None:
    """A data folder, and a database, in which the product is learnt, with an active recipe."""
    appearance = load_appearance(folder / "plate.appearance")
    place, store, now = DataFolder(data), open_store(database or f"sqlite:{data / 'service.sqlite'}"), time.time_ns()
    Files(place).local_appearance(appearance.id).write_bytes(appearance.to_bytes())
    store.ensure_product(PRODUCT, now)
    store.add_appearance(StoredAppearance(appearance.id, PRODUCT, now, (), {}, (), 1))
    store.add_recipe("recipe", PRODUCT, appearance.id, asdict(Policy()), actor="benchmark", t_ns=now)
    store.close()
    place.close()


@contextmanager
def served(
    data: Path, scorers: int | None = None, *, host: str = "127.0.0.1", port: int = 0, **settings: str
) -> Generator[str]:
    """The address of a service on that folder; settings by their names in the environment."""
    if not port:
        with socket.socket() as free:
            free.bind((host, 0))
            port = free.getsockname()[1]
    data.mkdir(exist_ok=True)
    command = [sys.executable, "-c", "from inspector.cli import main; main()", "serve", "--data", str(data)]
    command += ["--host", host]
    environment = os.environ | ({"INSPECTOR_SCORERS": str(scorers)} if scorers else {}) | settings
    with (data / "log").open("w") as log:
        process = subprocess.Popen([*command, "--port", str(port)], env=environment, stdout=log, stderr=log)
    url = f"http://{host}:{port}"
    try:
        deadline = time.monotonic() + PATIENCE
        while not _ready(url):
            if time.monotonic() > deadline or process.poll() is not None:
                raise SystemExit((data / "log").read_text())
            time.sleep(0.1)
        yield url
    finally:
        process.terminate()
        process.wait(PATIENCE)


def _ready(url: str) -> bool:
    try:
        return httpx2.get(f"{url}/readyz").status_code == 200
    except httpx2.TransportError:
        return False


class Cameras:
    """So many cameras in one process; each sends what it sees, whatever the service answers."""

    def __init__(self, url: str, pictures: Sequence[bytes], seconds: float) -> None:
        self.counts: Counter[str] = Counter()
        self.verdicts: Counter[str] = Counter()
        self.latencies: list[float] = []
        self._url, self._pictures, self._seconds = url, pictures, seconds

    async def run(self, streams: int) -> dict[str, Any]:
        async with httpx2.AsyncClient(base_url=self._url, timeout=PATIENCE) as http:
            await asyncio.gather(*(self._camera(http, number, streams) for number in range(streams)))
        took = sorted(self.latencies)
        marks = {f"p{share}": 1e3 * took[int(share / 100 * (len(took) - 1))] for share in (50, 99)}
        times = {"streams": streams, **marks, "max": 1e3 * took[-1]}
        return times | {"counts": self.counts, "verdicts": self.verdicts}

    async def _camera(self, http: httpx2.AsyncClient, number: int, streams: int) -> None:
        await asyncio.sleep(number / streams / FPS)
        end = time.perf_counter() + self._seconds
        while time.perf_counter() < end:
            asked = {"product_id": PRODUCT, "part_id": f"{number}-{self.counts['parts']}"}
            answer = await http.post("/v1/inspections", json=asked)
            if answer.status_code == 503:
                self.counts["parts refused"] += 1
                await asyncio.sleep(1.0)
                continue
            begun = answer.raise_for_status().json()
            self.counts["parts"] += 1
            path = f"/v1/inspections/{begun['inspection_id']}/stream"
            async with connect(self._url.replace("http", "ws") + path, compression=None, max_size=None) as stream:
                await self._sweep(stream, end)

    async def _sweep(self, stream: Any, end: float) -> None:
        sent: dict[int, float] = {}
        hearing = asyncio.create_task(self._hear(stream, sent))
        start, start_ns = time.perf_counter(), time.time_ns()
        for number, picture in enumerate(self._pictures):
            await asyncio.sleep(max(0.0, start + number / FPS - time.perf_counter()))
            if time.perf_counter() > end:
                break
            await stream.send(SentFrame(number, start_ns + int(number / FPS * 1e9), None, picture).to_bytes())
            sent[number] = time.perf_counter()
            self.counts["sent"] += 1
        await stream.send('{"kind": "conclude"}')
        await asyncio.wait_for(hearing, PATIENCE)

    async def _hear(self, stream: Any, sent: dict[int, float]) -> None:
        async for text in stream:
            said = json.loads(text)
            if said["kind"] in ("scored", "dropped", "refused"):
                self.counts[said["kind"]] += 1
                if said["kind"] == "scored":
                    self.latencies.append(time.perf_counter() - sent[said["sequence"]])
            elif said["kind"] == "verdict":
                self.verdicts[said["result"]["verdict"]] += 1
                self.counts["dropped in results"] += said["result"]["frames_dropped"]
                return


async def flat_out(url: str, pictures: Sequence[bytes]) -> float:
    """Frames a second of one stream that comes as fast as its credits allow, from the first frame to the verdict."""
    async with httpx2.AsyncClient(base_url=url, timeout=PATIENCE) as http:
        asked = {"product_id": PRODUCT, "part_id": "fast"}
        begun = (await http.post("/v1/inspections", json=asked)).raise_for_status().json()
    path = f"/v1/inspections/{begun['inspection_id']}/stream"
    async with connect(url.replace("http", "ws") + path, compression=None, max_size=None) as stream:
        credit = json.loads(await stream.recv())["credits"]
        messages = [SentFrame(n, 1 + n * 33_000_000, None, each).to_bytes() for n, each in enumerate(pictures)]
        start, answered = time.perf_counter(), 0
        for number, message in enumerate(messages):
            while number - answered >= credit:
                answered += json.loads(await stream.recv())["kind"] == "scored"
            await stream.send(message)
        await stream.send('{"kind": "conclude"}')
        while (json.loads(await stream.recv()))["kind"] != "verdict":
            pass
        return len(pictures) / (time.perf_counter() - start)


def bare(folder: Path, pictures: Sequence[bytes]) -> float:
    """Frames a second of the scoring path in a loop: decode, step, and the verdict in the end."""
    state = begin(load_appearance(folder / "plate.appearance"))
    start = time.perf_counter()
    for number, data in enumerate(pictures):
        picture = EncodedPicture("jpeg", data)
        state, _ = step(state, Frame(decode(picture), 1 + number * 33_000_000, number, None, picture))
    conclude(state)
    return len(pictures) / (time.perf_counter() - start)


def held(url: str) -> str:
    """How often the event loop was held for more than 20 ms, of how many looks."""
    text = httpx2.get(f"{url}/metrics").text
    found = dict(re.findall(r'inspector_event_loop_held_seconds_bucket\{le="([^"]+)"\} ([\d.]+)', text))
    return f"{float(found['+Inf']) - float(found['0.02']):.0f} of {float(found['+Inf']):.0f}"


def main() -> None:
    """The tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--streams", type=int, nargs="+", default=[8, 12])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--load", nargs=2, metavar=("URL", "FOLDER"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    if asked.load:
        url, folder = asked.load
        cameras = Cameras(url, pictures_of(Path(folder)), asked.seconds)
        print(json.dumps(asyncio.run(cameras.run(asked.streams[0]))))
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        for streams in asked.streams:
            teach(folder, folder / f"data{streams}")
            with served(folder / f"data{streams}") as url:
                print(json.dumps(cameras_apart(url, folder, streams, asked.seconds) | {"loop held": held(url)}))
        rates = one_core(folder, asked.rounds)
    for loop, stream in rates:
        print(f"bare loop {loop:.0f} frames/s, the service on that core {stream:.0f} frames/s: {stream / loop:.2f}")
    print(f"median ratio {median(stream / loop for loop, stream in rates):.2f}")


def one_core(folder: Path, rounds: int) -> list[tuple[float, float]]:
    """Rates of the bare loop and of all of the service, both on the same core, the client on another."""
    core, other, *_ = sorted(os.sched_getaffinity(0))
    pictures, rates = pictures_of(folder), list[tuple[float, float]]()
    teach(folder, folder / "one")
    os.sched_setaffinity(0, {core})
    with served(folder / "one", scorers=1) as url:
        for _ in range(rounds):
            os.sched_setaffinity(0, {core})
            loop = bare(folder, pictures)
            os.sched_setaffinity(0, {other})
            rates.append((loop, asyncio.run(flat_out(url, pictures))))
    return rates


def pictures_of(folder: Path) -> list[bytes]:
    """What every camera sees."""
    return [(frame.encoded or encode_jpeg(frame.pixels)).data for frame in SweepReader(folder / "part.mcap")]


def cameras_apart(url: str, folder: Path, streams: int, seconds: float) -> dict[str, Any]:
    """The cameras in a process of their own."""
    command = [sys.executable, "-m", "tests.benchmarks.streaming", "--load", url, str(folder)]
    asked = ["--seconds", str(seconds), "--streams", str(streams)]
    done = subprocess.run([*command, *asked], stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


if __name__ == "__main__":
    main()
