"""What stays of inspections: which recordings, and how long the scores of frames.

Results stay all, a few kilobytes each; so do sweeps that were uploaded or learnt from. Scores of parts that are OK go
no sooner than others: they are what another policy is tried on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from math import ceil

from inspector.objects import ObjectError
from inspector.service.files import Files
from inspector.stores import AbstractStore
from inspector.stores.records import StoredRecording

DAY_NS = 86_400_000_000_000
BATCH = 500
SCORES_AT_A_TIME, REST_SECONDS = 20, 0.01
"""Inspections whose scores go in one transaction, and what lies between two: on SQLite, which has one writer, a line
that concludes waits for one transaction, some 10 ms, and finds its turn then."""


@dataclass(frozen=True)
class Retention:
    """What is asked for."""

    ok_one_in: int = 1
    """Of a product's parts that are OK, the first stays and then one in so many, 1 or more; of all others every one."""
    days: float = 30.0
    """What ended longer ago goes, whatever it was."""
    disk_share: float = 0.8
    """Recordings fill no more than this share of what they and the free disk make up: else the oldest OK go first, then
    the oldest of all others. In a bucket there is no disk."""
    bytes: int | None = None
    """And no more than so many; None is no limit."""


def over(recorded: int, free: int, share: float) -> int:
    """Bytes that must go until recordings fill no more than the share of their room: they, and what is free.

    What other programs keep on the disk does not count: a disk that was nearly full leaves less room, but some.

    >>> over(90, 10, 0.8), over(70, 30, 0.8), over(0, 0, 0.8)
    (10, 0, 0)
    """
    return max(0, ceil(recorded - share * (recorded + free)))


@dataclass(frozen=True)
class Tidied:
    """What was done."""

    removed: int
    bytes: int
    failures: tuple[str, ...]
    """A sentence for each file that could not be removed."""


def due(recording: StoredRecording, rules: Retention, now_ns: int) -> str | None:
    """Why a recording goes, however much room there is; None where it stays."""
    if recording.ended_ns is not None and now_ns - recording.ended_ns > rules.days * DAY_NS:
        return f"it ended more than {rules.days:g} days before"
    if recording.ok_number is not None and (recording.ok_number - 1) % rules.ok_one_in:
        return f"of parts that are OK, one in {rules.ok_one_in} is kept"
    return None


def crowded_out(recordings: Iterable[StoredRecording], too_much: int) -> Iterator[StoredRecording]:
    """Those that make room for so many bytes: the oldest OK first, then the others, oldest first.

    `recordings` are in order of age.
    """
    for recording in sorted(recordings, key=lambda each: each.verdict != "OK"):
        if too_much <= 0:
            return
        too_much -= recording.bytes
        yield recording


def tidy(
    store: AbstractStore,
    files: Files,
    rules: Retention,
    now_ns: int,
    *,
    enough: Callable[[], bool] = lambda: False,
) -> Tidied:
    """Remove what need not stay until it is `enough`, and say so in the store; what is being written is left alone.

    A file that cannot be removed stays in the store, and is tried again next time. Of services that share a database,
    but not their files, each removes its own.
    """
    kept: list[StoredRecording] = []
    removed: list[StoredRecording] = []
    failures: list[str] = []

    def remove(recording: StoredRecording, why: str) -> None:
        try:
            files.remove("inspection", recording.inspection_id)
            takes = store.inspection(recording.inspection_id).takes
            for take in range(takes + 1) if takes else ():
                # One that came too late to be joined.
                files.remove("part", f"{recording.inspection_id}.{take}")
        except (OSError, ObjectError) as error:
            said = getattr(error, "strerror", None) or error
            failures.append(f"recording {recording.inspection_id} cannot be removed: {said}")
            return
        store.set_recording(recording.inspection_id, "removed", note=why)
        removed.append(recording)

    for recording in takewhile(lambda _: not enough(), _kept(store)):
        if store.shared and not files.common and files.size("inspection", recording.inspection_id) is None:
            continue
        why = due(recording, rules, now_ns)
        remove(recording, why) if why else kept.append(recording)
    too_much, full = _too_much(sum(each.bytes for each in kept), files.free(), rules)
    for recording in takewhile(lambda _: not enough(), crowded_out(kept, too_much)):
        remove(recording, full)
    return Tidied(len(removed), sum(each.bytes for each in removed), tuple(failures))


def remove_scores(
    store: AbstractStore,
    days: float,
    now_ns: int,
    *,
    enough: Callable[[], bool] = lambda: False,
    sleep: Callable[[float], object] = time.sleep,
) -> int:
    """Of how many inspections, that ended more than so many days ago, the scores were removed until it was `enough`."""
    before_ns, gone = now_ns - int(min(days * DAY_NS, now_ns)), 0
    while not enough():
        some = store.remove_scores(before_ns, SCORES_AT_A_TIME, now_ns)
        gone += some
        if some < SCORES_AT_A_TIME:
            break
        sleep(REST_SECONDS)
    return gone


def _too_much(recorded: int, free: int | None, rules: Retention) -> tuple[int, str]:
    """Bytes that must go, and why."""
    on_disk = 0 if free is None else over(recorded, free, rules.disk_share)
    in_all = 0 if rules.bytes is None else recorded - rules.bytes
    if in_all > on_disk:
        return in_all, f"recordings filled more than {rules.bytes} bytes"
    return on_disk, f"recordings filled more than {rules.disk_share * 100:g} % of their room on the disk"


def _kept(store: AbstractStore) -> Iterator[StoredRecording]:
    """The oldest first, in batches: there may be very many, and others want to use the store meanwhile."""
    after = None
    while batch := store.recordings("kept", after, BATCH):
        yield from batch
        after = batch[-1].number
