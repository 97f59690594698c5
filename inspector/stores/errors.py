"""What can go wrong with a store; every class writes its own sentence.

inspector.errors.StoreError
├── UnknownStore             a url whose scheme no store has
├── StoreNotOpened           a database that is not there, does not answer, or is none of ours
│   ├── NewerStore           a database that a newer program has written
│   └── OlderServices        a database to be migrated, that services of an older program work on
├── StoreFailed              a database that failed while it was used: disk full, server gone
├── NoSuch                   an id that nothing has
│   ├── NoSuchProduct
│   ├── NoSuchSweep
│   ├── NoSuchAppearance
│   ├── NoSuchWorkspace
│   ├── NoSuchJob
│   ├── NoSuchRecipe
│   ├── NoSuchInspection
│   ├── NoSuchToken
│   └── NoSuchNode
└── StoreConflict            what is asked does not go with what is there
    ├── IdTaken              an id that something has already
    ├── JobEnded             a job that has ended is changed
    ├── NotEnded             an inspection is acknowledged, or disposed of, that has not ended
    ├── NothingToDecide      a disposition that does not go with the verdict
    ├── AlreadyConcluded     an inspection is concluded that has ended
    └── NotOwner             an inspection is written to by a service that does not have it
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from inspector.errors import StoreError


class UnknownStore(StoreError):
    """A url whose scheme no store has."""

    def __init__(self, scheme: str, known: Sequence[str]) -> None:
        super().__init__(f"database {scheme!r}: no such kind of database; known are {', '.join(known)}")


class StoreNotOpened(StoreError):
    """A database that is not there, does not answer, or is none of ours."""

    def __init__(self, place: str, why: str) -> None:
        super().__init__(f"database {place} cannot be opened: {why}")


class NewerStore(StoreNotOpened):
    """A database that a newer program has written."""

    def __init__(self, place: str, found: str, known: str) -> None:
        super().__init__(
            place, f"a newer program has written it (revision {found}, known is {known}); use that program"
        )


class OlderServices(StoreNotOpened):
    """A database to be migrated, that services of an older program work on: its tables would change under them."""

    def __init__(self, place: str, found: str, known: str, names: Sequence[str]) -> None:
        at_work = ", ".join(names)
        super().__init__(
            place,
            f"it is of revision {found}, this program needs {known}, and services of the older program work on it"
            f" ({at_work}); stop all of them, and start this one again",
        )


class StoreFailed(StoreError):
    """A database that failed while it was used. What was not confirmed was not done."""

    def __init__(self, place: str, why: str) -> None:
        super().__init__(f"database {place} failed: {why}")


class NoSuch(StoreError):
    """An id that nothing has."""

    thing: ClassVar[str] = "thing"

    def __init__(self, id: str) -> None:
        super().__init__(f"there is no {self.thing} {id!r}")


class NoSuchProduct(NoSuch):
    """A product that has no sweep yet."""

    thing = "product"


class NoSuchSweep(NoSuch):
    """An id that no sweep has."""

    thing = "sweep"


class NoSuchAppearance(NoSuch):
    """An id that no appearance of the product has."""

    thing = "appearance"


class NoSuchWorkspace(NoSuch):
    """An id that no workspace has."""

    thing = "workspace"


class NoSuchJob(NoSuch):
    """An id that no job has."""

    thing = "job"


class NoSuchRecipe(NoSuch):
    """An id that no recipe of the product has."""

    thing = "recipe"


class NoSuchInspection(NoSuch):
    """An id that no inspection has."""

    thing = "inspection"


class NoSuchToken(NoSuch):
    """An id that no token has."""

    thing = "token"


class NoSuchNode(NoSuch):
    """A service that the store does not know, or took for gone."""

    thing = "service"


class StoreConflict(StoreError):
    """What is asked does not go with what is there."""


class IdTaken(StoreConflict):
    """An id that something has already."""

    def __init__(self, thing: str, id: str) -> None:
        super().__init__(f"{thing} {id!r} is there already")


class JobEnded(StoreConflict):
    """A job that has ended is changed."""

    def __init__(self, job_id: str, state: str) -> None:
        super().__init__(f"job {job_id!r} is {state}, and changes no more")


class NotEnded(StoreConflict):
    """An inspection is acknowledged, or disposed of, that has not ended."""

    def __init__(self, inspection_id: str) -> None:
        super().__init__(f"inspection {inspection_id!r} is processing; conclude it first")


class NothingToDecide(StoreConflict):
    """A disposition that does not go with the verdict."""

    def __init__(self, inspection_id: str, verdict: str | None) -> None:
        said = f"is {verdict} already; confirm it" if verdict else "has no verdict to confirm; say what it is"
        super().__init__(f"inspection {inspection_id!r} {said}")


class AlreadyConcluded(StoreConflict):
    """An inspection is concluded that has ended."""

    def __init__(self, inspection_id: str, state: str) -> None:
        super().__init__(f"inspection {inspection_id!r} is {state} already")


class NotOwner(StoreConflict):
    """An inspection is written to by a service that does not have it."""

    def __init__(self, inspection_id: str, node: str | None) -> None:
        has = f"service {node!r} has it" if node else "no service has it"
        super().__init__(f"inspection {inspection_id!r} is not of this service any more: {has}")
