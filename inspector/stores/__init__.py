"""The store: what the service remembers, chosen by url: `open_store("postgresql://host/inspector")`."""

from __future__ import annotations

from importlib import import_module

from inspector.stores.base import AbstractStore
from inspector.stores.errors import UnknownStore

STORES = {
    "memory": "inspector.stores.sql:SqlStore",
    "sqlite": "inspector.stores.sql:SqlStore",
    "postgresql": "inspector.stores.sql:SqlStore",
}
"""Scheme -> import string; imported when chosen."""

__all__ = ["STORES", "AbstractStore", "open_store"]


def open_store(url: str) -> AbstractStore:
    """The store that the url names, open, its tables brought to those of this program.

    `sqlite:FOLDER/FILE`, `postgresql://USER:PASSWORD@HOST:PORT/NAME`, or `memory:`, which is gone when it is closed.
    Raises UnknownStore, and StoreNotOpened: a database that does not answer, is none of ours, or is newer than this.
    """
    scheme, colon, _ = url.partition(":")
    if not colon or scheme not in STORES:
        raise UnknownStore(scheme if colon else "without a scheme", tuple(STORES))
    module, _, name = STORES[scheme].partition(":")
    store: type[AbstractStore] = getattr(import_module(module), name)
    return store.open(url)
