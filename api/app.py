"""create_app: the service as an ASGI application, made from its settings; nothing global."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import Any

from anyio.to_thread import current_default_thread_limiter
from fastapi import FastAPI

from api import (
    audit,
    batches,
    dispositions,
    docs,
    errors,
    events,
    health,
    inspecting,
    inspections,
    jobs,
    learning,
    me,
    page,
    pictures,
    products,
    recipes,
    rejudge,
    replays,
    station,
    stream,
    sweeps,
    tokens,
    tracking,
    trends,
    workspaces,
)
from api.deps import in_thread
from api.guard import Guard
from api.schemas import Problem
from api.shared import Shared
from inspector.service.service import Service
from inspector.settings import Settings, read_settings

ROUTERS = (
    health.router,
    products.router,
    sweeps.router,
    learning.router,
    jobs.router,
    recipes.router,
    rejudge.router,
    inspecting.router,
    dispositions.router,
    inspections.router,
    pictures.router,
    stream.router,
    replays.router,
    batches.router,
    workspaces.router,
    tracking.router,
    trends.router,
    station.router,
    events.router,
    audit.router,
    tokens.router,
    me.router,
    page.router,
)
THREADS = 2
"""That read and write for requests."""
ALWAYS: dict[int | str, dict[str, Any]] = {
    400: {"model": Problem, "description": "The body cannot be read."},
    401: {"model": Problem, "description": "A token is needed, or this one is not known."},
    403: {"model": Problem, "description": "This token's role is not enough, or the request comes from elsewhere."},
    413: {"model": Problem, "description": "The body is larger than allowed."},
    422: {"model": Problem, "description": "Something in the request is not allowed."},
    503: {"model": Problem, "description": "Not now: try again after the seconds in `Retry-After`."},
}


def create_app(settings: Settings | None = None, service: Service | None = None) -> FastAPI:
    """The application. Its service starts with it, and stops with it, unless somebody does that before."""
    service = service or Service(settings or read_settings())

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[None]:
        await service.start()
        # More of them would only take the interpreter away from the frames.
        current_default_thread_limiter().total_tokens = THREADS
        # What is imported when a thread is asked for the first time would hold up frames.
        await in_thread(int)
        try:
            yield
        finally:
            await service.stop("the server ends")

    app = FastAPI(
        title="Sweep Inspector",
        version=version("sweep-inspector"),
        description="Learn one golden sweep, inspect every part after. Lists are newest first.",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
    )
    app.state.service = service
    app.state.shared = Shared(service.events)
    app.state.dashboard = page.read_files()
    app.add_middleware(Guard, service=service)
    errors.install(app)
    for router in ROUTERS:
        app.include_router(router, responses=ALWAYS if router is not health.router else None)
    docs.install(app)
    # Makes every route ready, which else the first request does, and holds up frames meanwhile.
    app.openapi()
    return app
