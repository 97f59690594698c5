"""The server process: a socket, logs, and an end at which what is in flight is finished first.

inspector.errors.WorldError
└── AddressRefused           an address or a port that cannot be listened at
"""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import signal
import socket
import ssl
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

import structlog
import uvicorn
from uvicorn.importer import import_from_string

from inspector.errors import WorldError
from inspector.service.service import Service
from inspector.settings import SettingRefused, Settings

APP = "api.app:create_app"
"""Named, not imported: `api` stands on this package."""
GRACE_SECONDS = 20
"""How long the end may take: of the service, and then of the connections, a quarter of it."""
BACKLOG = 256
_SWITCH_SECONDS = 0.0005
_log = structlog.get_logger("inspector")


class AddressRefused(WorldError):
    """An address or a port that cannot be listened at."""

    def __init__(self, host: str, port: int, why: str) -> None:
        super().__init__(f"cannot listen at {host}, port {port}: {why}; name another with --host or --port")


def serve(settings: Settings, say: Callable[[str], object]) -> None:
    """Serve until SIGINT or SIGTERM; `say` is told where, once the first request may come.

    Raises AddressRefused, SettingRefused, FolderInUse, FolderRefused, StoreError.
    """
    _check_tls(settings)
    with _bound(settings.host, settings.port) as listener:
        keep_logs(settings.log_level)
        app: Any = import_from_string(APP)(settings)
        config = uvicorn.Config(
            app,
            log_config=None,
            access_log=False,
            lifespan="on",
            proxy_headers=False,
            server_header=False,
            # JPEG does not get smaller, and a small message may not become a large one.
            ws_per_message_deflate=False,
            ws_max_size=settings.max_body + 1024,
            ws_max_queue=settings.window,
            backlog=BACKLOG,
            timeout_graceful_shutdown=GRACE_SECONDS // 4,
            ssl_certfile=settings.tls_cert,
            ssl_keyfile=settings.tls_key,
        )
        _Server(config, app.state.service, lambda: say(_told(settings, listener))).run(sockets=[listener])


class _Server(uvicorn.Server):
    """Starts the service before it listens, and stops it before it lets go of connections."""

    def __init__(self, config: uvicorn.Config, service: Service, on_ready: Callable[[], object]) -> None:
        super().__init__(config)
        self._service, self._on_ready = service, on_ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await self._service.start()
        await super().startup(sockets)
        # What is there now stays: to look through all of it for rubbish would hold up frames for a tenth of a second.
        gc.freeze()
        # A thread that reads a list may hold the interpreter no longer than that while a frame waits.
        sys.setswitchinterval(_SWITCH_SECONDS)
        self._on_ready()
        token = await asyncio.to_thread(self._service.access.make_first)
        if token is not None:
            print(f"the first token, of an admin; it is told this once: {token}", flush=True)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        for server in self.servers:
            server.close()
        stopping = asyncio.ensure_future(self._service.stop("asked to"))
        until = time.monotonic() + GRACE_SECONDS
        while not (stopping.done() or self.force_exit or time.monotonic() > until):
            await asyncio.wait({stopping}, timeout=0.1)
        await super().shutdown(sockets)
        if not stopping.done():
            # Threads that wait, as for a database that does not answer, would be waited for without end. Scorers close
            # their recordings when this process is gone, and other services take what it had.
            _log.error("not stopped in time", seconds=round(time.monotonic() - until + GRACE_SECONDS, 1))
            os._exit(1)

    @contextmanager
    def capture_signals(self) -> Generator[None]:
        """A service that was asked to end, and did, has not failed: its exit code is 0."""
        kinds = (signal.SIGINT, signal.SIGTERM)
        before = [signal.signal(kind, self.handle_exit) for kind in kinds]
        try:
            yield
        finally:
            for kind, handler in zip(kinds, before, strict=True):
                signal.signal(kind, handler)


@contextmanager
def _bound(host: str, port: int) -> Generator[socket.socket]:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]  # fmt: skip
        listener = socket.socket(family, kind, protocol)
    except OSError as error:
        raise AddressRefused(host, port, error.strerror or str(error)) from error
    with listener:
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
        except OSError as error:
            raise AddressRefused(host, port, error.strerror or str(error)) from error
        yield listener


def _told(settings: Settings, listener: socket.socket) -> str:
    host, port = listener.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    return f"http{'s' if settings.tls_cert else ''}://{shown}:{port}"


def _check_tls(settings: Settings) -> None:
    if settings.tls_key is not None and settings.tls_cert is None:
        raise SettingRefused("tls_key", str(settings.tls_key), "it goes with tls_cert, the certificate")
    if settings.tls_cert is not None:
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(settings.tls_cert, settings.tls_key)
        except OSError as error:
            why = f"{error.strerror or error}; allowed is a certificate with its key, PEM"
            raise SettingRefused("tls_cert", str(settings.tls_cert), why) from error


def keep_logs(level: str) -> None:
    """Everything that is logged goes to stderr: for people on a terminal, else a line of JSON each."""
    shared: list[Any] = [
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
    ]
    structlog.configure(
        processors=[
            structlog.stdlib.filter_by_level,
            *shared,
            structlog.stdlib.ProcessorFormatter.wrap_for_formatter,
        ],
        logger_factory=structlog.stdlib.LoggerFactory(),
        cache_logger_on_first_use=True,
    )
    shown = structlog.dev.ConsoleRenderer() if sys.stderr.isatty() else structlog.processors.JSONRenderer()
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, shown],
        )
    )
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    for noisy in ("uvicorn", "uvicorn.error", "alembic"):
        logging.getLogger(noisy).setLevel(max(logging.WARNING, root.level))
