"""Batches: the same results wherever they are made, nothing done twice, nothing lost with a worker."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from inspector.batch import Batch, By, Counted, find_recordings, run_batch
from inspector.batch.folder import BatchFolder, BatchInUse
from inspector.batch.tasks import NamedAlike, NothingThere, Outcome, Task
from inspector.executors import Executor, ExecutorRefused, UnknownExecutor, WorkersLost, _Died, open_executor
from inspector.learner import learn_recordings
from inspector.locations import RemoteFile
from inspector.objects import Objects, beneath
from inspector.recording import SweepReader
from inspector.replay import replay
from models.verdict import Policy
from tests.buckets import Buckets
from tests.clusters import ENGINES, needs
from tests.inspector.conftest import Line
from tests.inspector.line import cut
from tests.patience import until

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
        batch = run_batch(find_recordings([archive]), by(line), workers, tmp_path / "out", tell=told.append)
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
            run_batch(tasks, by(line), workers, out, tell=stop)
        with (out / "journal.jsonl").open("a") as journal:
            journal.write('{"key": "cut off in the mid')
        batch = run_batch(tasks, by(line), workers, out)
    assert batch.counted == Counted(4, 2, 1, 1)
    run(archive, line, tmp_path / "at once")
    assert made(out) == made(tmp_path / "at once")


def test_what_a_kill_or_a_disk_has_spoilt_is_done_again_and_nothing_half_written_stays(
    archive: Path, line: Line, tmp_path: Path
):
    out = tmp_path / "out"
    run(archive, line, out)
    whole = made(out)
    # Killed between a result of another policy and the line that tells of it.
    shutil.copytree(out, tmp_path / "other")
    run(archive, line, tmp_path / "other", policy=Policy(sensitivity=1.5))
    shutil.copy(tmp_path / "other" / "results" / "a" / "good.json", out / "results" / "a" / "good.json")
    # Killed while a result and a table were written.
    drafts = [out / "results" / "b" / ".spot.json.0123abcd", out / ".results.csv.0123abcd"]
    for draft in drafts:
        draft.write_text("{")
    (out / ".mine").touch()
    # A line that the disk has lost.
    journal = (out / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (spot,) = (number for number, each in enumerate(journal) if b'"recording": "b/spot"' in each)
    journal[spot] = b"\0\xff" * 40 + b"\n"
    (out / "journal.jsonl").write_bytes(b"".join(journal))
    again = run(archive, line, out)
    assert again.counted == Counted(4, 1, 2, 1)
    assert made(out) == whole
    assert not any(draft.exists() for draft in drafts)
    assert (out / ".mine").exists()


def test_a_table_of_those_before_does_not_stay_beside_other_results(archive: Path, line: Line, tmp_path: Path):
    class Stopped(Exception):
        pass

    def stop(counted: Counted) -> None:
        if counted.done == 1:
            raise Stopped

    run(archive, line, tmp_path)
    assert (tmp_path / "results.csv").exists()
    stricter = by(line, Policy(sensitivity=1.5))
    with open_executor("serial") as workers, pytest.raises(Stopped):
        run_batch(find_recordings([archive]), stricter, workers, tmp_path, tell=stop)
    assert not (tmp_path / "results.csv").exists()


def test_the_table_says_why_when_and_what_a_recording_has_lost(archive: Path, line: Line, tmp_path: Path):
    cut(line.good, archive / "b" / "short.mcap", 0.8)
    assert run(archive, line, tmp_path).damaged == 1
    rows = {row["recording"]: row for row in csv.DictReader((tmp_path / "results.csv").read_text().splitlines())}
    result = json.loads((tmp_path / "results" / "b" / "short.json").read_bytes())
    short = rows["b/short"]
    assert (short["state"], short["verdict"]) == ("done", "INCOMPLETE")
    assert short["t_ns"] == str(result["frames"][0]["t_ns"])
    assert short["losses"] == "; ".join(result["losses"]) != ""
    assert short["reasons"] == "; ".join(result["reasons"]) != ""
    assert rows["a/good"]["losses"] == ""


class Killing(Executor):
    """Kills the worker that has the second recording in work, the first time."""

    def __init__(self, workers: Executor, marks: Path) -> None:
        self._workers, self._marks = workers, marks

    def each(self, work, things, *shared, lost=None):  # type: ignore[no-untyped-def]
        return self._workers.each(killed_once, things, self._marks, work, *shared, lost=lost)


def killed_once(task: Task, marks: Path, work: Callable[..., Outcome], by: By) -> Outcome:
    if task.name == "a/good-again" and not (marks / "died").exists():
        (marks / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return work(task, by)


@pytest.fixture(scope="module", params=ENGINES)
def engine(request: pytest.FixtureRequest) -> Iterator[str]:
    with request.param() as url:
        yield url


@pytest.mark.filterwarnings("default")
def test_every_engine_makes_the_same_bytes_even_where_a_worker_is_killed(
    engine: str, archive: Path, line: Line, tmp_path: Path
):
    run(archive, line, tmp_path / "one", "serial")
    with open_executor(engine) as workers:
        run_batch(find_recordings([archive]), by(line), workers, tmp_path / "two")
        batch = run_batch(find_recordings([archive]), by(line), Killing(workers, tmp_path), tmp_path / "killed")
    assert (tmp_path / "died").exists()
    assert (batch.counted, [name for name, _ in batch.failed]) == (Counted(4, 0, 3, 1), [CORRUPT])
    assert made(tmp_path / "one") == made(tmp_path / "two") == made(tmp_path / "killed")


@pytest.mark.filterwarnings("default")
def test_every_engine_learns_the_same_bytes(engine: str, line: Line, tmp_path: Path):
    golden = (*line.golden, line.good)
    learn_recordings(golden, tmp_path / "one")
    with open_executor(engine) as workers:
        learn_recordings(golden, tmp_path / "two", executor=workers)
    assert (tmp_path / "two").read_bytes() == (tmp_path / "one").read_bytes()


def waits(number: int, marks: Path) -> None:
    (marks / str(os.getpid())).touch()
    threading.Event().wait()


WAITING = """
import sys, pathlib, inspector.executors, tests.inspector.batch.test_batch as here
with inspector.executors.open_executor("processes:2") as workers:
    list(workers.each(here.waits, [1, 2], pathlib.Path(sys.argv[1])))
