"""The store in memory."""

from __future__ import annotations

import pytest

from inspector.stores import open_store
from tests.contracts.stores import StoreContract


class TestMemoryContract(StoreContract):
    @pytest.fixture
    def url(self) -> str:
        return "memory:"


def test_every_one_is_a_store_of_its_own() -> None:
    with open_store("memory:") as one, open_store("memory:") as other:
        one.ensure_product("plate", 1)
        assert other.products().items == ()
