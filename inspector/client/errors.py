"""What can go wrong between a line and the service.

inspector.errors.WorldError
└── ClientError
    ├── NotSendable          a url, a token or a frame that cannot be sent
    ├── ServiceUnreachable   nobody answers, or nobody does any more
    ├── NotUnderstood        an answer that is not one of this service
    └── ServiceRefused       the service says no, and why
        └── InspectionEnded  the inspection ended at the service, without its line
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from inspector.errors import WorldError


class ClientError(WorldError):
    """Raised to a line: it did not get what it asked the service for."""


class NotSendable(ClientError):
    """A url, a token or a frame that cannot be sent."""

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"{what} cannot be sent: {why}")


class ServiceUnreachable(ClientError):
    """Nobody answers, or nobody does any more."""

    def __init__(self, url: str, why: str) -> None:
        super().__init__(f"{url} does not answer: {why}; is the service running there?")


class NotUnderstood(ClientError):
    """An answer that is not one of this service."""

    def __init__(self, url: str, status: int, start: str) -> None:
        super().__init__(f"{url} answers {status} and {start!r}, which is not what this service says; is it one?")


class ServiceRefused(ClientError):
    """The service says no, and why: its problem document as a sentence."""

    def __init__(
        self,
        status: int,
        title: str,
        detail: str,
        kind: str = "about:blank",
        facts: Mapping[str, Any] | None = None,
    ) -> None:
        self.status, self.kind, self.detail = status, kind, detail
        """Of HTTP, and `type` and `detail` of the problem document."""
        self.facts = facts or {}
        """All of the problem document."""
        super().__init__(f"{title}: {detail}")


class InspectionEnded(ServiceRefused):
    """The inspection ended at the service, without its line: aborted as a rule."""

    def __init__(self, inspection_id: str, why: str) -> None:
        super().__init__(409, "Inspection ended", f"{inspection_id}: {why}")
