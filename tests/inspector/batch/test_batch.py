"""Batches: the same results wherever they are made, nothing done twice, nothing lost with a worker."""

from __future__ import annotations

import csv
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from inspector.batch import Batch, By, Counted, find_recordings, run_batch
from inspector.batch.folder import BatchFolder, BatchInUse
from inspector.batch.tasks import NamedAlike, NothingThere, Task
from inspector.executors import Executor, ExecutorRefused, UnknownExecutor, WorkersLost, open_executor
from inspector.recording import SweepReader
from inspector.replay import replay
from models.verdict import Policy
from tests.inspector.conftest import Line
from tests.inspector.line import cut

WHOLE = ("a/good", "a/good-again", "b/spot")
CORRUPT = "b/corrupt"


@pytest.fixture
def archive(line: Line, tmp_path: Path) -> Path:
    """Two good sweeps, one with a spot, and one that is cut before its first picture."""
    folder = tmp_path / "archive"
    for name in (*WHOLE, CORRUPT):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(line.good, folder / "a/good.mcap")
    shutil.copy(line.good, folder / "a/good-again.mcap")
    shutil.copy(line.spot, folder / "b/spot.mcap")
    cut(line.good, folder / "b/corrupt.mcap", 0.001)
    return folder


def by(line: Line, policy: Policy = Policy()) -> By:  # noqa: B008 (a frozen value)
    return By(line.file, line.appearance.id, policy)


def run(archive: Path, line: Line, out: Path, executor: str = "serial", policy: Policy = Policy()) -> Batch:  # noqa: B008
    with open_executor(executor) as workers:
        return run_batch(find_recordings([archive]), by(line, policy), workers, out)


def made(out: Path) -> dict[str, bytes]:
    """Every result, and the table, by name."""
    files = [*(out / "results").rglob("*.json"), out / "results.csv"]
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in files}


def test_each_result_is_that_of_a_replay_and_what_cannot_be_read_is_named(archive: Path, line: Line, tmp_path: Path):
    told: list[Counted] = []
    with open_executor("serial") as workers:
        batch = run_batch(find_recordings([archive]), by(line), workers, tmp_path / "out", told.append)
    assert batch.counted == told[-1] == Counted(4, 0, 3, 1)
    assert [each.left for each in told] == [4, 3, 2, 1, 0]
    assert batch.verdicts == {"OK": 2, "NG": 1}
    assert [name for name, _ in batch.failed] == [CORRUPT]
    for name in WHOLE:
        record = json.loads((tmp_path / "out" / "results" / f"{name}.json").read_bytes())
        assert record["digest"] == replay(SweepReader(archive / f"{name}.mcap"), line.appearance).result.digest
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").read_text().splitlines()))
    assert [(row["recording"], row["state"], row["verdict"]) for row in rows] == [
        ("a/good", "done", "OK"),
        ("a/good-again", "done", "OK"),
        (CORRUPT, "failed", ""),
        ("b/spot", "done", "NG"),
    ]
    assert "corrupt.mcap" in rows[2]["error"]
    assert rows[0]["part_id"] == "0003"


def test_what_is_done_is_skipped_and_what_has_changed_is_not(archive: Path, line: Line, tmp_path: Path):
    out = tmp_path / "out"
    first = run(archive, line, out)
    before = made(out)
    again = run(archive, line, out)
    assert (again.counted, again.verdicts) == (Counted(4, 3, 0, 1), first.verdicts)
    assert made(out) == before
    shutil.copy(line.spot, archive / "a/good.mcap")
    shutil.copy(line.good, archive / "b/corrupt.mcap")
    (out / "results" / "b" / "spot.json").unlink()
    changed = run(archive, line, out)
    assert (changed.counted, changed.verdicts) == (Counted(4, 1, 3, 0), {"OK": 2, "NG": 2})
    stricter = run(archive, line, out, policy=Policy(sensitivity=1.5))
    assert stricter.counted == Counted(4, 0, 4, 0)


def test_it_goes_on_where_it_was_cut_off(archive: Path, line: Line, tmp_path: Path):
    class Stopped(Exception):
        pass

    def stop(counted: Counted) -> None:
        if counted.done == 2:
            raise Stopped

    out, tasks = tmp_path / "out", find_recordings([archive])
    with open_executor("serial") as workers:
        with pytest.raises(Stopped):
            run_batch(tasks, by(line), workers, out, stop)
        with (out / "journal.jsonl").open("a") as journal:
            journal.write('{"key": "cut off in the mid')
        batch = run_batch(tasks, by(line), workers, out)
    assert batch.counted == Counted(4, 2, 1, 1)
    run(archive, line, tmp_path / "at once")
    assert made(out) == made(tmp_path / "at once")


