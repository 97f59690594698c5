"""What goes over the wire. Requests with a name too many are refused; times are nanoseconds since the epoch."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


class Asked(BaseModel):
    """A request."""

    model_config = ConfigDict(extra="forbid")


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
