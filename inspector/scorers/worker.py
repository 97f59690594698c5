"""The scorer process: reads from stdin what `wire` describes, answers on stdout; ends when stdin does.

Started by `pool` as `python -m inspector.scorers.worker MAX_PIXELS`. When the service is gone, however it went, its
recordings are closed properly.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np

from inspector.learner import load_appearance
from inspector.scorers.inspected import Concluded, Inspected, Names
from inspector.scorers.located import Located
from inspector.scorers.saved import Saved, resume
from inspector.scorers.tape import Recorded, Tape, TapeThread
from inspector.scorers.wire import Head, pack, receive
from models.appearance import Appearance
from models.errors import AppearanceError, InspectionError
from models.frame import Frame
from models.inspection import begin, conclude, step
from models.verdict import Policy

_KEPT = 8
"""Appearances that stay loaded while no inspection needs them."""
BRIEF = ("index", "s", "score", "state")
"""What dashboards are told of every frame."""
_NICE = 5
"""The process that talks to clients goes first."""


class Worker:
    """All inspections of one process."""

    def __init__(self, out: BinaryIO, max_pixels: int) -> None:
        self._out, self._lock, self._max_pixels = out, threading.Lock(), max_pixels
        self._inspected: dict[str, Inspected] = {}
        self._appearances: OrderedDict[str, Appearance] = OrderedDict()
        self._tapes = TapeThread()
        self._does: dict[str, Callable[[Head, bytes], None]] = {
            "load": self._load,
            "begin": self._begin,
            "frame": self._frame,
            "drop": self._drop,
            "conclude": self._end,
            "abort": self._end,
            "checkpoint": self._checkpoint,
            "release": self._release,
            "prepare": self._locate,
            "locate": self._locate,
            "track": self._locate,
            "forget": lambda head, _: self._located.forget(head["id"]),
        }
        self._located = Located(max_pixels)

    def run(self, stream: BinaryIO) -> None:
        """Until the stream ends."""
        self._tapes.start()
        while message := receive(stream):
            head, body = message
            try:
                self._does[head["do"]](head, body)
            except InspectionError as error:
                told = {name: head.get(name) for name in ("id", "do", "sequence")}
                self._say({"did": "failed", **told, "why": str(error)})
        self._tapes.finish()

    def _load(self, head: Head, _: bytes) -> None:
        warm(self._appearance(head))

    def _begin(self, head: Head, body: bytes) -> None:
        appearance = self._appearance(head)
        names = Names(**head["names"])
        facts = {
            "product_id": names.product_id,
            "part_id": names.part_id,
            "recipe_id": names.recipe_id,
            "inspection_id": names.inspection_id,
            "appearance_id": appearance.id,
        }
        policy = Policy(**head["policy"])
        going = None
        if "resume" in head:
            size = head["resume"][0]
            going = resume(appearance, policy, Saved(body[:size], body[size:]), self._max_pixels)
        tape = Tape(self._tapes, Path(head["record_to"]), facts)
        inspected = Inspected(appearance, policy, names, tape, max_pixels=self._max_pixels, going=going)
        self._inspected[head["id"]] = inspected
        self._say({"did": "begun", "id": head["id"]})

    def _frame(self, head: Head, body: bytes) -> None:
        inspected = self._inspected[head["id"]]
        said, took = inspected.frame(head["sequence"], head["t_ns"], head["encoder"], body)
        lines = "\n".join(json.dumps(each, separators=(",", ":")) for each in said)
        answer = {"did": "frame", "id": head["id"], "sequence": head["sequence"], "took": took}
        brief = [said[0].get(name) for name in BRIEF]
        self._say(answer | {"kinds": [each["kind"] for each in said], "brief": brief}, lines.encode())
        if pictures := inspected.doubted:
            self._say({"did": "doubted", "id": head["id"], "sizes": [*map(len, pictures)]}, b"".join(pictures))

    def _drop(self, head: Head, _: bytes) -> None:
        self._inspected[head["id"]].drop(head["count"], head["t_ns"])

    def _end(self, head: Head, _: bytes) -> None:
        inspected = self._inspected.pop(head["id"])
        ended = inspected.end(head["announced"], stopped=head.get("stopped", False), aborted=head.get("reason"))
        # the answer comes from the thread of the tapes, when the recording is closed
        inspected.tape.close(lambda recorded: self._tell(head["id"], ended, recorded))

    def _checkpoint(self, head: Head, _: bytes) -> None:
        inspected = self._inspected[head["id"]]
        saved = inspected.save()
        answer = {"did": "checkpoint", "id": head["id"], "sequence": inspected.sequence, "size": len(saved.state)}
        # no scores are saved whose pictures are not
        inspected.tape.flush(lambda: self._say(answer, saved.state + saved.added))

    def _release(self, head: Head, _: bytes) -> None:
        answer = {"did": "released", "id": head["id"]}
        tape = self._inspected.pop(head["id"]).tape
        tape.close(lambda recorded: self._say(answer | {"recording": facts_of(recorded)}))

    def _locate(self, head: Head, body: bytes) -> None:
        said, answer = self._located.answer(head, body)
        self._say({"did": "located", "id": head["id"], "sequence": head["sequence"], **said}, answer)

    def _tell(self, inspection: str, ended: Concluded, recorded: Recorded) -> None:
        head = {"did": "concluded", "id": inspection, "result": ended.result, "recording": facts_of(recorded)}
        self._say(head | {"doubted": ended.doubted, "json": len(ended.frames)}, ended.frames + ended.scores)

    def _say(self, head: Head, body: bytes = b"") -> None:
        # a service that is gone hears nothing; the recordings are closed all the same
        with self._lock, suppress(BrokenPipeError):
            self._out.write(pack(head, body))
            self._out.flush()

    def _appearance(self, head: Head) -> Appearance:
        """From memory, or the file, which must be the one that was meant."""
        wanted = head["appearance_id"]
        if wanted not in self._appearances:
            appearance = load_appearance(head["path"])
            if appearance.id != wanted:
                raise AppearanceError(f"appearance {wanted}: its file holds another one; upload or learn it again")
            self._appearances[wanted] = appearance
        self._appearances.move_to_end(wanted)
        while len(self._appearances) > _KEPT:
            self._appearances.popitem(last=False)
        return self._appearances[wanted]


def facts_of(recorded: Recorded) -> Head:
    """What became of a recording, for an answer."""
    return {"frames": recorded.frames, "bytes": recorded.bytes, "note": recorded.note}


def warm(appearance: Appearance) -> None:
    """Inspect a reference picture: what is made or imported at the first frame is there when a part comes."""
    pixels = np.clip(appearance.references.get(0).picture, 0, 255).astype(np.uint8)
    frame = Frame(pixels, 0, 0)
    if frame.kind == appearance.references.kind:
        conclude(step(begin(appearance), frame)[0])


def main() -> None:
    """The process: signals are for the service, which then closes stdin."""
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, signal.SIG_IGN)
    os.nice(_NICE)
    cv2.setNumThreads(1)
    # whatever prints must not speak to the service
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    gc.freeze()
    Worker(out, int(sys.argv[1])).run(sys.stdin.buffer)


if __name__ == "__main__":
    main()
