"""An inspection by REST: a request per frame, answered with its score. The simplest that a line can do."""

from __future__ import annotations

from typing import Any

from inspector.client.base import AbstractInspection
from inspector.client.errors import ServiceRefused
from inspector.picture_headers import kind_of
from inspector.protocol import SentFrame

_ANSWERS = {"urn:inspector:refused": "refused", "urn:inspector:dropped": "dropped"}
"""Problems that are the answer to a frame; the inspection goes on."""


class PostedInspection(AbstractInspection):
    """Frames go one after the other. A frame that was not answered goes again: its number says that it is the same."""

    def wait(self, seconds: float) -> None:
        """Nothing is said but in answers."""
        self._asker.sleep(seconds)

    def _send(self, sent: SentFrame) -> None:
        numbers = {"sequence": sent.sequence, "t_ns": sent.t_ns, "encoder": sent.encoder}
        response = self._asker.ask(
            "POST",
            f"{self._path}/frames",
            params={name: value for name, value in numbers.items() if value is not None},
            content=bytes(sent.picture),
            headers={"Content-Type": f"image/{kind_of(bytes(sent.picture))}"},
        )
        try:
            said: dict[str, Any] = self._asker.told(response)
        except ServiceRefused as error:
            if error.kind not in _ANSWERS:
                raise
            said = {"kind": _ANSWERS[error.kind], "sequence": sent.sequence, "why": error.detail}
        self._tell(said)

    def _settle(self) -> None:
        """Every frame was answered when it was sent."""

    def _hear_out(self) -> None:
        """The verdict was the last word."""

    def _leave(self) -> None:
        """There is nothing to leave."""
