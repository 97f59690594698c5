"""What do twenty open dashboards cost the line?

Run by hand, on an otherwise idle machine: python -m tests.benchmarks.watching [--dashboards 20] [--streams 8]

The cameras of `streaming.py`, with and without dashboards, in turns. A dashboard does what the page does: it listens to
events and fetches the latest picture of every running inspection, as often as the service allows. All dashboards are
one process; what browsers need to draw is not the service's, and not counted.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import subprocess
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

import cv2
import httpx2

from tests.benchmarks.streaming import PATIENCE, cameras_apart, prepare, served, teach


class Dashboard:
    """One open page."""

    def __init__(self, http: httpx2.AsyncClient) -> None:
        self.events = self.pictures = 0
        self._http = http
        self._running: set[str] = set()
        self._rate = 1.0

    async def watch(self) -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(self._listen())
            group.create_task(self._look())

    async def _listen(self) -> None:
        kind = ""
        async with self._http.stream("GET", "/v1/events", timeout=None) as answer:
            async for line in answer.aiter_lines():
                name, _, value = line.partition(": ")
                if name == "event":
                    kind = value
                elif name == "data":
                    self._hear(kind, json.loads(value))

    def _hear(self, kind: str, data: dict[str, object]) -> None:
        self.events += 1
        if kind == "station" and isinstance(rate := data.get("pictures_per_second"), int | float):
            self._rate = float(rate)
        if kind == "begun":
            self._running.add(str(data["inspection_id"]))
        if kind in ("verdict", "aborted"):
            self._running.discard(str(data["inspection_id"]))

    async def _look(self) -> None:
        while True:
            for inspection in [*self._running]:
                self.pictures += (await self._http.get(f"/v1/inspections/{inspection}/picture")).status_code == 200
            await asyncio.sleep(1 / self._rate)


async def watch(url: str, count: int) -> None:
    """So many dashboards, until this process is ended."""
    limits = httpx2.Limits(max_connections=None)
    async with httpx2.AsyncClient(base_url=url, timeout=PATIENCE, limits=limits) as http:
        await asyncio.gather(*(Dashboard(http).watch() for _ in range(count)))


@contextmanager
def watched(url: str, count: int) -> Generator[None]:
    """Dashboards in a process of their own."""
    command = [sys.executable, "-m", "tests.benchmarks.watching", "--watch", url, "--dashboards", str(count)]
    process = subprocess.Popen(command)
    try:
        yield
    finally:
        process.kill()
        process.wait(PATIENCE)


def main() -> None:
    """Pairs of rounds, without and with."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dashboards", type=int, default=20)
    parser.add_argument("--streams", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--watch", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    if asked.watch:
        asyncio.run(watch(asked.watch, asked.dashboards))
        return
    ratios: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        teach(folder, folder / "data")
        with served(folder / "data") as url:
            cameras_apart(url, folder, asked.streams, 3.0)
            for _ in range(asked.rounds):
                alone = cameras_apart(url, folder, asked.streams, asked.seconds)
                with watched(url, asked.dashboards):
                    seen = cameras_apart(url, folder, asked.streams, asked.seconds)
                ratios.append(seen["p99"] / alone["p99"])
                print(f"p99 {alone['p99']:.0f} ms alone, {seen['p99']:.0f} ms watched: {ratios[-1]:.2f}", flush=True)
                print(f"p50 {alone['p50']:.1f} ms alone, {seen['p50']:.1f} ms watched; {seen['counts']}", flush=True)
    print(f"median ratio of p99 {median(ratios):.2f}")


if __name__ == "__main__":
    main()
