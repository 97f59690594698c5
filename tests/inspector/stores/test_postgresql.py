"""The store on PostgreSQL."""

from __future__ import annotations

import psycopg
import pytest

from inspector.stores import open_store
from inspector.stores.base import StoreNotOpened
from tests.contracts.stores import ONE_SENTENCE, DurableStoreContract, at_once, engine, learnt, recipe
from tests.postgresql import Server


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
        with psycopg.connect(postgresql.url(), autocommit=True) as connection:
            others = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE application_name = 'inspector'"
            assert connection.execute(others).fetchall()
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
