"""What does each thing cost that a camera makes a service do: a frame, a checkpoint, a row, an event, a recording?

Run by hand, on an otherwise idle machine:

    python -m tests.benchmarks.unit_costs                       # four minutes; docker/SCALE.md is made of its figures
    python -m tests.benchmarks.unit_costs --sizes 640x480
    python -m tests.benchmarks.unit_costs --services 2 --cameras 0 4    # of services behind HAProxy, all in all

Milliseconds are of the processor: of the thread that does it; where there is a PostgreSQL, of the thread that asks and
of all of the processes of the server. Bytes of a database are of its log (with full pages, as a server has it
that must outlive the machine) and of its tables. Nothing waits for a disk: what it can do is told apart, as syncs a
second. Sweeps are of the simulated camera; golden sweeps are three, so that there are two scales.
"""

from __future__ import annotations

import argparse
import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import json
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import thread_time_ns
from typing import Any
from urllib.request import Request, urlopen
from uuid import uuid4

import cv2
import httpx2
import psycopg

from inspector.cameras import open_camera
from inspector.objects import Objects
from inspector.pictures import decode, encode_jpeg
from inspector.recording import SweepWriter, join_parts
from inspector.scorers.inspected import Inspected, Names
from inspector.scorers.saved import Going, Saved, resume, save
from inspector.scorers.tape import Tape, TapeThread
from inspector.stores import AbstractStore, open_store
from inspector.stores.records import StoredAppearance
from models.appearance import Appearance
from models.frame import Frame
from models.inspection import Inspection, begin, step
from models.learning import learn
from models.verdict import Policy
from tests.benchmarks import streaming
from tests.postgresql import Server, server
from tests.system.proxying import proxy

FPS, FRAMES = 30, 270
"""Of the cameras that everything is counted for, and of their sweeps: nine seconds."""
GOLDEN = ("unit=1&seed=1", "unit=1&seed=2&place=1,-1,0.1", "unit=3&seed=3")
PART = "unit=2&seed=4&defect=extra&at=0.4"
DRAWN = {"320x240": 270, "640x480": 135, "1280x960": 60}
"""Frames per sweep: drawing large pictures is slow."""
PASSES = 3
TICKS = os.sysconf("SC_CLK_TCK")


@dataclass
class Watch:
    """Keeps the thread's own time of each thing done; other programs on the machine can only add to it."""

    spent: list[float] = field(default_factory=list[float])

    @contextmanager
    def running(self) -> Iterator[None]:
        start = thread_time_ns()
        yield
        self.spent.append((thread_time_ns() - start) / 1e6)

    @property
    def ms(self) -> float:
        """Of one, in the mean."""
        return sum(self.spent) / len(self.spent)


def least(passes: Sequence[Watch]) -> float:
    """Milliseconds of each thing in the pass that had it cheapest, in the mean."""
    return sum(min(each) for each in zip(*(watch.spent for watch in passes), strict=True)) / len(passes[0].spent)


def said(what: str, **figures: float | str) -> None:
    """A row of figures."""
    shown = (f"{name} {value if isinstance(value, str) else f'{value:,.3g}'}" for name, value in figures.items())
    print(f"| {what} | {' | '.join(shown)} |", flush=True)


def sweep(size: str, options: str) -> list[Frame]:
    """As it comes over the network: JPEGs, decoded."""
    found = list[Frame]()
    with open_camera(f"simulated:?path=line&frames={DRAWN.get(size, 60)}&size={size}&{options}") as camera:
        for frame in camera.frames():
            picture = encode_jpeg(frame.pixels)
            found.append(Frame(decode(picture), frame.t_ns, frame.sequence, frame.encoder, picture))
    return found


