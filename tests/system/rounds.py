"""The round that every way of running several services has to stand: many streams, and one service dies."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tests import patience
from tests.system.clustered import Cluster
from tests.system.lines import EACH_SECONDS, Dashboard, Gate, come_to_the_middle, end_well, started

STREAMS, TOLD_SECONDS = 16, 5.0
"""Seconds of a machine that has a processor for whoever wants one."""


def round_with_a_death(
    made: Cluster,
    boards: Sequence[Dashboard],
    kill: Callable[[], None],
    folder: Path,
    *,
    each: float = EACH_SECONDS,
    replaced: bool = False,
) -> set[str]:
    """Of two services one is killed while both have streams; these. Every dashboard has seen all of them begin.

    Its streams go on within TOLD_SECONDS; those of the other lose no frame, and do not move, unless the dead one is
    `replaced` meanwhile by one that some are handed to, or the front took both for gone; all come out as their
    recordings do, and what was concluded before is there. `each`: seconds of a frame.
    """
    before = started(made, 4, each=0.0)
    end_well(made, before)
    patience.until(lambda: all(board.ready.is_set() for board in boards))
    gate = Gate()
    lines = started(made, STREAMS, ("ws", "rest"), each=each, gate=gate)
    come_to_the_middle(made, lines)
    parts = [line.now for line in lines]
    inspections = {part.inspection for part in parts}
    patience.until(
        lambda: all(board.has("begun", inspections) for board in boards), lambda: str([b.seen for b in boards])
    )
    owners, taken_for_gone = made.owners(inspections), made.taken_for_gone()
    killed = time.monotonic()
    kill()
    gate.open()
    end_well(made, lines)
    exactly = not replaced and len(made.taken_for_gone() - taken_for_gone) < 2
    moved = made.moved(inspections)
    of_each = [{each for each in owners if owners[each] == owner} for owner in {*owners.values()}]
    assert len(of_each) == 2
    assert any(of_one == moved if exactly else of_one <= moved for of_one in of_each)
    silences = {part.inspection: part.silence(killed) for part in parts}
    print(f"{len(moved)} of {len(parts)} moved; first words after {max(silences[each] for each in moved):.2f} s")
    assert max(silences.values()) < TOLD_SECONDS * patience.crowded()
    for part in parts:
        part.check_recording(made, folder, lost=part.inspection in moved)
    end_well(made, before)
    return inspections
