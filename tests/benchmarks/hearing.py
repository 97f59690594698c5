"""What does it cost that every service tells what happens at all of them? Notifications, bytes and processor time.

    python -m tests.benchmarks.hearing --services 2 --cameras 12 --seconds 20 [--listening] [--pictures BYTES]

Starts a PostgreSQL server and so many processes, each with `Peers`, `Events` and inspections that are told as those of
cameras at 30 frames a second are, four times a second; nothing is scored. `--listening`: somebody listens at each.
`--pictures`: and looks at all pictures, of so many bytes.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import time
from collections import Counter
from contextlib import ExitStack, suppress
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from inspector.service.events import EVERY, Events
from inspector.service.peers import Peers
from inspector.stores import AbstractStore, open_store
from tests.postgresql import server

_TICK = os.sysconf("SC_CLK_TCK")


def counted(store: AbstractStore, counts: Counter[str]) -> None:
    """Count what the store tells."""
    tell: Any = store.tell

    def told(body: bytes, to: Any = None) -> None:
        kind = "pictures" if b'"do":"picture"' in body[:200] else "messages"
        counts[kind] += 1
        counts[f"{kind}, bytes"] += len(body)
        tell(body, to)

    store.tell = told  # pyright: ignore[reportAttributeAccessIssue]


async def work(url: str, asked: argparse.Namespace, pipe: Any) -> None:
    """One service. `pipe` is a connection to the process that started this one."""
    cameras, seconds, pictures = asked.cameras, asked.seconds, asked.pictures
    counts: Counter[str] = Counter()
    store = await asyncio.to_thread(open_store, url)
    counted(store, counts)
    events = Events()
    peers = Peers(store, events)
    events.start()
    await peers.start()
    with ExitStack() as stack:
        if asked.listening or pictures:
            stack.enter_context(events.listening(EVERY if pictures else None))
        pipe.send("ready")
        await asyncio.to_thread(pipe.recv)
        await asyncio.sleep(2)
        counts.clear()
        first, cpu, start = events.changes, time.process_time(), time.perf_counter()
        picture = json.dumps({"inspection_id": "0" * 32, "picture": "x" * (pictures * 4 // 3)})
        frame = 0
        while time.perf_counter() - start < seconds:
            frame += 1
            for camera in range(cameras):
                names = {"inspection_id": f"{os.getpid():016x}{camera:016x}", "product_id": "plate"}
                frames = [[8 * frame + k, 0.123456 + k / 1000, 0.654321, "scored"] for k in range(7 + frame % 2)]
                events.publish("scores", **names, frames=frames, dropped=0, lost=0)
                if pictures:
                    events.show(f"i{camera}", picture)
                if (frame + 7 * camera) % 80 == 0:
                    events.publish("verdict", **names, verdict="OK", deviations=[])
                    events.publish("begun", **names, part_id="0001", recipe_id="0" * 32, appearance_id="0" * 71)
            await asyncio.sleep(0.25)
        took = time.perf_counter() - start
        told = {name: value / took for name, value in counts.items()}
        pipe.send({"cpu": (time.process_time() - cpu) / took, "events": (events.changes - first) / took, **told})
        await asyncio.to_thread(pipe.recv)
    await peers.stop()
    store.close()


def run(url: str, asked: argparse.Namespace, pipe: Any) -> None:
    asyncio.run(work(url, asked, pipe))


def database_seconds(folder: Path) -> float:
    """Processor time of all processes of the server that has this folder, those that have ended, too."""
    postmaster = int((folder / "data" / "postmaster.pid").read_text().split()[0])
    total = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            if postmaster in (int(stat.parent.name), int(fields[1])):
                total += int(fields[11]) + int(fields[12])
            if int(stat.parent.name) == postmaster:
                total += int(fields[13]) + int(fields[14])
    return total / _TICK


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--services", type=int, default=2)
    parser.add_argument("--cameras", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--listening", action="store_true")
    parser.add_argument("--pictures", type=int, default=0)
    asked = parser.parse_args()
    context = multiprocessing.get_context("spawn")
    with server() as postgresql:
        url = postgresql.new_database()
        open_store(url).close()
        pipes: list[Any] = []
        services: list[BaseProcess] = []
        for _ in range(asked.services):
            mine, its = context.Pipe()
            service = context.Process(target=run, args=(url, asked, its))
            service.start()
            pipes.append(mine)
            services.append(service)
        for pipe in pipes:
            pipe.recv()
        before, start = database_seconds(postgresql.folder), time.perf_counter()
        for pipe in pipes:
            pipe.send("go")
        told = [pipe.recv() for pipe in pipes]
        database = (database_seconds(postgresql.folder) - before) / (time.perf_counter() - start)
        for pipe in pipes:
            pipe.send("stop")
        for service in services:
            service.join()
    for name in dict.fromkeys(name for each in told for name in each):
        values = [each.get(name, 0.0) for each in told]
        print(f"{name:>20}: {sum(values) / len(values):10.4f} a second, each service")
    print(f"{'database, cpu':>20}: {database:10.4f} a second")


if __name__ == "__main__":
    main()
