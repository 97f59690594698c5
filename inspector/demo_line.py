"""The demo's line as a client of a service: it teaches it the product, then sends it one part after the other."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path

from inspector.client import Client, paced
from inspector.recording import SweepReader

REST_SECONDS = 2.0
"""Between two parts."""


def teach(client: Client, folder: Path, product: str) -> None:
    """Upload the golden sweeps of a demo's folder, learn, and inspect by what was learnt. Raises ClientError."""
    golden = sorted((folder / "recordings").glob("golden-*.mcap"))
    sweeps = [client.upload_sweep(path, product, path.stem) for path in golden]
    client.make_recipe(product, client.learn(product, sweeps), note="the demo")


def parts(folder: Path) -> list[Path]:
    """The recordings of the demo's parts, in the order of inspection."""
    return sorted(path for path in (folder / "recordings").glob("*.mcap") if not path.stem.startswith("golden-"))


def run_line(
    url: str,
    folder: Path,
    product: str,
    stop: threading.Event,
    *,
    which: Callable[[list[Path]], Iterator[Path]] = cycle,
    on_verdict: Callable[[str, str], object] = lambda part, verdict: None,
) -> None:
    """Teach the service at `url`, then send parts at the pace of the camera, over and over, until `stop` is set.

    `on_verdict` is told each part and its verdict. Raises ClientError.
    """
    with Client(url) as client:
        teach(client, folder, product)
        for path in which(parts(folder)):
            if stop.is_set():
                return
            with client.begin(product, path.stem) as inspection:
                for frame in paced(SweepReader(path), time.monotonic, inspection.wait):
                    if stop.is_set():
                        return
                    inspection.send(frame)
                on_verdict(path.stem, inspection.conclude()["verdict"])
            stop.wait(REST_SECONDS)
