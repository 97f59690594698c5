"""What goes over the wire. Requests with a name too many are refused; times are nanoseconds since the epoch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Generic, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from inspector.stores import records

T = TypeVar("T")
Stored = TypeVar("Stored")


class Asked(BaseModel):
    """A request."""

    model_config = ConfigDict(extra="forbid")


class Page(BaseModel, Generic[T]):
    """Part of a list, newest first."""

    items: list[T]
    next: int | None
    """Ask with `after` set to this for what follows; null where nothing does."""

    @classmethod
    def of(cls, page: records.Page[Stored], told: Callable[[Stored], T]) -> Self:
        """A page of the store, with what is told of each."""
        return cls(items=[told(each) for each in page.items], next=page.next)


class Problem(BaseModel):
    """What went wrong (RFC 9457)."""

    model_config = ConfigDict(extra="allow")

    type: str
    """Names the kind of problem: `urn:inspector:...`, or `about:blank`."""
    title: str
    status: int
    detail: str
    """One sentence: what, its value, and what was allowed."""


class Health(BaseModel):
    """Whether the service can do its work."""

    state: Literal["ready", "not ready", "alive"]
    reasons: Annotated[list[str], Field(default_factory=list[str])]
    """Why not."""
