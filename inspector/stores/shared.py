"""What a store promises to services that share it: who works on it, whose an inspection is, how the others are told.

A store that only one service works on has all of it, too, and nothing of it is paid for there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager

from inspector.stores.records import Buried, Checkpoint, Json, Node, StoredInspection


class AbstractNodes(ABC):
    """Services that work on the store. One that says nothing for too long is gone, whatever it believes itself."""

    @abstractmethod
    def join(self, node_id: str, name: str, t_ns: int) -> None:
        """A service works on the store from now on. One that was taken for gone may join again."""

    @abstractmethod
    def beat(self, node_id: str, facts: Json | None = None) -> None:
        """It lives, and says this of itself; None: what it said before. Raises NoSuchNode: it was taken for gone."""

    @abstractmethod
    def leave(self, node_id: str, why: str) -> Buried:
        """It works on it no more; what it had, or nobody had, is free as with `bury`. A second call does no harm."""

    @abstractmethod
    def nodes(self) -> tuple[Node, ...]:
        """Those that joined and neither left nor were buried; the oldest first."""

    @abstractmethod
    def bury(self, silent_seconds: float, why: str) -> Buried:
        """Services that were silent for longer are gone, and nobody does any more what they did, or what nobody did.

        Their jobs fail and say why, their claims are released, their inspections are of no service. Of many that call
        at once, each is told only what it has buried itself.
        """


class AbstractCheckpoints(ABC):
    """Inspections that go from one service to another: each is of one, and what another one writes to it fails."""

    @abstractmethod
    def take_inspection(self, inspection_id: str, node: str) -> tuple[StoredInspection, Checkpoint | None]:
        """The service has it now, whoever had it before, and goes on from there; None: from the beginning.

        What the one before writes after this fails. Raises NoSuchInspection, AlreadyConcluded.
        """

    @abstractmethod
    def release_inspection(self, inspection_id: str, node: str, t_ns: int) -> StoredInspection:
        """No service has it from now on. Raises NoSuchInspection, AlreadyConcluded, NotOwner."""

    @abstractmethod
    def save_checkpoint(self, inspection_id: str, node: str, number: int, state: bytes, added: bytes) -> None:
        """`state` instead of the one before; `added` as part `number`, counted from 0, beside those before.

        The same number once more, as after a failure that left it open whether it was done, replaces that part.
        Raises NoSuchInspection, AlreadyConcluded, NotOwner.
        """

    @abstractmethod
    def ownerless(self) -> tuple[StoredInspection, ...]:
        """Those in processing that no service has, the oldest first."""


class AbstractTelling(ABC):
    """What services tell each other, and what only one of them does at a time."""

    @abstractmethod
    def tell(self, body: bytes, to: Collection[str] | None = None) -> None:
        """To all services that listen, this one too, or to those named; kept for nobody. On a shared store only."""

    @abstractmethod
    def listen(self, node_id: str, heard: Callable[[bytes | None], object]) -> AbstractContextManager[None]:
        """Hear what is told to all and to this one, in a thread, until the context is left.

        None: something may have been missed, since the database was away. On a store that is not shared, nothing.
        """

    @abstractmethod
    def only_one(self, name: str) -> AbstractContextManager[bool]:
        """False where somebody is in a context of that name already, in whatever service."""
