"""The store: what the service remembers, chosen by url: `open_store("postgresql://host/inspector")`."""

from __future__ import annotations

from inspector.stores.base import AbstractStore

__all__ = ["AbstractStore"]
