"""Ports that nobody else is given, for services that tests start, end, and start again."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def held() -> Iterator[int]:
    """A port, on every address, that is given to nobody who asks for any: neither to a listener nor to a connection.

    It is bound here, and nobody listens: connections are refused, until somebody listens who names it and lets others
    bind it, too (SO_REUSEADDR), as servers do.
    """
    with socket.socket() as holder:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.bind(("0.0.0.0", 0))
        yield int(holder.getsockname()[1])