def frames(size: str, folder: Path) -> tuple[Appearance, list[Frame], Inspection]:
    """What a frame and a checkpoint of this size cost, its references being there from the part before."""
    appearance = learn([sweep(size, options) for options in GOLDEN])
    shown = sweep(size, PART)
    data = [frame.encoded for frame in shown if frame.encoded is not None]
    decoding, scoring, saving = ([Watch() for _ in range(PASSES)] for _ in range(3))
    state, states, added = begin(appearance), list[int](), list[int]()
    for frame in shown:
        state, _ = step(state, frame)
    for watches in zip(decoding, scoring, saving, strict=True):
        state, last = begin(appearance), 0
        for i, (frame, picture) in enumerate(zip(shown, data, strict=True)):
            with watches[0].running():
                decode(picture)
            with watches[1].running():
                state, _ = step(state, frame)
            if i and i % FPS == 0:
                with watches[2].running():
                    saved = save(Going(state, i, False, None), state.frames[last:], ())
                last = state.count
                states.append(len(saved.state))
                added.append(len(saved.added))
    taping = Watch()
    with SweepWriter(folder / f"{size}.mcap", metadata={"product_id": "plate"}) as writer:
        for frame in shown:
            with taping.running():
                writer.write(frame)
    recorded = (folder / f"{size}.mcap").stat().st_size
    jpeg = sum(len(each.data) for each in data) / len(data)
    said(f"frame, {size}", jpeg_bytes=jpeg, decode_ms=least(decoding), step_ms=least(scoring), tape_ms=taping.ms)
    said(f"recording, {size}", bytes_a_frame=recorded / len(shown), beside_pictures=recorded / len(shown) / jpeg - 1)
    going = [Watch() for _ in range(PASSES)]
    whole = save(Going(state, None, False, None), state.frames, ())
    for watch in going:
        with watch.running():
            resume(appearance, Policy(), Saved(whole.state, whole.added), 1 << 30)
    size_of = sum(states) / len(states)
    said(
        f"checkpoint, {size}",
        state_bytes=size_of,
        added_bytes=sum(added) / len(added),
        save_ms=least(saving),
        resume_ms=least(going),
        of_the_pictures=(size_of + sum(added) / len(added)) / (FPS * jpeg),
    )
    return appearance, shown, state


def ended(appearance: Appearance, shown: list[Frame], folder: Path) -> tuple[dict[str, Any], bytes, float, float]:
    """Record and scores of an inspection, by the scorer's own code; bytes of messages a frame; milliseconds to end."""
    thread = TapeThread()
    thread.start()
    tape = Tape(thread, folder / "ended.mcap", {})
    names = Names(*(uuid4().hex for _ in range(5)))
    inspected = Inspected(appearance, Policy(), names, tape, max_pixels=1 << 30)
    spoken = 0
    repeated = [shown[i % len(shown)] for i in range(FRAMES)] if len(shown) < FRAMES else shown[:FRAMES]
    for i, frame in enumerate(repeated):
        assert frame.encoded is not None
        messages, _ = inspected.frame(i, shown[0].t_ns + i * 33_000_000, None, frame.encoded.data)
        spoken += sum(len(json.dumps(each, separators=(",", ":"))) for each in messages)
    ending = Watch()
    with ending.running():
        concluded = inspected.end(FRAMES)
    thread.finish()
    return concluded.result, concluded.scores, spoken / FRAMES, ending.ms


class Database:
    """A PostgreSQL, and what it did."""

    def __init__(self, running: Server) -> None:
        self.url = running.new_database()
        self._pid = int((running.folder / "data" / "postmaster.pid").read_text().split()[0])
        self.connection = psycopg.connect(self.url, autocommit=True)
        for setting in ("full_page_writes = on", "autovacuum = off"):
            self.connection.execute(f"ALTER SYSTEM SET {setting}".encode())
        self.connection.execute("SELECT pg_reload_conf()")

    def spent(self) -> float:
        """Processor seconds of all of its processes, those that have ended too."""
        total = 0
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(stat.parent.name) == self._pid:
                total += sum(map(int, fields[11:15]))
            elif int(fields[1]) == self._pid:
                total += sum(map(int, fields[11:13]))
        return total / TICKS

    def logged(self) -> int:
        """Bytes of its log so far."""
        row = self.connection.execute("SELECT pg_current_wal_insert_lsn() - '0/0'::pg_lsn").fetchone()
        assert row is not None
        return int(row[0])

    def kept(self, *tables: str) -> int:
        """Bytes of all tables, or of those named, with their indexes."""
        sizes = (f"pg_total_relation_size('{table}')" for table in tables)
        asked = " + ".join(sizes) or "pg_database_size(current_database())"
        row = self.connection.execute(f"SELECT {asked}".encode()).fetchone()
        assert row is not None
        return int(row[0])

    def cost(self, what: str, times: int, action: Callable[[int], object], **more: float) -> None:
        """Of doing something so often."""
        self.connection.execute("CHECKPOINT")
        spent, logged, kept, own, start = self.spent(), self.logged(), self.kept(), thread_time_ns(), time.monotonic()
        for i in range(times):
            action(i)
        own_ms, took = (thread_time_ns() - own) / 1e6 / times, time.monotonic() - start
        said(
            what,
            asking_ms=own_ms,
            server_ms=1e3 * (self.spent() - spent) / times,
            log_bytes=(self.logged() - logged) / times,
            table_bytes=(self.kept() - kept) / times,
            a_second=times / took,
            **more,
        )


