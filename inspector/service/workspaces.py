"""Workspaces of the service: learnt elsewhere and uploaded, or learnt here from labelled pictures."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from inspector.service.desk import Desk, naming
from inspector.service.files import Files
from inspector.service.folder import remove
from inspector.stores.base import AbstractStore
from inspector.stores.records import Json, StoredWorkspace, WorkspaceSource

MAX_FILES = 100_000
"""Of an archive."""


class Workspaces:
    """Adds workspaces. Everything here blocks."""

    def __init__(
        self,
        store: AbstractStore,
        files: Files,
        *,
        looking: Desk,
        learning: Desk,
        max_bytes: int,
        max_pixels: int,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._store, self._files, self._looking, self._learning = store, files, looking, learning
        self._now_ns = now_ns
        self._limits = {"max_bytes": max_bytes, "max_files": MAX_FILES, "max_pixels": max_pixels}

    def keep(self, draft: Path, name: str | None) -> StoredWorkspace:
        """A learnt file that was received, where it is one. Raises WorkFailed, NotWritten."""
        with naming({str(draft): "the workspace"}):
            found = self._looking.do("check_workspace", {"workspace": str(draft)})
        return self._add(draft, name, "upload", found)

    def learn(
        self, progress: Callable[[float], object], pictures: Path, name: str | None, periods: Mapping[str, float]
    ) -> Json:
        """From an archive or a recording that was received, as the outcome of a job; it is removed.

        Raises WorkFailed, NotWritten.
        """
        draft, unpacked = self._files.incoming(), self._files.incoming()
        asked: Json = {
            "pictures": str(pictures), "folder": str(unpacked), "periods": dict(periods), "workspace": str(draft),
            **self._limits,
        }  # fmt: skip
        try:
            with naming({f"{unpacked}/": "", str(pictures): "the upload", str(draft): "the workspace"}):
                found = self._learning.do("learn_workspace", asked, progress)
            stored = self._add(draft, name, "pictures", found)
        finally:
            shutil.rmtree(unpacked, ignore_errors=True)
            remove(draft)
            remove(pictures)
        return {"workspace_id": stored.workspace_id}

    def _add(self, draft: Path, name: str | None, source: WorkspaceSource, found: Json) -> StoredWorkspace:
        # The name is the hash of what is in it: what is there already is the same.
        if self._files.size("workspace", found["workspace_id"]) is None:
            self._files.publish(draft, "workspace", found["workspace_id"])
        return self._store.add_workspace(
            StoredWorkspace(found["workspace_id"], name, self._now_ns(), source, found["facts"], found["bytes"])
        )
