"""The same app as a Ray Serve deployment: a service in each replica, an inspection always with the same one.

    python -m api.cluster --replicas 4

Settings are those of `inspector serve`, in the environment. Ray starts on this machine, or is joined where RAY_ADDRESS
says that there is one; its own commands and files name `api.cluster:app`. Replicas share a database and the place of
finished files. Each has a folder of its own below `data`, and takes the one that a dead one left.

inspector.errors.WorldError
├── RayMissing               Ray is not installed
└── NotServed                Ray Serve does not start what it should
"""

from __future__ import annotations

import argparse
import asyncio
import os
import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from importlib import import_module
from itertools import count
from typing import Any

from fastapi import FastAPI

from api.app import create_app
from inspector.errors import WorldError
from inspector.executors import join_ray
from inspector.service.folder import FolderInUse
from inspector.service.service import Service
from inspector.serving import keep_logs
from inspector.settings import SettingRefused, Settings, read_settings
from inspector.stores import open_store

ROUTER = "ray.serve.experimental.consistent_hash_router:ConsistentHashRouter"
"""By the header X-Session-Id, which is the id of the inspection."""
REQUESTS = 1000
"""Of one replica at once; a stream is one for as long as it is open."""
STOP_SECONDS = 3.0
"""That a replica waits for open streams before it ends; what ran in it goes on elsewhere, from what it saved last."""
_OBJECTS = 128 << 20
"""Bytes of memory that Ray's processes share, where Ray is started here: nothing large goes through it."""


class RayMissing(WorldError):
    """Ray is not installed."""

    def __init__(self, why: str) -> None:
        super().__init__(f"Ray Serve is not installed here ({why}): pip install 'sweep-inspector[cluster]'")


class NotServed(WorldError):
    """Ray Serve does not start what it should."""

    def __init__(self, why: str) -> None:
        super().__init__(f"Ray Serve does not start the service: {why}; what its processes said is above")


class Replica:
    """One service. What Ray makes of it answers requests."""

    async def __init__(self, settings: Settings) -> None:
        keep_logs(settings.log_level)
        self._service = await started(settings)
        token = await asyncio.to_thread(self._service.access.make_first)
        if token is not None:
            print(f"the first token, of an admin; it is told this once: {token}", flush=True)

    def __serve_build_asgi_app__(self) -> FastAPI:
        return create_app(service=self._service)


async def started(settings: Settings) -> Service:
    """A service that runs, on the first folder below `data` that nobody works on."""
    for number in count():
        service = Service(settings.model_copy(update={"data": settings.data / f"replica-{number}"}))
        try:
            await service.start()
        except FolderInUse:
            continue
        return service
    raise AssertionError


def application(settings: Settings, replicas: int) -> Any:
    """What Ray Serve runs. Raises RayMissing, SettingRefused."""
    if replicas > 1 and not settings.database_url.startswith("postgresql"):
        raise SettingRefused("database", None, f"{replicas} replicas share one; allowed is postgresql://…")
    if replicas > 1 and settings.files is None:
        raise SettingRefused("files", None, f"{replicas} replicas share one; allowed are s3://… and file:///…")
    serve = _ray("ray.serve")
    deployment = serve.deployment(
        name="inspector",
        num_replicas=replicas,
        max_ongoing_requests=REQUESTS,
        graceful_shutdown_wait_loop_s=STOP_SECONDS / 6,
        graceful_shutdown_timeout_s=STOP_SECONDS,
        # So that they are spread over machines as the processes that score need it.
        ray_actor_options={"num_cpus": settings.scorers},
        # A line for every frame would be two millions a day and camera.
        logging_config={"enable_access_log": False, "log_level": "WARNING"},
        request_router_config=_ray("ray.serve.config").RequestRouterConfig(request_router_class=ROUTER),
    )
    return deployment(serve.ingress()(Replica)).bind(settings)


def app(arguments: Mapping[str, str]) -> Any:
    """For `serve run api.cluster:app replicas=4` and Ray's configuration files; settings from the environment."""
    return application(read_settings(), _count(arguments.get("replicas", "1")))


def _count(text: str) -> int:
    """How many replicas. Raises ArgumentTypeError."""
    if not text.isascii() or not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not allowed; allowed is a whole number above 0")
    return int(text)


def main(arguments: Sequence[str]) -> None:
    """Serve at INSPECTOR_HOST and INSPECTOR_PORT, on every machine of the cluster, until this is interrupted.

    Raises RayMissing, SettingRefused, StoreNotOpened, ExecutorRefused, NotServed.
    """
    parser = argparse.ArgumentParser(
        prog="python -m api.cluster", description="Several services behind one address, by Ray Serve."
    )
    parser.add_argument("--replicas", type=_count, default=1, metavar="N", help="services, each with its scorers")
    replicas = parser.parse_args(arguments).replicas
    settings = read_settings()
    served = application(settings, replicas)
    ray, serve = _ray("ray"), _ray("ray.serve")
    if settings.database_url.startswith("postgresql"):
        # What is wrong with it is said here once, instead of by each replica in the words of Ray.
        open_store(settings.database_url).close()
    if address := os.environ.get("RAY_ADDRESS"):
        join_ray(address, address)
    else:
        cores = replicas * settings.scorers
        ray.init("local", num_cpus=cores, object_store_memory=_OBJECTS, include_dashboard=False)
    asked_to_end = threading.Event()

    def end(number: int, frame: object) -> None:
        asked_to_end.set()

    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, end)
    try:
        serve.start(proxy_location="EveryNode", http_options={"host": settings.host, "port": settings.port})
        serve.run(served)
    except RuntimeError as error:
        raise NotServed(str(error).strip().splitlines()[-1]) from error
    print(f"inspector serves at http://{settings.host}:{settings.port}", flush=True)
    asked_to_end.wait()
    serve.shutdown()
    ray.shutdown()


def _ray(module: str) -> Any:
    """Its types say less than they should."""
    try:
        return import_module(module)
    except ImportError as error:
        raise RayMissing(str(error)) from error


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except WorldError as error:
        sys.exit(f"inspector: {error}")
