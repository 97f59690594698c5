"""What does a frame cost that comes by HAProxy, or by Ray Serve, compared with one that comes straight?

    python -m tests.benchmarks.fronts

One line streams by WebSocket, a frame sent when the one before was answered; the three ways take turns. Told are the
median and the 99th percentile of the time from sending to the answer, and the processor time of what stands in front.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from inspector.client import Client
from tests.api.stations import GOOD, PRODUCT, frames
from tests.system.clustered import cluster
from tests.system.ray_serve import ray_serve

ROUNDS = 15
TICKS = os.sysconf("SC_CLK_TCK")


def processor_seconds(name: str) -> float:
    """Of all processes of that name, so far."""
    said = subprocess.run(["ps", "-e", "-o", "pid=,args="], capture_output=True, text=True, check=True).stdout
    rows = [row.split(None, 1) for row in said.splitlines()]
    times = 0
    for pid, what in rows:
        if what.startswith(name):
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            times += int(fields[11]) + int(fields[12])
    return times / TICKS


def streamed(url: str, token: str) -> list[float]:
    """Milliseconds of each frame."""
    times: list[float] = []
    heard: list[int] = []

    def hear(message: dict[str, Any]) -> None:
        heard.append(message.get("sequence", -1))

    with Client(url, token) as client, client.begin(PRODUCT, "0001", on_message=hear) as inspection:
        for frame in frames(GOOD):
            began = time.perf_counter()
            inspection.send(frame)
            while frame.sequence not in heard:
                inspection.wait(0.001)
            times.append(1000 * (time.perf_counter() - began))
        inspection.conclude()
    return times


def main() -> None:
    """Print a row for each way."""
    frames(GOOD)
    folders = [Path(tempfile.mkdtemp()) for _ in range(2)]
    with cluster(folders[0], nodes=1) as made, ray_serve(folders[1], replicas=1) as (by_ray, _):
        ways: dict[str, Callable[[], list[float]]] = {
            "straight": lambda: streamed(made.nodes[0].url, made.token),
            "HAProxy": lambda: streamed(made.url, made.token),
            "Ray Serve": lambda: streamed(by_ray.url, by_ray.token),
        }
        fronts = {"straight": "none", "HAProxy": "/usr/sbin/haproxy", "Ray Serve": "ray::ProxyActor"}
        times: dict[str, list[float]] = {way: [] for way in ways}
        spent = dict.fromkeys(ways, 0.0)
        for _ in range(ROUNDS):
            for way, measure in ways.items():
                before = processor_seconds(fronts[way])
                times[way] += measure()
                spent[way] += processor_seconds(fronts[way]) - before
        for way, found in times.items():
            p99 = statistics.quantiles(found, n=100)[98]
            cost = 1000 * spent[way] / len(found)
            print(f"{way}: {statistics.median(found):.1f} ms, p99 {p99:.1f} ms, {cost:.2f} ms of processor in front")


if __name__ == "__main__":
    main()
