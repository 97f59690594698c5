"""Stores are chosen by url."""

from __future__ import annotations

import sys

import pytest

from inspector.errors import WorldError
from inspector.stores import STORES, open_store
from inspector.stores.errors import StoreNotOpened, UnknownStore
from tests.contracts.stores import ONE_SENTENCE

SECRET = "s3cr3t"


@pytest.mark.parametrize(
    "url",
    [
        f"mysql://me:{SECRET}@host/name",
        "nothing",
        "",
        f"postgresql:me:{SECRET}@host",
        f"postgres://me:{SECRET}@host/db",
    ],
)
def test_an_unknown_scheme_is_refused_with_those_known(url: str) -> None:
    with pytest.raises(WorldError, match=r"known are|allowed is") as refused:
        open_store(url)
    assert ONE_SENTENCE.fullmatch(str(refused.value))
    assert SECRET not in str(refused.value)
    if isinstance(refused.value, UnknownStore):
        assert all(scheme in str(refused.value) for scheme in STORES)


@pytest.mark.parametrize(
    "url",
    [
        f"postgresql://me:{SECRET}@127.0.0.1:1/db",
        f"postgresql://me:x{SECRET}/@?#@127.0.0.1:1/db",
        f"postgresql://127.0.0.1:1/db?user=me&password={SECRET}",
        f"postgresql://me:{SECRET}@127.0.0.1:{SECRET}/db",
        f"postgresql://me:{SECRET}@127.0.0.1:1/db?{SECRET}=1",
    ],
)
def test_a_server_that_does_not_answer_is_one_sentence_without_the_password(url: str) -> None:
    with pytest.raises(StoreNotOpened) as refused:
        open_store(url)
    assert ONE_SENTENCE.fullmatch(str(refused.value))
    assert "postgresql:" in str(refused.value)
    assert SECRET not in str(refused.value) or f"?{SECRET}=" in url


def test_without_the_driver_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(StoreNotOpened, match=r"psycopg is not installed; pip install 'sweep-inspector\[postgres\]'"):
        open_store("postgresql://host/db")