"""


def test_workers_do_not_outlive_who_started_them(tmp_path: Path):
    with subprocess.Popen([sys.executable, "-c", WAITING, tmp_path], stderr=subprocess.DEVNULL) as process:
        until(lambda: len(list(tmp_path.iterdir())) == 2)
        process.kill()
    workers = [int(path.name) for path in tmp_path.iterdir()]
    until(lambda: not any(runs(pid) for pid in workers))


def interrupted(number: int) -> int:
    os.kill(os.getpid(), signal.SIGINT)
    return number


def test_ctrl_c_is_for_who_started_the_workers():
    # A terminal sends it to all of them.
    with open_executor("processes:2") as workers:
        try:
            assert sorted(workers.each(interrupted, [1, 2, 3])) == [1, 2, 3]
        except KeyboardInterrupt:
            pytest.fail("a worker was interrupted")


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


class Dying(Executor):
    """Loses its workers after so many things, each time."""

    def __init__(self, after: int) -> None:
        super().__init__("dying", 1, None)
        self._after = after

    def _once(self, work, numbered, shared):  # type: ignore[no-untyped-def]
        yield from super()._once(work, numbered[: self._after], shared)
        raise _Died("killed")


def test_a_batch_changes_nothing_but_its_time_where_workers_die(archive: Path, line: Line, tmp_path: Path):
    tasks = find_recordings([archive])
    batch = run_batch(tasks, by(line), Dying(after=1), tmp_path / "out")
    assert batch.counted == Counted(4, 0, 3, 1)
    run(archive, line, tmp_path / "one")
    assert made(tmp_path / "out") == made(tmp_path / "one")
    with pytest.raises(WorkersLost, match="dying"):
        run_batch(tasks, by(line), Dying(after=0), tmp_path / "none")


def deadly(task: Task, marks: Path, work: Callable[..., Outcome], by: By) -> Outcome:
    if task.name == "a/good":
        os.kill(os.getpid(), signal.SIGKILL)
    if task.name == "a/good-again":
        raise ValueError("a mistake of this program")
    return work(task, by)


def test_a_recording_that_kills_every_worker_is_named_and_stops_nothing(
    archive: Path, line: Line, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(f"{__name__}.killed_once", deadly)
    with open_executor("processes:2") as workers:
        batch = run_batch(find_recordings([archive]), by(line), Killing(workers, tmp_path), tmp_path / "out")
    assert (batch.counted, batch.verdicts) == (Counted(4, 0, 1, 3), {"NG": 1})
    why = dict(batch.failed)
    assert "every worker that takes it dies" in why["a/good"]
    assert why["a/good-again"] == "ValueError: a mistake of this program"


@pytest.mark.cluster
def test_tables_are_parquet_where_that_is_asked_for(archive: Path, line: Line, tmp_path: Path):
    needs("pyarrow")
    from pyarrow import parquet

    with open_executor("serial") as workers:
        for name in ("out", "again"):
            run_batch(find_recordings([archive]), by(line), workers, tmp_path / name, table="parquet")
            # What is done already is in the tables, too.
            run_batch(find_recordings([archive]), by(line), workers, tmp_path / name, table="parquet")
    out = tmp_path / "out"
    rows = parquet.read_table(out / "results.parquet").to_pylist()
    assert [(row["recording"], row["state"], row["verdict"]) for row in rows] == [
        ("a/good", "done", "OK"),
        ("a/good-again", "done", "OK"),
        (CORRUPT, "failed", None),
        ("b/spot", "done", "NG"),
    ]
    frames = parquet.read_table(out / "frames.parquet").to_pylist()
    results = {name: json.loads((out / "results" / f"{name}.json").read_bytes()) for name in WHOLE}
    assert len(frames) == sum(len(result["frames"]) for result in results.values())
    spot = [frame for frame in frames if frame["recording"] == "b/spot"]
    told = [frame | frame.pop("residuals") for frame in results["b/spot"]["frames"]]
    assert spot == [{"recording": "b/spot"} | frame for frame in told]
    for name in ("results.parquet", "frames.parquet"):
        assert (out / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
    assert not (out / "results.csv").exists()


def test_recordings_and_appearances_are_read_by_url(archive: Path, line: Line, tmp_path: Path, buckets: Buckets):
    bucket = buckets.new()
    objects = Objects(bucket)
    for path in archive.rglob("*.mcap"):
        objects.put_new(f"2026/{path.relative_to(archive).as_posix()}", path)
    objects.put_new("2026-old/other.mcap", line.good)
    objects.put_new("line.appearance", line.file)
    tasks = find_recordings([beneath(bucket, "2026")])
    assert [task.name for task in tasks] == sorted((*WHOLE, CORRUPT))
    by_url = By(RemoteFile(beneath(bucket, "line.appearance")), line.appearance.id, Policy())
    run(archive, line, tmp_path / "here")
    with open_executor("processes:2") as workers:
        batch = run_batch(tasks, by_url, workers, tmp_path / "there")
        again = run_batch(tasks, by_url, workers, tmp_path / "there")
    assert (batch.counted, again.counted) == (Counted(4, 0, 3, 1), Counted(4, 3, 0, 1))
    for name in WHOLE:
        here, there = ((tmp_path / out / "results" / f"{name}.json").read_bytes() for out in ("here", "there"))
        assert here == there
    # Another recording by the same name is done anew.
    objects.remove("2026/a/good.mcap")
    objects.put_new("2026/a/good.mcap", line.spot)
    changed = run_batch(tasks, by_url, Executor("serial", 1, None), tmp_path / "there")
    assert (changed.counted, changed.verdicts) == (Counted(4, 2, 1, 1), {"OK": 1, "NG": 2})


def test_urls_name_recordings(buckets: Buckets, line: Line, archive: Path):
    bucket = buckets.new()
    for name in ("x/a.mcap", "y/b.mcap"):
        Objects(bucket).put_new(name, line.good)
    both = find_recordings([beneath(bucket, "x"), beneath(bucket, "y/b.mcap"), archive / "a", "https://host/c/latest"])
    assert [task.name for task in both] == ["a/good", "a/good-again", "b", "latest", "x/a"]
    assert [str(task.path) for task in both[2:4]] == [f"{bucket.partition('?')[0]}/y/b.mcap", "https://host/c/latest"]
    with pytest.raises(NothingThere, match="/z; allowed"):
        find_recordings([beneath(bucket, "z")])


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
    with pytest.MonkeyPatch.context() as patch:
        # Neither a folder nor an object may lead out of the folder of results.
        patch.chdir(archive / "b")
        named = {task.name for task in find_recordings(["..", "../b"])}
    assert named == {f"{archive.name}/{name}" for name in (*WHOLE, CORRUPT, "a/spot")} | {CORRUPT, "b/spot"}
    assert find_recordings(["https://host/x/../../y.mcap"])[0].name == "y"
    (archive / "b" / "gone.mcap").symlink_to("nowhere")
    assert "b/gone" in {task.name for task in find_recordings([archive])}
    (archive / "empty").mkdir()
    with pytest.raises(NothingThere, match="empty"):
        find_recordings([archive / "empty"])


def test_one_batch_at_a_time_writes_to_a_folder(tmp_path: Path):
    with BatchFolder(tmp_path, "key"), pytest.raises(BatchInUse, match="another batch"), BatchFolder(tmp_path, "key"):
        pass


@pytest.mark.parametrize("url", ["", "threads", "processes:0", "processes:many", "serial:2", "dask://", "ray"])
def test_what_is_no_executor_is_refused_with_what_is(url: str):
    with pytest.raises(UnknownExecutor, match="processes:N"), open_executor(url):
        pass


def test_an_end_in_the_middle_of_work_shows_no_traceback_and_others_are_shown(monkeypatch: pytest.MonkeyPatch):
    shown: list[type[BaseException]] = []
    monkeypatch.setattr(threading, "excepthook", lambda broke: shown.append(broke.exc_type))

    def breaks(name: str, error: Exception) -> None:
        def run() -> None:
            raise error

        thread = threading.Thread(target=run, name=name)
        thread.start()
        thread.join()

    with open_executor("processes:2"):
        breaks("ExecutorManagerThread", KeyError(10))
        breaks("ExecutorManagerThread", ValueError())
        breaks("another", LookupError())
    breaks("ExecutorManagerThread", KeyError(10))
    assert shown == [ValueError, LookupError, KeyError]


@pytest.mark.cluster
def test_a_cluster_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch):
    needs("distributed")
    monkeypatch.setattr("inspector.executors._PATIENCE", 1)
    with pytest.raises(ExecutorRefused, match="nobody"), open_executor("dask://nobody.invalid:1"):
        pass
    needs("ray")
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        url = f"ray://127.0.0.1:{mute.getsockname()[1]}"
        with pytest.raises(ExecutorRefused, match=f"{url} cannot be reached: .*refused"), open_executor(url):
            pass
