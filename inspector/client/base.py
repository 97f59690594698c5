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
from inspector.client.errors import ClientError, NotSendable, ServiceRefused
from inspector.pictures import encode_png
from inspector.protocol import SentFrame
from models.frame import Frame

OnMessage = Callable[[dict[str, Any]], object]
"""Told every message of the inspection, as in `inspector.protocol`; called while one waits, in the thread that does."""
RESUME_FROM, _CONCLUDED = "urn:inspector:resume-from", "urn:inspector:already-concluded"
_HELD_BYTES = 256 << 20
_MAX_SEQUENCE, _MAX_TIME = (1 << 32) - 1, (1 << 63) - 1


class Held:
    """Frames that may have to be sent once more: those without an answer, and where the service saves inspections so
    that another process can go on with them, those that are not saved yet.
    """

    def __init__(self, saves: bool) -> None:
        self.saves = saves
        self._frames: dict[int, bytes] = {}
        self._answered: set[int] = set()
        self._bytes = 0

    def add(self, sequence: int, frame: bytes) -> None:
        """One frame more. Where they are too many, the oldest are let go: they will be missing if they are wanted."""
        self._frames[sequence] = frame
        self._bytes += len(frame)
        while self._bytes > _HELD_BYTES and self._answered and (oldest := min(self._frames)) in self._answered:
            self._drop(oldest)

    def answered(self, sequence: int) -> bool:
        """There was an answer; False where there had been one before."""
        if sequence in self._answered:
            return False
        if self.saves:
            self._answered.add(sequence)
        else:
            self._drop(sequence)
        return True

    def saved(self, below: int) -> None:
        """Those below are not wanted again."""
        for sequence in [each for each in self._frames if each < below and each in self._answered]:
            self._drop(sequence)

    def frame(self, sequence: int) -> bytes:
        """One of them."""
        return self._frames[sequence]

    def since(self, sequence: int) -> dict[int, bytes]:
        """Those from that number on, in order."""
        return {number: frame for number, frame in self._frames.items() if number >= sequence}

    def _drop(self, sequence: int) -> None:
        self._bytes -= len(self._frames.pop(sequence, b""))


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
        self._held = Held(begun.get("saves", False))

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
        result = self._concluded(stopped)
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

    def _concluded(self, stopped: bool) -> dict[str, Any]:
        key = f"conclude-{self.inspection_id}-{stopped}"
        asked: dict[str, Any] = {"stopped": stopped}
        if self._held.saves and self._last >= 0:
            asked["last_sequence"] = self._last
        while True:
            self._settle()
            try:
                return self._asker.post(f"{self._path}/conclude", asked, "verdict", "frames", key=key)
            except ServiceRefused as error:
                if error.kind == RESUME_FROM:
                    self._resume(error.facts["next_sequence"])
                elif error.kind == _CONCLUDED and self._held.saves:
                    # The process that concluded it was lost before it could say so.
                    return self._asker.get(f"{self._path}/result", "verdict", "frames")
                else:
                    raise

    @abstractmethod
    def _resume(self, sequence: int) -> None:
        """Send once more what is held from that frame on: it was lost with a process of the service."""

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

    def _tell_answer(self, message: dict[str, Any]) -> None:
        """Once for each frame: one that had to be sent again is answered again."""
        if self._held.answered(message["sequence"]):
            self._tell(message)

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
