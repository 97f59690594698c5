"""The service on PostgreSQL: the same, but for what a database of its own cannot promise."""

from __future__ import annotations

import asyncio
from pathlib import Path

from inspector.service.service import Service
from inspector.settings import Settings
from tests.postgresql import Server


def test_two_services_share_a_database(postgresql: Server, tmp_path: Path) -> None:
    url = postgresql.new_database()
    one, other = (
        Service(Settings.model_validate({"data": tmp_path / name, "database": url, "scorers": 1})) for name in "ab"
    )

    async def both() -> None:
        await one.start()
        try:
            assert await one.troubles() == []
            await other.start()
            assert await other.troubles() == []
            await other.stop("test")
            assert await one.troubles() == []
        finally:
            await one.stop("test")

    asyncio.run(both())
