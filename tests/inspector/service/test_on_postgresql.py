"""The service on PostgreSQL: the same, but for what a database of its own cannot promise."""

from __future__ import annotations

import asyncio
from pathlib import Path

from inspector.service.access import Access
from inspector.service.service import Service
from inspector.settings import Settings
from inspector.stores import open_store
from tests.contracts.stores import at_once
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
            known = [{node.node_id for node in service.peers.nodes} for service in (one, other)]
            assert known[0] >= {one.peers.node_id}
            assert known[1] == {one.peers.node_id, other.peers.node_id}
            await other.stop("test")
            assert await one.troubles() == []
        finally:
            await one.stop("test")

    asyncio.run(both())


def test_of_services_that_start_at_once_one_makes_the_first_token(postgresql: Server) -> None:
    url = postgresql.new_database()
    with open_store(url) as one, open_store(url) as other:
        makers = [Access((one, other)[k % 2], asks_for_tokens=True) for k in range(8)]
        made = at_once(lambda k: makers[k].make_first(), 8)
        assert sorted(type(each).__name__ for each in made) == ["NoneType"] * 7 + ["str"]
        assert len(one.tokens()) == 1
