"""The round that every way of running several services has to stand: many streams, and one service dies."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.system.clustered import Cluster, until
from tests.system.lines import EACH_SECONDS, IN_THE_MIDDLE, Dashboard, come_to, end_well, started

STREAMS, TOLD_SECONDS = 16, 5.0


def round_with_a_death(
    made: Cluster,
    boards: Sequence[Dashboard],
    kill: Callable[[], None],
    folder: Path,
    *,
    told_seconds: float = TOLD_SECONDS,
    each: float = EACH_SECONDS,
    replaced: bool = False,
) -> set[str]:
    """Of two services one is killed while both have streams; these. Every dashboard has seen all of them begin.

    Its streams go on within `told_seconds`; those of the other lose no frame, and do not move, unless the dead one is
    `replaced` meanwhile by one that some are handed to; all come out as their recordings do, and what was concluded
    before is there. `each`: seconds of a frame.
    """
    before = started(made, 4, each=0.0)
    end_well(made, before)
    assert all(board.ready.wait(30) for board in boards)
    lines = started(made, STREAMS, ("ws", "rest"), each=each)
    come_to(lines, IN_THE_MIDDLE)
    parts = [line.now for line in lines]
    inspections = {part.inspection for part in parts}
    until(lambda: all(board.has("begun", inspections) for board in boards), lambda: str([b.seen for b in boards]))
    owners = made.owners(inspections)
    killed = time.monotonic()
    kill()
    fed = {part.inspection for part in parts if not part.result}
    assert fed == inspections, "the machine was too slow: parts were done before the service was killed"
    end_well(made, lines)
    moved = made.moved(inspections)
    of_each = [{each for each in owners if owners[each] == owner} for owner in {*owners.values()}]
    assert len(of_each) == 2
    assert any(of_one <= moved if replaced else of_one == moved for of_one in of_each)
    silences = {part.inspection: part.silence(killed) for part in parts}
    print(f"{len(moved)} of {len(parts)} moved; first words after {max(silences[each] for each in moved):.2f} s")
    assert max(silences.values()) < told_seconds
    for part in parts:
        part.check_recording(made, folder, lost=part.inspection in moved)
    end_well(made, before)
    return inspections
