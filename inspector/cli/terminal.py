"""What commands say besides their results: progress and warnings, on stderr, progress on a terminal only."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from math import inf
from types import FrameType

import typer

Progress = Callable[[float], None]
"""Told the share of the work that is done, in [0, 1]."""


def count(text: str) -> int:
    """Reads an option: how many."""
    if not text.isascii() or not text.isdecimal() or int(text) == 0:
        raise typer.BadParameter(f"{text!r} is not allowed; allowed is a whole number above 0")
    return int(text)


def duration(text: str) -> float:
    """Reads an option: how long."""
    with suppress(ValueError):
        if 0 < float(text) < inf:
            return float(text)
    raise typer.BadParameter(f"{text!r} is not allowed; allowed is a number above 0")


def warn(said: str) -> None:
    """A line that is no error."""
    print(f"inspector: warning: {said}", file=sys.stderr)


@contextmanager
def progress(title: str) -> Generator[Progress]:
    """A bar that goes away when the work is done; nothing where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield lambda share: None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)


@contextmanager
def counting(title: str, total: int) -> Generator[Callable[[int, str], None]]:
    """A bar with how many are done, how long the rest may take, and a word; nothing where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield lambda done, said: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[said]}"),
    )
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=total, said="")
        yield lambda done, said: bar.update(task, completed=done, said=said)


@contextmanager
def status(title: str) -> Generator[Callable[[str], None]]:
    """A line that is overwritten, for work whose end is not known; nothing where stderr is no terminal."""
    if not sys.stderr.isatty():
        yield lambda said: None
        return
    from rich.console import Console

    with Console(stderr=True).status(title) as line:
        yield lambda said: line.update(f"{title}: {said}")


@contextmanager
def stopped_by_signals() -> Generator[threading.Event]:
    """An event that the first Ctrl-C or SIGTERM sets; the second interrupts a camera that delivers nothing more."""
    stop = threading.Event()

    def stopped(number: int, at: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    kinds = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(kind, stopped) for kind in kinds]
    try:
        yield stop
    finally:
        for kind, handler in zip(kinds, before, strict=True):
            signal.signal(kind, handler)
