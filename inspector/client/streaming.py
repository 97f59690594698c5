"""An inspection by WebSocket: frames go without waiting for answers, and all that is said is heard as it comes."""

from __future__ import annotations

import json
import logging
from collections import deque
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from typing import Any

from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from inspector.client.asking import Asker
from inspector.client.base import AbstractInspection, OnMessage
from inspector.client.errors import ClientError, InspectionEnded, NotUnderstood, ServiceRefused, ServiceUnreachable
from inspector.protocol import ANSWERS, SentFrame

_TAKEN_OVER = 4409
_MAX_MESSAGE = 1 << 28
"""The verdict has every frame of the inspection in it."""
_CLOSE_SECONDS = 2.0
_LOG = logging.getLogger(__name__)
# What breaks is raised or mended: nobody's terminal needs to hear of it, too.
_LOG.addHandler(logging.NullHandler())
_BROKEN = (ConnectionClosed, InvalidHandshake, OSError, EOFError)
"""Also what a handshake that was cut ends in, and one that took too long."""


class StreamedInspection(AbstractInspection):
    """Never more frames unanswered than the service gives credits.

    A connection that broke is made again: messages go on behind the last that was heard, and frames that the service
    has not seen go once more.
    """

    def __init__(self, asker: Asker, begun: Mapping[str, Any], on_message: OnMessage) -> None:
        super().__init__(asker, begun, on_message)
        self._unanswered: set[int] = set()
        self._unsent: deque[int] = deque()
        """Of those, the ones that are to be sent, or sent once more."""
        self._log = ""
        """Of the messages that `n` counts; another one where another process has taken over."""
        self._news: set[str] = set()
        """What was said beside answers, where it may be said once more."""
        self._credits = 1
        self._taken = 0
        """The number of the next frame, as the service said when last connected."""
        self._heard = -1
        """`n` of the last message."""
        self._patience = asker.patience()
        self._socket: ClientConnection | None = None
        self._stack = ExitStack()
        """Closes the connection."""
        try:
            self._mend("")
        except ClientError as error:
            with suppress(ClientError):
                self.abort(f"the line got no stream: {error}")
            raise

    def wait(self, seconds: float) -> None:
        """Hear what is said for so long."""
        until = self._asker.clock() + seconds
        while (left := until - self._asker.clock()) > 0:
            self._listen(left)

    def _send(self, sent: SentFrame) -> None:
        self._held.add(sent.sequence, sent.to_bytes())
        self._unanswered.add(sent.sequence)
        self._unsent.append(sent.sequence)
        while self._listen(0):
            pass
        self._pump()
        while self._unsent:
            self._await_answer()
            self._pump()

    def _resume(self, sequence: int) -> None:
        self._mend("a process of the service was lost")

    def _pump(self) -> None:
        """Send as many as may be unanswered."""
        while self._unsent and len(self._unanswered) - len(self._unsent) < self._credits:
            connection = self._connection
            if not self._unsent:
                return
            sequence = self._unsent.popleft()
            try:
                connection.send(self._held.frame(sequence))
            except _BROKEN as error:
                self._mend(str(error))

    def _settle(self) -> None:
        while self._unanswered:
            self._await_answer()

    def _hear_out(self) -> None:
        # The result is there already: what breaks now is not mended.
        with suppress(*_BROKEN):
            while True:
                self._hear(json.loads(self._connection.recv(self._asker.timeout)), over=True)
        self._leave()

    def _leave(self) -> None:
        self._socket = None
        self._stack.close()

    @property
    def _connection(self) -> ClientConnection:
        if self._socket is None:
            self._mend("it was closed")
        assert self._socket is not None
        return self._socket

    def _await_answer(self) -> None:
        """Until something is said; a service that says nothing for long is asked by a new connection."""
        self._pump()
        if not self._listen(self._asker.timeout):
            self._mend(f"no answer to {len(self._unanswered)} frames for {self._asker.timeout:g} s")

    def _listen(self, seconds: float) -> bool:
        """Hear one message, if one comes in time. True where something happened."""
        try:
            message = self._connection.recv(seconds)
        except TimeoutError:
            return False
        except _BROKEN as error:
            self._mend(str(error))
            return True
        self._hear(json.loads(message))
        return True

    def _hear(self, message: dict[str, Any], *, over: bool = False) -> None:
        kind = message.get("kind")
        self._heard = message.get("n", self._heard)
        if kind == "problem":
            raise ServiceRefused(message["status"], message["title"], message["detail"], message["type"])
        if kind == "duplicate":
            # It went twice, about when a connection broke; its answer came, or comes.
            return
        if kind == "saved":
            self._held.saved(message["next_sequence"])
        elif kind in ANSWERS:
            self._unanswered.discard(message["sequence"])
            self._patience.renew()
            self._tell_answer(message)
        elif self._is_new(message):
            self._tell(message)
        if kind in ("aborted", "verdict") and not over:
            self._open = False
            self._leave()
            raise InspectionEnded(self.inspection_id, message.get("reason") or "somebody else concluded it")

    def _is_new(self, message: Mapping[str, Any]) -> bool:
        """Whether it was not said before: who takes an inspection over says all once more."""
        if not self._held.saves:
            return True
        said = json.dumps({name: value for name, value in message.items() if name != "n"}, sort_keys=True)
        known = said in self._news
        self._news.add(said)
        return not known

    def _mend(self, why: str) -> None:
        """A new connection. Raises ServiceUnreachable when that has been tried for too long."""
        taken_over = self._socket is not None and self._socket.close_code == _TAKEN_OVER
        self._leave()
        if taken_over:
            self._open = False
            raise InspectionEnded(self.inspection_id, "another connection has taken it over")
        while self._patience.again():
            try:
                self._socket = self._connected()
                return
            except InvalidStatus as error:
                status, body = error.response.status_code, error.response.body or b""
                if status < 500:
                    raise self._asker.refusal(status, bytes(body)) from error
                why = f"it answers {status}"
            except _BROKEN as error:
                why = str(error)
        raise ServiceUnreachable(self._asker.url, why)

    def _connected(self) -> ClientConnection:
        """A connection over which everything goes on where it was."""
        connection = connect(
            f"ws{self._asker.url.removeprefix('http')}{self._path}/stream?after={self._heard}&log={self._log}",
            additional_headers=self._asker.headers,
            ssl=self._asker.tls,
            proxy=None,
            compression=None,
            open_timeout=self._asker.timeout,
            close_timeout=_CLOSE_SECONDS,
            max_size=_MAX_MESSAGE,
            logger=_LOG,
        )
        with ExitStack() as held:
            socket = held.enter_context(connection)
            ready = json.loads(socket.recv(self._asker.timeout))
            if ready.get("kind") != "ready":
                raise NotUnderstood(self._asker.url, 101, str(ready)[:60])
            self._credits = ready["credits"]
            if ready["next_sequence"] > self._taken:
                # Frames arrive, though connections break before their answers do.
                self._taken = ready["next_sequence"]
                self._patience.renew()
            if ready["log"] != self._log:
                self._log, self._heard = ready["log"], -1
            again = self._held.since(ready["next_sequence"])
            self._unanswered.update(again)
            self._unsent = deque(again)
            self._stack = held.pop_all()
        return socket
