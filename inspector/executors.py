"""Executors: where the work of a batch is done, chosen by url: `open_executor("processes:4")`, `"dask://host:8786"`.

inspector.errors.WorldError
├── UnknownExecutor          a url that names none
├── ExecutorMissing          an engine that is not installed
├── ExecutorRefused          a cluster that does not answer
└── WorkersLost              workers died, again and again
"""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, TypeVar

import cv2
import joblib
from joblib.externals import loky
from threadpoolctl import threadpool_limits

from inspector.errors import WorldError

# Their stubs know less than they do.
_JOBLIB: Any = joblib
_LOKY: Any = loky
A = TypeVar("A")
B = TypeVar("B")
EXECUTORS = {
    "serial": "serial, one after the other in this process",
    "processes": "processes or processes:N on this machine",
    "dask": "dask://HOST:PORT, a Dask cluster",
    "ray": "ray://auto or ray://HOST:PORT, a Ray cluster",
}
_EXTRA = {"dask": "dask", "ray": "cluster"}
_AHEAD = 4
"""Pieces of work handed out for each worker."""
_PATIENCE = 10
"""Seconds that a cluster may take to answer."""
_RAY_TRIES = "RAY_NUM_REDIS_GET_RETRIES"
"""In the environment while Ray is imported: how often it tries to join, for 40 s each; usually 20 times."""
_LIST = 16
"""Pieces of work for each worker that are told of together, where an engine cannot tell of each."""
_TRIES = 3
"""How often workers may be lost without anything done meanwhile."""


class UnknownExecutor(WorldError):
    """A url that names none."""

    def __init__(self, url: str) -> None:
        super().__init__(f"{url!r} is no executor; allowed are {'; '.join(EXECUTORS.values())}")


class ExecutorMissing(WorldError):
    """An engine that is not installed."""

    def __init__(self, scheme: str, why: str) -> None:
        super().__init__(f"{scheme} is not installed here ({why}): pip install 'sweep-inspector[{_EXTRA[scheme]}]'")


class ExecutorRefused(WorldError):
    """A cluster that does not answer."""

    def __init__(self, url: str, why: str) -> None:
        super().__init__(f"{url} cannot be reached: {why}")


class WorkersLost(WorldError):
    """Workers died, and what they had in work is not done."""

    def __init__(self, url: str, why: str) -> None:
        super().__init__(f"{url}: workers were lost: {why}")


class Executor:
    """Does the same to each of many things, several at a time."""

    def __init__(self, url: str, workers: int, backend: str | None) -> None:
        self.url, self.workers = url, workers
        # Ray's back end gives lists only.
        self._lists = backend == "ray"
        self._backend = backend

    def each(
        self,
        work: Callable[..., B],
        things: Sequence[A],
        *shared: object,
        lost: Callable[[A, str], B] | None = None,
    ) -> Iterator[B]:
        """What `work(thing, *shared)` makes of each thing, in the order in which they are done.

        `work` is a function of a module and raises nothing that is expected. What is shared is sent to a cluster once
        where it is an array. What a worker had in work when it died is done by another. A thing that takes every worker
        with it, or that `work` breaks on, becomes `lost(thing, why)`. Raises WorkersLost where that is not given, and
        where no worker is left.
        """
        left = dict(enumerate(things))
        fruitless = 0
        while left:
            before = len(left)
            try:
                for number, made in self._once(work, list(left.items()), shared):
                    thing = left.pop(number)
                    yield self._told(made, thing, lost)
            except _Died as died:
                fruitless = fruitless + 1 if len(left) == before else 0
                if fruitless < _TRIES:
                    continue
                if lost is None:
                    raise WorkersLost(self.url, str(died)) from died
                # Those that may have been in work: which of them it was shows when each is alone.
                for number in list(left)[: self._at_once]:
                    made = self._alone(work, number, left[number], shared)
                    yield self._told(made, left.pop(number), lost)
                fruitless = 0

    @property
    def _at_once(self) -> int:
        return (_LIST if self._lists else _AHEAD) * self.workers

    def _told(self, made: B | _Broke, thing: A, lost: Callable[[A, str], B] | None) -> B:
        if not isinstance(made, _Broke):
            return made
        if lost is None:
            raise WorkersLost(self.url, made.why)
        return lost(thing, made.why)

    def _alone(self, work: Callable[..., B], number: int, thing: object, shared: Sequence[object]) -> B | _Broke:
        try:
            ((_, made),) = self._once(work, [(number, thing)], shared)
        except _Died as died:
            try:
                list(self._once(_nothing, [(0, None)], ()))
            except _Died as none:
                raise WorkersLost(self.url, str(none)) from none
            return _Broke(f"every worker that takes it dies: {died}")
        return made

    def _once(
        self, work: Callable[..., B], numbered: Sequence[tuple[int, A]], shared: Sequence[object]
    ) -> Iterator[tuple[int, B | _Broke]]:
        """Raises _Died where a worker died: what was yielded is done, the rest is not."""
        if self._backend is None:
            yield from (_done(each, None, work, *shared) for each in numbered)
            return
        size = self._at_once if self._lists else len(numbered)
        how = "list" if self._lists else "generator_unordered"
        ahead = _AHEAD * self.workers
        parent = os.getpid() if self._backend == "loky" else None
        parallel = _JOBLIB.Parallel(n_jobs=self.workers, return_as=how, batch_size=1, pre_dispatch=ahead)
        try:
            for start in range(0, len(numbered), size):
                some = numbered[start : start + size]
                made: Iterable[Any] = parallel(_JOBLIB.delayed(_done)(each, parent, work, *shared) for each in some)
                yield from made
        except (WorldError, GeneratorExit, KeyboardInterrupt):
            raise
        # each engine says it in its own way
        except Exception as error:
            said = str(error).strip() or type(error).__name__
            raise _Died(said.splitlines()[0][:200]) from error


