"""The desk: long work in processes of its own, at low priority, so that whoever scores is not held up.

One line of JSON in, lines of JSON out: `desk_worker` is the other side. A process is kept for the next piece of work,
and replaced where it died.

inspector.errors.WorldError
├── WorkFailed               work that could not be done; the sentence is that of what went wrong
├── WorkerDied               a process that ended, or broke, in the middle of its work
└── DeskClosed               work that was not done because the service stops
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from typing import IO, Any

from inspector.errors import WorldError

NICE = 10
"""How much the work steps back behind everybody else."""
Outcome = dict[str, Any]


class WorkFailed(WorldError):
    """Work that could not be done; the sentence is that of what went wrong."""

    def __init__(self, said: str, kind: str) -> None:
        self.kind = kind
        """Name of the class of what went wrong."""
        super().__init__(said)


class WorkerDied(WorldError):
    """A process that ended, or broke, in the middle of its work: out of memory, as a rule."""

    def __init__(self, task: str, how: str) -> None:
        super().__init__(f"the process that should {task} ended before it was done ({how})")


class DeskClosed(WorldError):
    """Work that was not done because the service stops."""

    def __init__(self) -> None:
        super().__init__("the service was stopped before this was done")


@contextmanager
def naming(names: Mapping[str, str]) -> Generator[Callable[[str], str]]:
    """Paths in the sentences of WorkFailed become names that mean something to who asked; so does what this gives."""

    def named(said: str) -> str:
        for path, name in names.items():
            said = said.replace(path, name)
        return said

    try:
        yield named
    except WorkFailed as error:
        raise WorkFailed(named(str(error)), error.kind) from None


class Desk:
    """So many processes, started when they are needed."""

    def __init__(self, processes: int) -> None:
        self._free: SimpleQueue[_Worker] = SimpleQueue()
        self._all = [_Worker() for _ in range(processes)]
        for worker in self._all:
            self._free.put(worker)
        self._closed = False

    def do(
        self,
        task: str,
        arguments: Mapping[str, object],
        progress: Callable[[float], object] = lambda share: None,
        made: Callable[[Outcome], object] = lambda piece: None,
    ) -> Outcome:
        """What comes of one of `inspector.service.tasks`; waits for a free process. Blocks.

        `progress` is called a few times a second, at most, `made` with each piece of work that consists of some. What
        they raise ends the work. Raises WorkFailed, WorkerDied, DeskClosed.
        """
        worker = self._free.get()
        try:
            if self._closed:
                raise DeskClosed
            return worker.do(task, arguments, progress, made)
        except WorkerDied:
            if self._closed:
                raise DeskClosed from None
            raise
        finally:
            self._free.put(worker)

    def close(self) -> None:
        """End every process, whatever it does. Blocks until they are gone."""
        self._closed = True
        for worker in self._all:
            worker.end()


class _Worker:
    """One process."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        self._ended = False

    def do(
        self,
        task: str,
        arguments: Mapping[str, object],
        progress: Callable[[float], object],
        made: Callable[[Outcome], object],
    ) -> Outcome:
        process = self._running()
        assert process.stdin is not None
        assert process.stdout is not None
        line = json.dumps({"task": task, "arguments": arguments}).encode()
        with suppress(BrokenPipeError):
            process.stdin.write(line + b"\n")
            process.stdin.flush()
        for answer in _lines(process.stdout):
            match json.loads(answer):
                case {"progress": share}:
                    with _or_ended(process):
                        progress(share)
                case {"made": piece}:
                    with _or_ended(process):
                        made(piece)
                case {"failed": said, "kind": kind}:
                    raise WorkFailed(said, kind)
                case {"broke": how}:
                    raise WorkerDied(task, how)
                case {"done": outcome}:
                    return outcome
                case _:
                    break
        code = _ended(process)
        raise WorkerDied(task, f"killed by signal {-code}" if code < 0 else f"exit code {code}")

    def _running(self) -> subprocess.Popen[bytes]:
        with self._lock:
            if self._ended:
                raise DeskClosed
            if self._process is not None and self._process.poll() is not None:
                _ended(self._process)
                self._process = None
            if self._process is None:
                command = [sys.executable, "-m", "inspector.service.desk_worker", str(NICE)]
                # A session of its own: Ctrl-C is for the service, which ends its processes itself.
                self._process = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True, env=_environment()
                )
            return self._process

    def end(self) -> None:
        with self._lock:
            self._ended = True
            process = self._process
        if process is not None:
            _ended(process)


def _lines(pipe: IO[bytes]) -> Iterator[bytes]:
    """Whole lines, until the process or the service ends it."""
    try:
        yield from (line for line in pipe if line.endswith(b"\n"))
    except ValueError:
        # Closed by another thread.
        return


@contextmanager
def _or_ended(process: subprocess.Popen[bytes]) -> Generator[None]:
    """Where nobody hears the rest of its answer, the next work would."""
    try:
        yield
    except BaseException:
        _ended(process)
        raise


def _ended(process: subprocess.Popen[bytes]) -> int:
    """Its exit code, when it is gone and nothing of it is left, nor of the processes that it started."""
    if process.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            # What could not be written any more fails once more here.
            with suppress(OSError, ValueError):
                pipe.close()
    return process.wait()


def _environment() -> dict[str, str]:
    """One thread per process: hidden ones make many streams slower, and may change last bits."""
    return {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
