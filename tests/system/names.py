"""A name server for one name, as the engine of containers has one: it knows the addresses of all that bear it."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

_ADDRESS, _ANSWERED, _HEADER = 1, 0x8580, struct.Struct("!6H")
_RECORD = struct.Struct("!HHHIH4s")
_TO_THE_QUESTION = 0xC00C


@dataclass
class Names:
    """Answers with what is in `addresses` just then, whatever the name."""

    port: int
    addresses: list[str] = field(default_factory=list[str])

    def answer(self, asked: bytes) -> bytes:
        """The message that goes back (RFC 1035); only addresses of version 4 are known."""
        number = _HEADER.unpack_from(asked)[0]
        end = asked.index(0, _HEADER.size) + 5
        kind = struct.unpack_from("!H", asked, end - 4)[0]
        known = [socket.inet_aton(address) for address in self.addresses] if kind == _ADDRESS else []
        records = [_RECORD.pack(_TO_THE_QUESTION, _ADDRESS, 1, 0, 4, address) for address in known]
        head = _HEADER.pack(number, _ANSWERED, 1, len(records), 0, 0)
        return head + asked[_HEADER.size : end] + b"".join(records)


@contextmanager
def names(*addresses: str) -> Iterator[Names]:
    """A name server on loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        known = Names(server.getsockname()[1], [*addresses])

        def serve() -> None:
            while (said := server.recvfrom(512))[0]:
                server.sendto(known.answer(said[0]), said[1])

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield known
        finally:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as last:
                last.sendto(b"", ("127.0.0.1", known.port))
            thread.join()
