"""Are 200 recordings done 1.85 times as quickly by two processes as by one, and what is in the way of twice?

Run by hand: python -m tests.benchmarks.batch [--recordings 200] [--frames 200] [--rounds 3] [--processes 2] [--engines]

A batch of the simulated camera's recordings, as `inspector batch` does it, by one process and by several, in turn; all
of it counts, from the start of the processes to the table. Where other programs run, too, those that inspect wait for
processors: how long each did the kernel tells (`/proc/PID/schedstat`), and what they waited is taken off, but for what
the process that keeps the results had. Processor seconds are told beside it.

With --engines, instead: are the results of processes, Dask and Ray the same, byte for byte, where a worker is killed in
the middle, and a corrupt recording is among them?
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from statistics import median
from typing import Any, cast

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1"))

from joblib.externals.loky import get_reusable_executor

from inspector.batch import By, Outcome, Task, find_recordings, run_batch
from inspector.cameras import open_camera
from inspector.executors import Executor, open_executor
from inspector.learner import learn_recordings
from inspector.recorder import record
from models.verdict import Policy
from tests.clusters import dask, processes, ray

ENGINES: dict[str, Callable[[], AbstractContextManager[str]]] = {
    "serial": lambda: nullcontext("serial"),
    "processes": processes,
    "dask": dask,
    "ray": ray,
}
DIFFERENT = 8
"""Recordings; the others are more names of the same."""
FRAMES = 200


@dataclass(frozen=True)
class Took:
    """Seconds of one batch."""

    wall: float
    here: float
    """Of the processor, in the process that keeps the results."""
    there: float
    """Of the processor, in the processes that inspect, where these are others."""
    waited: float
    """For a processor, in the mean of those that inspect."""

    @property
    def alone(self) -> float:
        """What it would have taken without other programs."""
        own = self.here if self.there else 0.0
        return self.wall - max(0.0, self.waited - own / 2)


def sweep(path: Path, frames: int, seed: int) -> Path:
    """A recording of a good part."""
    with open_camera(f"simulated:?size=320x240&frames={frames}&unit={seed}&seed={seed}") as camera:
        record(camera, path, lossless=True, product_id="plate")
    return path


def archive(folder: Path, count: int, frames: int) -> Path:
    """So many recordings."""
    made = [sweep(folder / f"{i}.mcap", frames, i + 10) for i in range(DIFFERENT)]
    places = folder / "archive"
    places.mkdir()
    for i in range(count):
        os.link(made[i % DIFFERENT], places / f"part-{i:04}.mcap")
    return places


def processor(who: int) -> float:
    """Seconds so far."""
    usage = getrusage(who)
    return usage.ru_utime + usage.ru_stime


def workers_of(processes: int) -> list[int]:
    """The processes that inspect."""
    if processes == 1:
        return [os.getpid()]
    pool: Any = get_reusable_executor(reuse=True)
    return list(pool._processes)


def waited(pid: int) -> float:
    """Seconds that its first thread could have run, and had no processor."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9


def batch(tasks: Sequence[Task], by: By, out: Path, processes: int) -> Took:
    """All of it, by so many."""
    before = waited(os.getpid()) if processes == 1 else 0.0
    here, there, begun = processor(RUSAGE_SELF), processor(RUSAGE_CHILDREN), time.perf_counter()
    with open_executor(f"processes:{processes}") as workers:
        done = run_batch(tasks, by, workers, out)
        waits = [waited(pid) for pid in workers_of(processes)]
    wall = time.perf_counter() - begun
    assert done.counted.done == len(tasks), done.failed
    mean = sum(waits) / len(waits) - before
    return Took(wall, processor(RUSAGE_SELF) - here, processor(RUSAGE_CHILDREN) - there, mean)


def digest(out: Path) -> list[bytes]:
    """What was made."""
    return [path.read_bytes() for path in (out / "results.csv", *sorted((out / "results").iterdir()))]


def everywhere(tasks: Sequence[Task], by: By, folder: Path) -> None:
    """By every engine, each with a worker that is killed."""
    corrupt = tasks[len(tasks) // 2].path
    assert isinstance(corrupt, Path)
    corrupt.unlink()
    corrupt.write_bytes(b"no recording")
    wanted: list[bytes] | None = None
    for name, engine in ENGINES.items():
        out, mark = folder / name, folder / f"{name} died"
        with engine() as url, open_executor(url) as workers:
            begun = time.perf_counter()
            deadly = cast(Executor, workers if name == "serial" else Deadly(workers, mark, tasks[len(tasks) // 3].name))
            done = run_batch(tasks, by, deadly, out)
            wall = time.perf_counter() - begun
        assert [named for named, _ in done.failed] == [tasks[len(tasks) // 2].name]
        wanted = wanted or digest(out)
        assert digest(out) == wanted
        killed = ", a worker killed" if mark.exists() else ""
        print(f"{name}: {done.counted.done} done, {done.counted.failed} named{killed}, {wall:.1f} s", flush=True)
    print(f"{len(wanted or ())} files, the same everywhere")


class Deadly:
    """An executor whose worker is killed when it has that recording in work, the first time."""

    def __init__(self, workers: Executor, mark: Path, name: str) -> None:
        self._workers, self._mark, self._name = workers, mark, name

    def each(
        self, work: Callable[..., Outcome], things: Sequence[Task], by: By, lost: Callable[[Task, str], Outcome]
    ) -> Iterator[Outcome]:
        """As the executor does it."""
        return self._workers.each(killed, things, self._mark, self._name, work, by, lost=lost)


def killed(task: Task, mark: Path, name: str, work: Callable[..., Outcome], by: By) -> Outcome:
    """In a worker."""
    if task.name == name and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return work(task, by)


def main() -> None:
    """Print what each took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--engines", action="store_true")
    asked = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="batch-"))
    try:
        golden = [sweep(folder / f"golden-{i}.mcap", asked.frames, i) for i in (1, 2)]
        learnt = learn_recordings(golden, folder / "plate.appearance")
        by = By(folder / "plate.appearance", learnt.id, Policy())
        tasks = find_recordings([archive(folder, asked.recordings, asked.frames)])
        if asked.engines:
            everywhere(tasks, by, folder)
            return
        ones, several = list[Took](), list[Took]()
        for turn in range(asked.rounds):
            for took, processes in ((ones, 1), (several, asked.processes)):
                out = folder / f"{processes}-{turn}"
                took.append(batch(tasks, by, out, processes))
                print(f"{processes} process{'es' if processes > 1 else ''}: {took[-1]}", flush=True)
            assert digest(folder / f"1-{turn}") == digest(folder / f"{asked.processes}-{turn}")
        count, frames = len(tasks), len(tasks) * asked.frames
        times = sorted(one.alone / two.alone for one, two in zip(ones, several, strict=True))
        clock = sorted(one.wall / two.wall for one, two in zip(ones, several, strict=True))
        kept = min(took.here for took in several)
        print(f"{count} recordings of {asked.frames} frames, 320x240, {asked.rounds} rounds")
        print(f"  one process                {1000 * median(each.alone for each in ones) / frames:.2f} ms a frame")
        print(f"  {asked.processes} processes, times as quick {median(times):.2f} ({times[0]:.2f} to {times[-1]:.2f})")
        print(f"  the same by the clock      {median(clock):.2f} ({clock[0]:.2f} to {clock[-1]:.2f})")
        print(f"  to keep results            {1000 * kept / count:.1f} ms of the processor for each")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