class _Died(Exception):
    """A worker is gone."""


@dataclass(frozen=True)
class _Broke:
    """Instead of what is made of a thing."""

    why: str


def _done(numbered: tuple[int, Any], parent: int | None, work: Callable[..., Any], *shared: object) -> tuple[int, Any]:
    """In the worker."""
    number, thing = numbered
    if parent is not None and parent != os.getpid():
        _ends_with(parent)
    cv2.setNumThreads(1)
    try:
        # More threads may change last bits.
        with threadpool_limits(1):
            return number, work(thing, *shared)
    # whatever it is, it is of this thing
    except Exception as error:
        return number, _Broke(f"{type(error).__name__}: {error}")


@cache
def _ends_with(parent: int) -> None:
    """A worker whose parent is killed would wait for minutes for more. Ctrl-C is for the parent, which ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _nothing(thing: None) -> None:
    """Tells that there is a worker."""


@contextmanager
def open_executor(url: str) -> Generator[Executor]:
    """The executor that the url names, while this lasts.

    Raises UnknownExecutor, ExecutorMissing, ExecutorRefused.
    """
    scheme, _, place = url.partition(":")
    opens = {"serial": _serial, "processes": _processes, "dask": _dask, "ray": _ray}
    if scheme not in opens:
        raise UnknownExecutor(url)
    with ExitStack() as stack:
        yield opens[scheme](url, place.removeprefix("//"), stack)


def _serial(url: str, place: str, stack: ExitStack) -> Executor:
    if place:
        raise UnknownExecutor(url)
    return Executor(url, 1, None)


def _processes(url: str, place: str, stack: ExitStack) -> Executor:
    if place and not (place.isdecimal() and int(place) > 0):
        raise UnknownExecutor(url)
    count = int(place) if place else len(os.sched_getaffinity(0))
    stack.enter_context(_quiet_end())
    # Else they stay for minutes, and the next ones would have the environment of these.
    stack.callback(lambda: _LOKY.get_reusable_executor(reuse=True).shutdown(kill_workers=True))
    begins = {"initializer": _ends_with, "initargs": (os.getpid(),)}
    stack.enter_context(_JOBLIB.parallel_config("loky", n_jobs=count, inner_max_num_threads=1, **begins))
    return Executor(url, count, "loky")


@contextmanager
def _quiet_end() -> Generator[None]:
    """Where work is taken away from loky's thread, as by Ctrl-C, it may miss that work, and end with a traceback."""
    before = threading.excepthook

    def hook(broke: threading.ExceptHookArgs) -> None:
        missed = broke.thread is not None and broke.thread.name == "ExecutorManagerThread"
        if not (missed and issubclass(broke.exc_type, KeyError)):
            before(broke)

    threading.excepthook = hook
    try:
        yield
    finally:
        threading.excepthook = before


def _dask(url: str, place: str, stack: ExitStack) -> Executor:
    if not place:
        raise UnknownExecutor(url)
    distributed = _engine("dask", "distributed")
    try:
        client: Any = stack.enter_context(distributed.Client(f"tcp://{place}", timeout=_PATIENCE))
    except (OSError, ValueError) as error:
        raise ExecutorRefused(url, str(error).splitlines()[0]) from error
    workers = sum(client.nthreads().values())
    stack.enter_context(_JOBLIB.parallel_config("dask", n_jobs=max(1, workers)))
    return Executor(url, max(1, workers), "dask")


def _ray(url: str, place: str, stack: ExitStack) -> Executor:
    if not place:
        raise UnknownExecutor(url)
    ray = join_ray(place, url, log_to_driver=False, logging_level="error")
    stack.callback(ray.shutdown)
    _engine("ray", "ray.util.joblib").register_ray()
    workers = max(1, int(ray.cluster_resources().get("CPU", 1)))
    stack.enter_context(_JOBLIB.parallel_config("ray", n_jobs=workers))
    return Executor(url, workers, "ray")


def join_ray(place: str, url: str, **options: object) -> Any:
    """Ray, which has joined the cluster at `HOST:PORT` or `auto`; `url` is what errors call it.

    Raises ExecutorMissing, ExecutorRefused.
    """
    with _tried_once():
        ray = _engine("ray", "ray")
    host, _, port = place.rpartition(":")
    try:
        if host and port.isdecimal() and "://" not in place:
            # Said at once, where Ray would wait, and write lines of its own meanwhile.
            socket.create_connection((host.strip("[]"), int(port)), _PATIENCE).close()
        ray.init(address=place, **options)
    except OSError as error:
        raise ExecutorRefused(url, error.strerror or str(error).splitlines()[0]) from error
    except (OverflowError, ValueError, RuntimeError) as error:
        raise ExecutorRefused(url, str(error).splitlines()[0]) from error
    return ray


@contextmanager
def _tried_once() -> Generator[None]:
    """For this process only: nodes that somebody starts later may take their time."""
    if _RAY_TRIES in os.environ:
        yield
        return
    os.environ[_RAY_TRIES] = "1"
    try:
        yield
    finally:
        del os.environ[_RAY_TRIES]


def _engine(scheme: str, module: str) -> Any:
    """Imported when it is asked for: an engine that nobody uses need not be there."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ExecutorMissing(scheme, str(error)) from error
