"""An inspection by REST: a request per frame, answered with its score. The simplest that a line can do."""

from __future__ import annotations

from collections import deque
from typing import Any

from inspector.client.base import RESUME_FROM, AbstractInspection
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
        if self._held.saves:
            self._held.add(sent.sequence, sent.to_bytes())
        self._post_all(deque([sent]))

    def _resume(self, sequence: int) -> None:
        self._post_all(self._again(sequence))

    def _again(self, sequence: int) -> deque[SentFrame]:
        return deque(map(SentFrame.from_bytes, self._held.since(sequence).values()))

    def _post_all(self, frames: deque[SentFrame]) -> None:
        """One after the other; those before them first, where they were lost with a process of the service."""
        while frames:
            try:
                self._post(frames[0])
                frames.popleft()
            except ServiceRefused as error:
                if error.kind != RESUME_FROM:
                    raise
                frames = self._again(error.facts["next_sequence"])

    def _post(self, sent: SentFrame) -> None:
        numbers = {"sequence": sent.sequence, "t_ns": sent.t_ns, "encoder": sent.encoder}
        response = self._asker.ask(
            "POST",
            f"{self._path}/frames",
            params={name: value for name, value in numbers.items() if value is not None},
            content=bytes(sent.picture),
            headers={"Content-Type": f"image/{kind_of(bytes(sent.picture))}"},
        )
        self._held.saved(int(response.headers.get("saved-sequence", 0)))
        try:
            said: dict[str, Any] = self._asker.told(response)
        except ServiceRefused as error:
            if error.kind not in _ANSWERS:
                raise
            said = {"kind": _ANSWERS[error.kind], "sequence": sent.sequence, "why": error.detail}
        self._tell_answer(said)

    def _settle(self) -> None:
        """Every frame was answered when it was sent."""

    def _hear_out(self) -> None:
        """The verdict was the last word."""

    def _leave(self) -> None:
        """There is nothing to leave."""