def rows(store: AbstractStore, database: Database, record: dict[str, Any], scores: bytes, state: Inspection) -> None:
    """What an inspection writes, and how services speak."""
    store.ensure_product("plate", 1)
    store.add_appearance(StoredAppearance("sha256:1", "plate", 1, (), {}, (), 1))
    store.join("node", "node", 1)
    policy = {"sensitivity": 1.0}

    def begun(i: int, prefix: str) -> str:
        store.begin_inspection(
            name := f"{prefix}{i:031}",
            "plate",
            part_id=str(i),
            recipe_id=None,
            appearance_id="sha256:1",
            policy=policy,
            begun_ns=i,
            node="node",
        )
        return name

    def concluded(i: int) -> None:
        verdict = str(record["verdict"])
        store.conclude_inspection(
            f"a{i:031}", "completed", verdict=verdict, ended_ns=i, result=record, scores=scores, node="node"
        )

    saved = save(Going(state, None, False, None), state.frames[-FPS:], ())
    size = float(len(json.dumps(record)))
    database.cost("a row: begin", 500, lambda i: begun(i, "a"))
    database.cost("a row: conclude", 500, concluded, result_bytes=size, scores_bytes=float(len(scores)))
    database.cost("a row: recording", 500, lambda i: store.set_recording(f"a{i:031}", "kept", 7 << 20))
    database.cost("rows: scores of twenty inspections removed", 20, lambda _: store.remove_scores(500, 20, 1))
    store.remove_scores(500, 100, 1)
    database.connection.execute("VACUUM FULL")
    said("what stays of an inspection", table_bytes=database.kept("inspections", "scores") / 500)
    one = begun(0, "b")
    database.cost(
        "a checkpoint",
        300,
        lambda i: store.save_checkpoint(one, "node", i, saved.state, saved.added),
        state_bytes=float(len(saved.state)),
    )
    database.connection.execute("ALTER TABLE checkpoints SET LOGGED")
    two = begun(1, "b")
    database.cost(
        "a checkpoint, were its state logged",
        300,
        lambda i: store.save_checkpoint(two, "node", i, saved.state, saved.added),
        state_bytes=float(len(saved.state)),
    )
    database.cost("a heartbeat", 500, lambda _: store.beat("node"))
    for listeners in (1, 2, 4):
        telling(store, database, listeners)


def telling(store: AbstractStore, database: Database, listeners: int) -> None:
    """A message of 1 kB and one of 25 kB, a picture's, heard by so many services."""
    with ExitStack() as stack:
        heard = [0]
        for number in range(listeners):
            stack.enter_context(store.listen(f"node{number}", lambda body: heard.__setitem__(0, heard[0] + 1)))
        for size in (1000, 25_000):
            heard[0] = 0
            database.cost(f"told to {listeners}: {size} bytes", 500, lambda _, size=size: store.tell(b"x" * size))
            deadline = time.monotonic() + 20
            while heard[0] < 500 * listeners and time.monotonic() < deadline:
                time.sleep(0.01)
            assert heard[0] >= 500 * listeners, heard


