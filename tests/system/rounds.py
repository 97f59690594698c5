"""The round that every way of running several services has to stand: many streams, and one service dies."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.system.clustered import Cluster, until
from tests.system.lines import IN_THE_MIDDLE, Dashboard, come_to, end_well, started

STREAMS, TOLD_SECONDS = 16, 5.0


def round_with_a_death(
    made: Cluster,
    boards: Sequence[Dashboard],
    kill: Callable[[], None],
    folder: Path,
    told_seconds: float = TOLD_SECONDS,
) -> set[str]:
    """Of two services one is killed while both have streams; these. Every dashboard has seen all of them begin.

    The streams of the other lose no frame and do not move; its own go on within `told_seconds`; all come out as their
    recordings do, and what was concluded before is there.
    """
    before = started(made, 4, each=0.0)
    end_well(made, before)
    assert all(board.ready.wait(30) for board in boards)
    lines = started(made, STREAMS, ("ws", "rest"))
    come_to(lines, IN_THE_MIDDLE)
    parts = [line.now for line in lines]
    inspections = {part.inspection for part in parts}
    until(lambda: all(board.has("begun", inspections) for board in boards), lambda: str([b.seen for b in boards]))
    owners = made.owners(inspections)
    assert len({*owners.values()}) == 2
    killed = time.monotonic()
    kill()
    end_well(made, lines)
    moved = made.moved(inspections)
    assert moved in [{each for each in owners if owners[each] == owner} for owner in owners.values()]
    silences = {part.inspection: part.silence(killed) for part in parts}
    print(f"{len(moved)} of {len(parts)} moved; first words after {max(silences[each] for each in moved):.2f} s")
    assert max(silences.values()) < told_seconds
    for part in parts:
        part.check_recording(made, folder, lost=part.inspection in moved)
    end_well(made, before)
    return inspections
