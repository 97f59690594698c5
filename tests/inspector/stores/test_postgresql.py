"""The store on PostgreSQL."""

from __future__ import annotations

import shutil
from pathlib import Path
from queue import Queue

import psycopg
import pytest

from inspector.stores import open_store
from inspector.stores.errors import NewerStore, NotOwner, OlderServices, StoreNotOpened
from inspector.stores.records import Checkpoint
from inspector.stores.sql import migrating
from inspector.stores.sql.migrating import SCRIPTS
from tests.contracts.stores import (
    ONE_SENTENCE,
    DurableStoreContract,
    at_once,
    begin,
    behind,
    counted,
    engine,
    learnt,
    process,
    recipe,
)
from tests.patience import SECONDS, until
from tests.postgresql import Server

HAS_A_TURN = """
import sys
from inspector.stores import open_store
with open_store(sys.argv[1]) as store, store.only_one("tidy") as mine:
    print("mine" if mine else "not mine", flush=True)
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


NEXT = """
import sqlalchemy as sa
from alembic import op
revision, down_revision = "9000", {head!r}
def upgrade() -> None:
    op.add_column("products", sa.Column("more", sa.Text()))
"""


def test_tables_are_not_changed_under_services_of_an_older_program(
    postgresql: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = postgresql.new_database()
    with open_store(url) as older:
        older.join("0123", "station-4", 0)
        with psycopg.connect(url) as connection:
            ((head,),) = connection.execute("SELECT version_num FROM alembic_version").fetchall()
        scripts = shutil.copytree(migrating.SCRIPTS, tmp_path / "scripts")
        (scripts / "versions" / "9000_next.py").write_text(NEXT.format(head=head))
        monkeypatch.setattr(migrating, "SCRIPTS", scripts)
        # One that was killed does not stand in the way for longer than it takes to find out.
        monkeypatch.setattr(migrating, "ALIVE_SECONDS", 3600.0)
        with pytest.raises(
            OlderServices, match=rf"of revision {head}, .* needs 9000, .* \(station-4\); stop"
        ) as refused:
            open_store(url)
        assert ONE_SENTENCE.fullmatch(str(refused.value))
        older.beat("0123")
        older.leave("0123", "stopped")
        open_store(url).close()
        monkeypatch.setattr(migrating, "SCRIPTS", SCRIPTS)
        with pytest.raises(NewerStore, match="revision 9000"):
            open_store(url)


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


def test_what_is_told_is_heard_by_all_or_by_those_named(postgresql: Server) -> None:
    url = postgresql.new_database()
    heard: dict[str, Queue[bytes | None]] = {"n1": Queue(), "n2": Queue()}
    bodies = [b"{}", "gr\u00fcn".encode(), b"#1", b"\0", b"", b"x" * 7899, b"x" * 7900, bytes(range(256)) * 4000]
    with open_store(url) as one, open_store(url) as other:
        with one.listen("n1", heard["n1"].put), other.listen("n2", heard["n2"].put):
            for body in bodies:
                one.tell(body)
            other.tell(b"to one", ["n1"])
            other.tell(b"to both" * 2000, ["n1", "n2"])
            other.tell(b"to none", [])
            one.tell(b"the end")
            last = [b"to both" * 2000, b"the end"]
            for name, own in (("n1", [b"to one"]), ("n2", [])):
                expected = [*bodies, *own, *last]
                assert [heard[name].get(timeout=SECONDS) for _ in expected] == expected
        one.tell(b"too late")
        assert heard["n1"].empty()
        assert counted(one, "told") == 5
        behind(one, "UPDATE told SET told_ns = told_ns - 61000000000")
    with open_store(url) as third:
        third.tell(b"\0")
        assert counted(third, "told") == 1


def test_who_hears_is_told_that_something_may_be_missing(postgresql: Server) -> None:
    heard: Queue[bytes | None] = Queue()
    with open_store(postgresql.new_database()) as store, store.listen("n1", heard.put):
        store.tell(b"before")
        assert heard.get(timeout=SECONDS) == b"before"
        terminate(postgresql)
        assert heard.get(timeout=SECONDS) is None
        store.tell(b"after")
        assert heard.get(timeout=SECONDS) == b"after"


def test_a_turn_goes_with_the_process_that_has_it(postgresql: Server) -> None:
    url = postgresql.new_database()
    with process(HAS_A_TURN, url) as holder, open_store(url) as store:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "mine\n"
        with store.only_one("tidy") as mine:
            assert not mine
        holder.kill()
        holder.wait()

        def is_free() -> bool:
            with store.only_one("tidy") as mine:
                return mine

        # The server sees a moment later that nobody is there any more.
        until(is_free)


def test_a_checkpoint_is_saved_before_an_inspection_is_taken_or_not_at_all(postgresql: Server) -> None:
    url = postgresql.new_database()
    with open_store(url) as one, open_store(url) as other:
        learnt(one)
        for k in range(10):
            begin(one, f"i{k}", node="n1")
            saved, taken = at_once(
                lambda j, k=k: (
                    one.save_checkpoint(f"i{k}", "n1", 0, b"state", b"")
                    if j == 0
                    else other.take_inspection(f"i{k}", "n2")[1]
                ),
                2,
            )
            assert (type(saved), taken) in [(NotOwner, None), (type(None), Checkpoint(b"state", (b"",)))]
