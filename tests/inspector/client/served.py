"""A service that listens, and a way to it that breaks: for the tests of those who ask over a network."""

from __future__ import annotations

import random
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import httpx2
import uvicorn
from structlog.testing import capture_logs

from api.app import create_app
from inspector.service.service import Service
from inspector.settings import read_settings


@contextmanager
def served(data: Path, **settings: object) -> Iterator[tuple[str, Service]]:
    """The url of a service that runs in a thread, and the service itself."""
    app = create_app(read_settings(data=data, **({"scorers": 1} | settings)))
    with _listening() as listening, capture_logs():
        server = uvicorn.Server(
            uvicorn.Config(app, loop="asyncio", log_config=None, timeout_graceful_shutdown=5, lifespan="on")
        )
        thread = threading.Thread(target=server.run, args=([listening],))
        thread.start()
        try:
            url = f"http://127.0.0.1:{listening.getsockname()[1]}"
            # Answered as soon as it runs: the socket listens already.
            assert httpx2.get(f"{url}/livez", timeout=30, trust_env=False).is_success
            yield url, app.state.service
        finally:
            server.should_exit = True
            thread.join()


class BrokenWay:
    """A port that leads to a service, over connections that break after some bytes, each way; the same every time."""

    def __init__(self, url: str, seed: int, most: int) -> None:
        """`most`: bytes after which every connection is gone."""
        self._to = int(url.rpartition(":")[2])
        self._random, self._most = random.Random(seed), most
        self.breaks = 0
        self._stack = ExitStack()

    def __enter__(self) -> str:
        self._listening = self._stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        self._accepting = threading.Thread(target=self._accept)
        self._accepting.start()
        return f"http://127.0.0.1:{self._listening.getsockname()[1]}"

    def __exit__(self, *_: object) -> None:
        self._closing = True
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._accepting.join()
        self._stack.close()

    _closing = False

    def _accept(self) -> None:
        with ExitStack() as threads:
            while True:
                try:
                    near, _ = self._listening.accept()
                except OSError:
                    return
                far = socket.create_connection(("127.0.0.1", self._to))
                for each in (near, far):
                    threads.enter_context(each)
                for one, other in ((near, far), (far, near)):
                    budget = self._random.randrange(self._most // 8, self._most)
                    thread = threading.Thread(target=self._carry, args=(one, other, budget))
                    thread.start()
                    threads.callback(thread.join)
                threads.callback(_cut, near, far)

    def _carry(self, one: socket.socket, other: socket.socket, budget: int) -> None:
        with suppress(OSError):
            while budget > 0 and (data := one.recv(min(65536, budget))):
                other.sendall(data)
                budget -= len(data)
        if budget <= 0:
            self.breaks += 1
        _cut(one, other)


class Switch:
    """A port that leads to one service or another; what leads to the one before is cut when it is switched."""

    def __init__(self, url: str) -> None:
        self._to = url
        self._open: list[socket.socket] = []
        self._stack = ExitStack()

    def __enter__(self) -> Switch:
        self._listening = self._stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        accepting = threading.Thread(target=self._accept)
        accepting.start()
        self._stack.callback(accepting.join)
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        _cut(*self._open)
        self._stack.close()

    def to(self, url: str) -> None:
        """From now on."""
        self._to, before, self._open = url, self._open, []
        _cut(*before)

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
                self._open += [near, far]
                for one, other in ((near, far), (far, near)):
                    thread = threading.Thread(target=_carried, args=(one, other))
                    thread.start()
                    threads.callback(thread.join)


def _carried(one: socket.socket, other: socket.socket) -> None:
    with suppress(OSError):
        while data := one.recv(65536):
            other.sendall(data)
    _cut(one, other)


def _cut(*sockets: socket.socket) -> None:
    for each in sockets:
        with suppress(OSError):
            each.shutdown(socket.SHUT_RDWR)


def _listening() -> socket.socket:
    # Named as TCP: asyncio sends answers at once only where the socket says that it is.
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listening.bind(("127.0.0.1", 0))
    listening.listen()
    return listening
