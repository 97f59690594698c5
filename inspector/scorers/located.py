"""Pictures located and tracked inside a scorer process, by workspaces that stay loaded."""

from __future__ import annotations

import json
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from inspector.errors import PictureUnreadable
from inspector.picture_headers import kind_of
from inspector.pictures import decode
from inspector.scorers.wire import Head
from inspector.tracking import tracked_record
from inspector.workspaces import load_workspace, located_record
from models.errors import AppearanceError, PictureError
from models.frame import EncodedPicture
from models.tracking import Tracking, begin, step
from models.workspace import Workspace

_KEPT = 4
"""Workspaces that stay loaded while nothing is tracked by them."""


class Located:
    """Everything that is located, and all that is tracked, in one process."""

    def __init__(self, max_pixels: int, clock: Callable[[], float] = time.perf_counter) -> None:
        self._max_pixels, self._clock = max_pixels, clock
        self._workspaces: OrderedDict[str, Workspace] = OrderedDict()
        self._tracked: dict[str, tuple[Workspace, Tracking]] = {}

    def answer(self, head: Head, picture: bytes) -> tuple[dict[str, Any], bytes]:
        """What is told of a picture: `took`, and `refused` with a sentence where it cannot be used; the rest as JSON.

        Raises AppearanceError where the workspace cannot be read.
        """
        since = self._clock()
        workspace = self._workspace(head)
        if head["do"] == "prepare":
            # what is searched in is made when it is asked for
            workspace.reach(workspace.objects[0])
            return {"took": self._clock() - since}, b""
        try:
            pixels = decode(EncodedPicture(kind_of(picture) or "", picture), max_pixels=self._max_pixels)
            made = self._track(head, workspace, pixels) if head["do"] == "track" else self._locate(workspace, pixels)
        except (PictureUnreadable, PictureError) as error:
            return {"took": self._clock() - since, "refused": str(error)}, b""
        return {"took": self._clock() - since}, json.dumps(made, separators=(",", ":")).encode()

    def forget(self, name: str) -> None:
        """It is not tracked any more."""
        self._tracked.pop(name, None)

    @staticmethod
    def _locate(workspace: Workspace, pixels: Any) -> dict[str, Any]:
        return located_record(workspace.locate(pixels), workspace)

    def _track(self, head: Head, workspace: Workspace, pixels: Any) -> dict[str, Any]:
        _, tracking = self._tracked.get(head["id"]) or (workspace, begin(workspace))
        tracking, tracked = step(tracking, pixels, head["t_ns"], head["hand"])
        self._tracked[head["id"]] = workspace, tracking
        return tracked_record(head["sequence"], tracked, workspace)

    def _workspace(self, head: Head) -> Workspace:
        """From memory, or the file, which must be the one that was meant."""
        if (going := self._tracked.get(head["id"])) is not None:
            return going[0]
        wanted = head["workspace_id"]
        if wanted not in self._workspaces:
            workspace = load_workspace(head["path"])
            if workspace.id != wanted:
                raise AppearanceError(f"workspace {wanted}: its file holds another one; upload or learn it again")
            self._workspaces[wanted] = workspace
        self._workspaces.move_to_end(wanted)
        while len(self._workspaces) > _KEPT:
            self._workspaces.popitem(last=False)
        return self._workspaces[wanted]