def test_processes_make_the_same_bytes(archive: Path, line: Line, tmp_path: Path):
    run(archive, line, tmp_path / "one", "serial")
    run(archive, line, tmp_path / "two", "processes:2")
    assert made(tmp_path / "one") == made(tmp_path / "two")


@contextmanager
def dask() -> Iterator[str]:
    """A Dask cluster: a scheduler and two workers, processes of this machine."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster.scheduler_address.replace("tcp:", "dask:")


@contextmanager
def ray() -> Iterator[str]:
    """A Ray cluster of this machine."""
    ray = str(Path(sys.executable).parent / "ray")
    options = ("--head", "--num-cpus=2", "--include-dashboard=false", "--disable-usage-stats", "--port=0")
    subprocess.run([ray, "start", *options], check=True, capture_output=True, timeout=120)
    try:
        yield "ray://auto"
    finally:
        subprocess.run([ray, "stop", "--force"], check=True, capture_output=True, timeout=60)


@pytest.mark.parametrize(("engine", "start"), [("distributed", dask), ("ray", ray)])
@pytest.mark.filterwarnings("default")
def test_clusters_make_the_same_bytes(engine: str, start: object, archive: Path, line: Line, tmp_path: Path):
    if importlib.util.find_spec(engine) is None:
        pytest.skip(f"{engine} is not installed")
    assert callable(start)
    run(archive, line, tmp_path / "one", "serial")
    with start() as url:
        run(archive, line, tmp_path / "cluster", url)
    assert made(tmp_path / "one") == made(tmp_path / "cluster")


def kill_once(marks: Path, number: int) -> int:
    """A worker that dies at 3, the first time."""
    if number == 3 and not (marks / "died").exists():
        (marks / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_killed_worker_is_told_and_what_is_done_is_kept(tmp_path: Path):
    done: list[int] = []
    with open_executor("processes:2") as workers:
        with pytest.raises(WorkersLost, match="processes:2"):
            done.extend(workers.each(partial(kill_once, tmp_path), range(40)))
        left = [number for number in range(40) if number not in done]
        assert 3 in left
        done.extend(workers.each(partial(kill_once, tmp_path), left))
    assert sorted(done) == list(range(40))


class Dying(Executor):
    """Loses its workers after so many things, each time."""

    def __init__(self, after: int) -> None:
        super().__init__("dying", 1, None)
        self._after = after

    def each(self, work, things):  # type: ignore[no-untyped-def]
        yield from map(work, things[: self._after])
        raise WorkersLost("dying: workers were lost")


def test_a_batch_changes_nothing_but_its_time_where_workers_die(archive: Path, line: Line, tmp_path: Path):
    tasks = find_recordings([archive])
    batch = run_batch(tasks, by(line), Dying(after=1), tmp_path / "out")
    assert batch.counted == Counted(4, 0, 3, 1)
    run(archive, line, tmp_path / "one")
    assert made(tmp_path / "out") == made(tmp_path / "one")
    with pytest.raises(WorkersLost):
        run_batch(tasks, by(line), Dying(after=0), tmp_path / "none")


def test_recordings_are_named_by_their_place_in_the_folder(archive: Path):
    assert [task.name for task in find_recordings([archive])] == sorted((*WHOLE, CORRUPT))
    one = archive / "b" / "spot.mcap"
    assert find_recordings([one, one]) == [Task("spot", one)]
    assert [task.name for task in find_recordings([archive / "b", archive / "a" / "good.mcap"])] == [
        CORRUPT,
        "b/spot",
        "good",
    ]
    shutil.copy(one, archive / "a" / "spot.mcap")
    with pytest.raises(NamedAlike, match="would both be spot"):
        find_recordings([one, archive / "a" / "spot.mcap"])
    (archive / "empty").mkdir()
    with pytest.raises(NothingThere, match="empty"):
        find_recordings([archive / "empty"])


def test_one_batch_at_a_time_writes_to_a_folder(tmp_path: Path):
    with BatchFolder(tmp_path, "key"), pytest.raises(BatchInUse, match="another batch"), BatchFolder(tmp_path, "key"):
        pass


@pytest.mark.parametrize("url", ["", "threads", "processes:0", "processes:many", "serial:2"])
def test_what_is_no_executor_is_refused_with_what_is(url: str):
    with pytest.raises(UnknownExecutor, match="processes:N"), open_executor(url):
        pass


def test_a_cluster_that_is_not_there_is_named():
    pytest.importorskip("distributed", reason="distributed is not installed")
    with pytest.raises(ExecutorRefused, match="nobody"), open_executor("dask://nobody.invalid:1"):
        pass
