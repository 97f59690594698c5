"""The process behind the desk: `python -m inspector.service.desk_worker NICE`. Ends when its input does."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, BinaryIO

from models.errors import InspectionError

Tasks = Mapping[str, Callable[..., dict[str, Any]]]
TELL_SECONDS = 0.3
"""Between two words about progress."""


def main() -> None:
    """Do one task after the other."""
    with suppress(OSError):
        os.nice(int(sys.argv[1]))
    # What libraries print must not get among the answers.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    asked: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_listen, args=(asked,), daemon=True).start()
    # takes a second; a service that ends is heard by now
    from inspector.service.tasks import IN_PIECES, TASKS  # noqa: PLC0415

    while True:
        _do(json.loads(asked.get()), TASKS, IN_PIECES, answers)


def _listen(asked: SimpleQueue[bytes]) -> None:
    for line in sys.stdin.buffer:
        asked.put(line)
    # The service has ended: nobody waits for what is being done.
    os._exit(0)


def _do(asked: Mapping[str, Any], tasks: Tasks, in_pieces: Tasks, answers: BinaryIO) -> None:
    told, last = 0.0, -1.0

    def say(what: Mapping[str, object]) -> None:
        answers.write(json.dumps(what).encode() + b"\n")
        answers.flush()

    def progress(share: float) -> None:
        nonlocal told, last
        if share > last and time.monotonic() - told >= TELL_SECONDS:
            told, last = time.monotonic(), share
            say({"progress": share})

    def made(piece: Mapping[str, object]) -> None:
        say({"made": piece})

    try:
        if (name := asked["task"]) in in_pieces:
            say({"done": in_pieces[name](made, **asked["arguments"])})
        else:
            say({"done": tasks[name](progress, **asked["arguments"])})
    except InspectionError as error:
        say({"failed": str(error), "kind": type(error).__name__})
    except Exception as error:
        traceback.print_exc()
        say({"broke": f"{type(error).__name__}: {error}"})


if __name__ == "__main__":
    main()
