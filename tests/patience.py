"""Waiting without haste: a machine with much to do is slow, and not wrong."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from functools import partial

import httpx2

SECONDS = 240.0
"""For whatever is waited for; where all is well, nothing takes that long."""

get = partial(httpx2.get, timeout=SECONDS, trust_env=False)
post = partial(httpx2.post, timeout=SECONDS, trust_env=False)
stream = partial(httpx2.stream, timeout=SECONDS, trust_env=False)


def until(happened: Callable[[], object], why: Callable[[], object] = lambda: "it did not happen") -> None:
    """Wait for what others do; where they do not, fail with `why`."""
    deadline = time.monotonic() + SECONDS
    while not happened():
        assert time.monotonic() < deadline, why()
        threading.Event().wait(0.02)


def crowded() -> float:
    """How many want each processor of this machine, at least 1: so much longer takes what has one for itself."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
