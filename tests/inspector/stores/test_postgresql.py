"""The store on PostgreSQL."""

from __future__ import annotations

from contextlib import suppress

import psycopg
import pytest

from inspector.stores import open_store
from inspector.stores.base import StoreInUse, StoreNotOpened
from tests.contracts.stores import ONE_SENTENCE, DurableStoreContract, at_once, engine, learnt, process, recipe
from tests.postgresql import Server

RESERVES = """
import sys
from inspector.stores import open_store
store = open_store(sys.argv[1])
store.reserve()
print("reserved", flush=True)
sys.stdin.readline()
"""


def terminate(postgresql: Server) -> None:
    """The server lets all connections of stores go, as it does when it is started again."""
    with psycopg.connect(postgresql.url(), autocommit=True) as connection:
        others = "SELECT pg_terminate_backend(pid, 10000) FROM pg_stat_activity WHERE application_name = 'inspector'"
        assert connection.execute(others).fetchall()


class TestPostgresqlContract(DurableStoreContract):
    @pytest.fixture
    def url(self, postgresql: Server) -> str:
        return postgresql.new_database()


def test_a_database_that_is_not_there_is_said(postgresql: Server) -> None:
    with pytest.raises(StoreNotOpened, match='database "nothing" does not exist') as refused:
        open_store(postgresql.url("nothing"))
    assert ONE_SENTENCE.fullmatch(str(refused.value))


def test_a_server_that_was_away_is_found_again(postgresql: Server) -> None:
    url = postgresql.new_database()
    with open_store(url) as store:
        learnt(store)
        terminate(postgresql)
        assert store.product("plate").product_id == "plate"


def test_two_services_add_recipes_at_once(postgresql: Server) -> None:
    url = postgresql.new_database()
    with open_store(url) as one, open_store(url) as other:
        learnt(one)
        added = at_once(lambda k: recipe((one, other)[k % 2], f"r{k}"), 16)
        assert [each for each in added if isinstance(each, Exception)] == []
        assert [each.version for each in one.recipes("plate").items] == list(range(16, 0, -1))
        assert [each.active for each in other.recipes("plate").items] == [True] + [False] * 15


def test_connections_are_bounded(postgresql: Server) -> None:
    with open_store(postgresql.new_database()) as store:
        assert not any(isinstance(each, Exception) for each in at_once(lambda k: store.products(), 40))
        assert engine(store).pool.checkedout() == 0
        with psycopg.connect(postgresql.url()) as connection:
            counted = connection.execute(
                "SELECT count(*) FROM pg_stat_activity WHERE application_name = 'inspector' AND datname = %s",
                [engine(store).url.database],
            ).fetchone()
        assert counted is not None
        assert 1 <= counted[0] <= 8


def test_a_second_service_is_refused_as_long_as_the_first_is_there(postgresql: Server) -> None:
    url = postgresql.new_database()
    with open_store(url) as one, open_store(url) as other:
        one.reserve()
        one.reserve()
        for _ in range(2):
            one.ping()
            with pytest.raises(StoreInUse, match="another service works on it") as refused:
                other.reserve()
            terminate(postgresql)
        assert ONE_SENTENCE.fullmatch(str(refused.value))
        other.reserve()
        with pytest.raises(StoreInUse):
            one.ping()
        other.close()
        one.ping()
    with open_store(url) as third:
        third.reserve()


def test_a_service_that_was_killed_holds_nothing(postgresql: Server) -> None:
    url = postgresql.new_database()
    with process(RESERVES, url) as holder, open_store(url) as store:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "reserved\n"
        with pytest.raises(StoreInUse):
            store.reserve()
        holder.kill()
        holder.wait()
        for _ in range(1000):
            # The server sees a moment later that nobody is there any more.
            with suppress(StoreInUse):
                store.reserve()
                return
    raise AssertionError("the lock of a process that is gone is still held")
