"""What do twenty open dashboards cost the line?

Run by hand, on an otherwise idle machine: python -m tests.benchmarks.watching [--dashboards 20] [--streams 8]

The cameras of `streaming.py`, with and without dashboards, in turns. A dashboard does what the line view does: it
listens to events, with the pictures of every running inspection. All dashboards are one process on the same cores; what
browsers need to draw is not the service's, and not counted.
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


async def dashboard(http: httpx2.AsyncClient) -> None:
    """One open page: it listens, and reads what it is told."""
    async with http.stream("GET", "/v1/events?pictures=every", timeout=None) as answer:
        async for line in answer.aiter_lines():
            if line.startswith("data: "):
                json.loads(line.removeprefix("data: "))


async def watch(url: str, count: int) -> None:
    """So many dashboards, until this process is ended."""
    limits = httpx2.Limits(max_connections=None)
    async with httpx2.AsyncClient(base_url=url, timeout=PATIENCE, limits=limits) as http:
        await asyncio.gather(*(dashboard(http) for _ in range(count)))


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
