"""A service that listens, and a way to it that breaks: for the tests of those who ask over a network."""

from __future__ import annotations

import random
import socket
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Self

import uvicorn
from structlog.testing import capture_logs

from api.app import create_app
from inspector.service.service import Service
from inspector.settings import read_settings
from tests import patience


@contextmanager
def served(data: Path, port: int = 0, **settings: object) -> Iterator[tuple[str, Service]]:
    """The url of a service that runs in a thread, and the service itself; at that port, where one is named."""
    app = create_app(read_settings(data=data, **({"scorers": 1} | settings)))
    with _listening(port) as listening, capture_logs():
        server = uvicorn.Server(
            uvicorn.Config(app, loop="asyncio", log_config=None, timeout_graceful_shutdown=5, lifespan="on")
        )
        thread = threading.Thread(target=server.run, args=([listening],))
        thread.start()
        try:
            url = f"http://127.0.0.1:{listening.getsockname()[1]}"
            # Answered as soon as it runs: the socket listens already.
            assert patience.get(f"{url}/livez").is_success
            yield url, app.state.service
        finally:
            server.should_exit = True
            thread.join()


class _Way(ABC):
    """A port that leads to a service: every connection to it goes on over another one."""

    def __init__(self, url: str) -> None:
        self._to = url
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self._listening = self._stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        accepting = threading.Thread(target=self._accept)
        accepting.start()
        self._stack.callback(accepting.join)
        return self

    def __exit__(self, *_: object) -> None:
        # The thread that accepts is woken, and cuts what is open.
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._stack.close()

    def _accept(self) -> None:
        with ExitStack() as threads:
            while True:
                try:
                    near, _ = self._listening.accept()
                except OSError:
                    return
                threads.enter_context(near)
                try:
                    far = socket.create_connection(("127.0.0.1", int(self._to.rpartition(":")[2])))
                except OSError:
                    # Nobody is there just now: said as a port would say it that leads nowhere.
                    _cut(near)
                    continue
                threads.enter_context(far)
                for carry in self._carriers(near, far):
                    thread = threading.Thread(target=carry)
                    thread.start()
                    threads.callback(thread.join)
                threads.callback(_cut, near, far)

    @abstractmethod
    def _carriers(self, near: socket.socket, far: socket.socket) -> Iterable[Callable[[], object]]:
        """What carries bytes from one to the other, and the other way; each in a thread."""


class BrokenWay(_Way):
    """Its connections break after some bytes, each way; the same every time."""

    def __init__(self, url: str, seed: int, most: int) -> None:
        """`most`: bytes after which every connection is gone."""
        super().__init__(url)
        self._random, self._most = random.Random(seed), most
        self.breaks = 0

    def _carriers(self, near: socket.socket, far: socket.socket) -> Iterator[Callable[[], object]]:
        for one, other in ((near, far), (far, near)):
            yield partial(self._carry, one, other, self._random.randrange(self._most // 8, self._most))

    def _carry(self, one: socket.socket, other: socket.socket, budget: int) -> None:
        with suppress(OSError):
            while budget > 0 and (data := one.recv(min(65536, budget))):
                other.sendall(data)
                budget -= len(data)
        if budget <= 0:
            self.breaks += 1
        _cut(one, other)


class Switch(_Way):
    """It leads to one service or another; what leads to the one before is cut when it is switched."""

    def __init__(self, url: str) -> None:
        super().__init__(url)
        self._open: list[socket.socket] = []

    def to(self, url: str) -> None:
        """From now on."""
        self._to, before, self._open = url, self._open, []
        _cut(*before)

    def _carriers(self, near: socket.socket, far: socket.socket) -> Iterator[Callable[[], object]]:
        self._open += [near, far]
        yield from (partial(_carried, near, far), partial(_carried, far, near))


def _carried(one: socket.socket, other: socket.socket) -> None:
    with suppress(OSError):
        while data := one.recv(65536):
            other.sendall(data)
    _cut(one, other)


def _cut(*sockets: socket.socket) -> None:
    for each in sockets:
        with suppress(OSError):
            each.shutdown(socket.SHUT_RDWR)


def _listening(port: int) -> socket.socket:
    # Named as TCP: asyncio sends answers at once only where the socket says that it is.
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listening.bind(("127.0.0.1", port))
    listening.listen()
    return listening
