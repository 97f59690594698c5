"""The store in a file of SQLite."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from inspector.stores import open_store
from inspector.stores.errors import StoreFailed, StoreNotOpened
from tests.contracts.stores import ONE_SENTENCE, DurableStoreContract, behind, engine


class TestSqliteContract(DurableStoreContract):
    @pytest.fixture
    def url(self, tmp_path: Path) -> str:
        return f"sqlite:{tmp_path}/100 % data?.sqlite"


@pytest.mark.parametrize("form", ["sqlite:{}", "sqlite:///{}"])
def test_a_path_may_be_written_as_sqlalchemy_has_it(tmp_path: Path, form: str) -> None:
    path = tmp_path / "here.sqlite"
    with open_store(form.format(path)) as store:
        store.ensure_product("plate", 1)
    assert path.read_bytes().startswith(b"SQLite format 3")


def test_a_new_file_is_its_owners_alone(tmp_path: Path) -> None:
    with open_store(f"sqlite:{tmp_path}/here.sqlite") as store:
        store.ensure_product("plate", 1)
        modes = {file.name: file.stat().st_mode & 0o777 for file in tmp_path.iterdir()}
        assert modes == dict.fromkeys(["here.sqlite", "here.sqlite-wal", "here.sqlite-shm"], 0o600)


def test_every_connection_writes_ahead_syncs_and_keeps_references(tmp_path: Path) -> None:
    with open_store(f"sqlite:{tmp_path}/here.sqlite") as store:
        with engine(store).connect() as one, engine(store).connect() as two:
            for connection in (one, two):
                asked = ("journal_mode", "synchronous", "foreign_keys", "busy_timeout")
                told = [connection.exec_driver_sql(f"PRAGMA {name}").scalar() for name in asked]
                assert told == ["wal", 2, 1, 30_000]
        with pytest.raises(Exception, match="FOREIGN KEY"):
            behind(store, "INSERT INTO scores VALUES ('nothing', '')")


def test_readers_do_not_wait_for_a_writer(tmp_path: Path) -> None:
    with open_store(f"sqlite:{tmp_path}/here.sqlite") as store, engine(store).connect() as connection:
        connection.execution_options(writing=True).exec_driver_sql("UPDATE products SET ok_count = 0")
        assert store.products().items == ()


def test_no_such_folder_no_file_and_not_a_database_are_said(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("not a database, but longer than its header would be " * 10)
    refused = {
        "sqlite:": "it names no file",
        f"sqlite:{tmp_path}": "it names no file",
        f"sqlite:{tmp_path}/not/here.sqlite": f"there is no folder {tmp_path}/not",
        f"sqlite:{tmp_path}/text": "file is not a database",
    }
    for url, why in refused.items():
        with pytest.raises(StoreNotOpened, match=why) as error:
            open_store(url)
        assert ONE_SENTENCE.fullmatch(str(error.value))
    assert (tmp_path / "text").read_text().startswith("not a database")


def test_a_file_that_was_damaged_is_said_and_nothing_else_is_raised(tmp_path: Path) -> None:
    path = tmp_path / "here.sqlite"
    with open_store(f"sqlite:{path}") as store:
        for k in range(300):
            store.add_audit(t_ns=k, actor="a" * 100, action="a", thing="t")
        with sqlite3.connect(path) as plain:
            plain.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        plain.close()
    data = bytearray(path.read_bytes())
    data[4096:] = b"\xff" * (len(data) - 4096)
    path.write_bytes(data)
    with pytest.raises((StoreNotOpened, StoreFailed), match="malformed"), open_store(f"sqlite:{path}") as store:
        store.audit()
