"""What do lines notice of services that are killed, stopped, and put to sleep at random, one after the other?

    python -m tests.benchmarks.deaths --seconds 150 --seed 1

Three services behind HAProxy, nine lines without a pause, by WebSocket and by REST in turn. Every part has to come out
as its recording does, with no frame lost; told are how many moved, and the longest that a line heard nothing.
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from threading import Event

from tests.system.clustered import Node, cluster
from tests.system.lines import Part, end_well, started, well


def harm(node: Node, way: str, moments: random.Random) -> None:
    """Do that to it; it runs again in the end."""
    if way == "sleep":
        with node.asleep():
            time.sleep(moments.uniform(1, 8))
        return
    if way == "kill":
        node.kill()
    else:
        assert node.stop() == 0, node.log.read_text()
    time.sleep(moments.uniform(0, 2))
    node.start()


def silence(part: Part) -> float:
    """The longest that nothing was said while it was under the camera, in seconds."""
    return max((after - before for (before, _), (after, _) in pairwise(part.heard)), default=0.0)


def main() -> None:
    """Print what came of it; raises where anything is not as it should be."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=150)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    moments, done, harms = random.Random(asked.seed), Event(), list[str]()
    with cluster(Path(tempfile.mkdtemp()), nodes=3) as made:
        lines = started(made, 9, ("ws", "rest"), more=lambda: not done.is_set(), each=0.05)
        until = time.monotonic() + asked.seconds
        while time.monotonic() < until:
            time.sleep(moments.uniform(0.5, 3))
            node, way = moments.choice(made.nodes), moments.choice(["kill", "stop", "sleep"])
            harm(node, way, moments)
            made.wait_for(node)
            harms.append(way)
            well(lines)
        done.set()
        end_well(made, lines)
        parts = [part for line in lines for part in line.parts]
        moved = made.moved({part.inspection for part in parts})
    told = ", ".join(f"{harms.count(way)} {way}" for way in ("kill", "stop", "sleep"))
    print(f"{told}: {len(parts)} parts right, {len(moved)} moved, longest silence {max(map(silence, parts)):.1f} s")


if __name__ == "__main__":
    main()
