"""What every running inspection promises to its line, whatever it is sent by."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from math import isfinite
from types import TracebackType
from typing import Any, Self

from inspector.client.asking import Asker
from inspector.client.errors import ClientError, NotSendable
from inspector.pictures import encode_png
from inspector.protocol import SentFrame
from models.frame import Frame

OnMessage = Callable[[dict[str, Any]], object]
"""Told every message of the inspection, as in `inspector.protocol`; called while one waits, in the thread that does."""
_MAX_SEQUENCE, _MAX_TIME = (1 << 32) - 1, (1 << 63) - 1


class AbstractInspection(ABC):
    """One part under the camera. Leaving it as a context manager without `conclude` aborts it."""

    def __init__(self, asker: Asker, begun: Mapping[str, Any], on_message: OnMessage) -> None:
        self.inspection_id: str = begun["inspection_id"]
        self.recipe_id: str | None = begun["recipe_id"]
        self.appearance_id: str = begun["appearance_id"]
        self.counts: Counter[str] = Counter()
        """How many frames were `scored`, `dropped`, `refused`; how often there was another message, by its `kind`."""
        self._asker, self._on_message = asker, on_message
        self._path = f"/v1/inspections/{self.inspection_id}"
        self._last = -1
        self._open = True

    def send(self, frame: Frame) -> None:
        """Hand over a frame; waits where the service has no room for it. `on_message` is told what is said of it.

        Raises NotSendable, ServiceUnreachable, ServiceRefused.
        """
        sent = _sendable(frame, self._last)
        self._last = sent.sequence
        self._send(sent)

    @abstractmethod
    def wait(self, seconds: float) -> None:
        """Wait so long, and hear what is said meanwhile."""

    def conclude(self, *, stopped: bool = False) -> dict[str, Any]:
        """The result, with every frame; `stopped` where the line broke the sweep off because NG was certain.

        Raises ServiceUnreachable, ServiceRefused.
        """
        self._settle()
        key = f"conclude-{self.inspection_id}-{stopped}"
        result = self._asker.post(f"{self._path}/conclude", {"stopped": stopped}, "verdict", "frames", key=key)
        self._open = False
        self._hear_out()
        return result

    def abort(self, reason: str) -> None:
        """End it without a verdict on the part. Raises ServiceUnreachable, ServiceRefused."""
        self._open = False
        try:
            self._asker.post_once(f"{self._path}/abort", json={"reason": reason[:200]})
        finally:
            self._leave()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._open:
            why = f"the line broke off: {kind.__name__}" if kind else "the line left without concluding it"
            with suppress(ClientError):
                self.abort(why)

    @abstractmethod
    def _send(self, sent: SentFrame) -> None:
        """Hand over."""

    @abstractmethod
    def _settle(self) -> None:
        """Until every frame is answered."""

    @abstractmethod
    def _hear_out(self) -> None:
        """What is still to be said after the verdict."""

    @abstractmethod
    def _leave(self) -> None:
        """No more is sent or heard."""

    def _tell(self, message: dict[str, Any]) -> None:
        self.counts[message["kind"]] += 1
        self._on_message(message)


def _sendable(frame: Frame, last: int) -> SentFrame:
    """The frame as it travels: its picture byte for byte as it came, or without loss."""
    if not last < frame.sequence <= _MAX_SEQUENCE:
        raise NotSendable(f"frame {frame.sequence}", f"allowed are numbers above {last}, to {_MAX_SEQUENCE}")
    if not 0 <= frame.t_ns <= _MAX_TIME:
        raise NotSendable(f"frame {frame.sequence}", f"its time is {frame.t_ns} ns, allowed are 0 to {_MAX_TIME}")
    encoder = frame.encoder if frame.encoder is not None and isfinite(frame.encoder) else None
    return SentFrame(frame.sequence, frame.t_ns, encoder, (frame.encoded or encode_png(frame.pixels)).data)