def files(size: str, shown: list[Frame], folder: Path, bucket: str) -> None:
    """What a recording costs that is joined of two parts, and one that goes to an object store and comes back."""
    part = folder / f"{size}.mcap"
    joining = [Watch() for _ in range(PASSES)]
    for number, watch in enumerate(joining):
        with watch.running():
            join_parts([part, part], [0, len(shown) // 2], folder / f"joined-{size}-{number}.mcap")
    objects, times, start = Objects(bucket), 10, time.process_time()
    for i in range(times):
        objects.put_new(f"{size}-{i}.mcap", part)
    put, start = time.process_time() - start, time.process_time()
    for i in range(times):
        for _ in objects.stream(f"{size}-{i}.mcap")[1]:
            pass
    got, megabytes = time.process_time() - start, times * part.stat().st_size / 1e6
    said(
        f"files, {size}",
        join_ms_a_frame=least(joining) / len(shown),
        put_ms_a_megabyte=1e3 * put / megabytes,
        get_ms_a_megabyte=1e3 * got / megabytes,
    )


@contextmanager
def bucket() -> Iterator[str]:
    """Of moto's server, in a process of its own: its work is not ours."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    os.environ |= {"AWS_ACCESS_KEY_ID": "x", "AWS_SECRET_ACCESS_KEY": "x", "AWS_REGION": "us-east-1"}
    quiet = subprocess.DEVNULL
    process = subprocess.Popen([sys.executable, "-m", "moto.server", "-p", str(port)], stdout=quiet, stderr=quiet)
    endpoint = f"http://127.0.0.1:{port}"
    try:
        for _ in range(200):
            try:
                urlopen(Request(f"{endpoint}/bucket", method="PUT")).close()
                break
            except OSError:
                time.sleep(0.1)
        yield f"s3://bucket?endpoint={endpoint}"
    finally:
        process.terminate()
        process.wait()


def spent_by(*parents: int) -> Counter[str]:
    """Processor seconds so far of what these processes have started, by what it is."""
    seconds = Counter[str]()
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            command = (stat.parent / "cmdline").read_bytes()
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) in parents:
            kinds = {b"haproxy": "proxy", b"inspector.scorers": "scorers", b"serve": "services"}
            kind = next((kind for part, kind in kinds.items() if part in command), "others")
            seconds[kind] += sum(map(int, fields[11:13])) / TICKS
    return seconds


def started_by(parent: int) -> list[int]:
    """The processes that one has started."""
    return [int(pid) for pid in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]


def services(count: int, streams: int, seconds: float, folder: Path, database: Database) -> None:
    """What so many cameras cost so many services behind HAProxy, all in all, while somebody listens to events."""
    common = folder / f"common{streams}"
    streaming.teach(folder, common, database.url)
    told = [0, 0]

    def heard(body: bytes | None) -> None:
        told[0] += 1
        told[1] += len(body or b"")

    with ExitStack() as held:
        front = held.enter_context(proxy(folder))
        for number in range(count):
            address, data = front.address(number), folder / f"data{streams}-{number}"
            settings = {"INSPECTOR_DATABASE": database.url, "INSPECTOR_FILES": common.as_uri()}
            held.enter_context(streaming.served(data, host=address, port=front.port, **settings))
            front.names.addresses.append(address)
        store = held.enter_context(open_store(database.url))
        held.enter_context(store.listen("benchmark", heard))
        while httpx2.get(f"{front.url}/readyz").status_code != 200:
            time.sleep(0.1)
        time.sleep(3)
        parents = [os.getpid(), *started_by(os.getpid())]
        before, logged, server_before = spent_by(*parents), database.logged(), database.spent()
        told[:] = [0, 0]
        start, found = time.monotonic(), {"counts": dict[str, int]()}
        if streams:
            found = streaming.cameras_apart(front.url, folder, streams, seconds)
        else:
            time.sleep(seconds)
        took = time.monotonic() - start
        after, server_after = spent_by(*parents), database.spent()
        log = (database.logged() - logged) / took
    print(found)
    ms = {f"{kind}_ms_a_second": 1e3 * (after[kind] - before[kind]) / took for kind in ("proxy", "services", "scorers")}
    said(
        f"{count} services, {streams} cameras",
        scored_a_second=found["counts"].get("scored", 0) / took,
        **ms,
        database_ms_a_second=1e3 * (server_after - server_before) / took,
        log_bytes_a_second=log,
        told_a_second=told[0] / took,
        told_bytes_a_second=told[1] / took,
    )


def syncs(folder: Path) -> None:
    """How often a second this disk can be told to keep something: what limits transactions that wait for it."""
    with (folder / "synced").open("wb") as file:
        start = time.monotonic()
        for _ in range(200):
            file.write(b"x" * 8192)
            file.flush()
            os.fsync(file.fileno())
    said("the disk here", syncs_a_second=200 / (time.monotonic() - start))


def main() -> None:
    """The rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", nargs="+", default=[*DRAWN])
    parser.add_argument("--cameras", type=int, nargs="+")
    parser.add_argument("--services", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=27.0)
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as name, server() as running, bucket() as url:
        folder, database = Path(name), Database(running)
        if asked.cameras:
            size = asked.sizes[0]
            drawn = "" if size == "320x240" else f"&path=line&size={size}&frames={DRAWN[size]}"
            streaming.prepare(folder, drawn)
            for streams in asked.cameras:
                services(asked.services, streams, asked.seconds, folder, Database(running))
            return
        syncs(folder)
        for i, size in enumerate(asked.sizes):
            appearance, shown, state = frames(size, folder)
            if not i:
                record, scores, spoken, ending = ended(appearance, shown, folder)
                said("what is said", bytes_a_frame=spoken, conclude_ms=ending)
                with open_store(database.url) as store:
                    rows(store, database, record, scores, state)
            files(size, shown, folder, url)
        database.connection.close()


if __name__ == "__main__":
    main()
