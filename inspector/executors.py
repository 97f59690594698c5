"""Executors: where the work of a batch is done, chosen by url: `open_executor("processes:4")`, `"dask://host:8786"`.

inspector.errors.WorldError
├── UnknownExecutor          a url that names none
├── ExecutorMissing          an engine that is not installed
├── ExecutorRefused          a cluster that does not answer
└── WorkersLost              workers died, again and again
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from typing import Any, TypeVar

import joblib

from inspector.errors import WorldError

# Its stubs know less than it does.
_JOBLIB: Any = joblib
A = TypeVar("A")
B = TypeVar("B")
EXECUTORS = {
    "serial": "serial, one after the other in this process",
    "processes": "processes or processes:N on this machine",
    "dask": "dask://HOST:PORT, a Dask cluster",
    "ray": "ray://auto or ray://HOST:PORT, a Ray cluster",
}
_EXTRA = {"dask": "dask", "ray": "cluster"}
_AHEAD = 2
"""Pieces of work handed out for each worker."""
_PATIENCE = 20
"""Seconds that a cluster may take to answer."""
_AT_ONCE = 8
"""Pieces of work for each worker that are told of together, where an engine cannot tell of each."""


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


class Executor:
    """Does the same to each of many things, several at a time."""

    def __init__(self, url: str, workers: int, backend: str | None) -> None:
        self.url, self.workers = url, workers
        self._backend = backend

    def each(self, work: Callable[[A], B], things: Sequence[A]) -> Iterator[B]:
        """What `work`, a function of a module, makes of each thing, in the order in which they are done.

        Raises WorkersLost where a worker died: what was yielded is done, the rest is not.
        """
        if self._backend is None:
            yield from map(work, things)
            return
        # Ray's back end gives lists only.
        lists = self._backend == "ray"
        size = _AT_ONCE * self.workers if lists else max(1, len(things))
        how = "list" if lists else "generator_unordered"
        ahead = _AHEAD * self.workers
        parallel = _JOBLIB.Parallel(n_jobs=self.workers, return_as=how, batch_size=1, pre_dispatch=ahead)
        try:
            for start in range(0, len(things), size):
                made: Iterable[Any] = parallel(_JOBLIB.delayed(work)(each) for each in things[start : start + size])
                yield from made
        except (WorldError, GeneratorExit, KeyboardInterrupt):
            raise
        # each engine says it in its own way; `work` itself raises nothing that is expected
        except Exception as error:
            raise WorkersLost(f"{self.url}: workers were lost: {str(error).splitlines()[0][:200]}") from error


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
    stack.enter_context(_JOBLIB.parallel_config("loky", n_jobs=count, inner_max_num_threads=1))
    return Executor(url, count, "loky")


def _dask(url: str, place: str, stack: ExitStack) -> Executor:
    distributed = _engine("dask", "distributed")
    try:
        client: Any = stack.enter_context(distributed.Client(f"tcp://{place}", timeout=_PATIENCE))
    except (OSError, ValueError) as error:
        raise ExecutorRefused(url, str(error).splitlines()[0]) from error
    workers = sum(client.nthreads().values())
    stack.enter_context(_JOBLIB.parallel_config("dask", n_jobs=max(1, workers)))
    return Executor(url, max(1, workers), "dask")


def _ray(url: str, place: str, stack: ExitStack) -> Executor:
    ray = _engine("ray", "ray")
    try:
        ray.init(address=place, log_to_driver=False, logging_level="error")
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise ExecutorRefused(url, str(error).splitlines()[0]) from error
    stack.callback(ray.shutdown)
    _engine("ray", "ray.util.joblib").register_ray()
    workers = max(1, int(ray.cluster_resources().get("CPU", 1)))
    stack.enter_context(_JOBLIB.parallel_config("ray", n_jobs=workers))
    return Executor(url, workers, "ray")


def _engine(scheme: str, module: str) -> Any:
    """Imported when it is asked for: an engine that nobody uses need not be there."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ExecutorMissing(scheme, str(error)) from error
