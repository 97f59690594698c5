"""Sweeps of the service: uploads that were received, cameras that a station has named.

inspector.errors.CameraError
└── NoSuchCamera             a name that no camera of the settings has
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from inspector.errors import CameraError, WorldError
from inspector.service.desk import Desk, Outcome, naming
from inspector.service.files import Files
from inspector.service.folder import new_id, remove
from inspector.stores.base import AbstractStore
from inspector.stores.records import Json, Sweep, SweepSource


class NoSuchCamera(CameraError):
    """A name that no camera of the settings has."""

    def __init__(self, name: str, known: Mapping[str, str]) -> None:
        names = ", ".join(sorted(known)) or "none: name one in the settings of the service"
        super().__init__(f"camera {name!r} is not known here; known are {names}")


PART = re.compile(r"[^\x00-\x1f\x7f-\x9f\u2028\u2029]{1,128}")
"""What parts may be called: 1 to 128 printable characters."""


@dataclass(frozen=True)
class Received:
    """A body that was received whole, in the folder `incoming`."""

    draft: Path
    bytes: int
    sha256: str


class Sweeps:
    """Adds sweeps to a product. Everything here blocks."""

    def __init__(
        self,
        store: AbstractStore,
        files: Files,
        *,
        looking: Desk,
        recording: Desk,
        cameras: Mapping[str, str],
        max_frames: int,
        max_pixels: int,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._store, self._files, self._looking, self._recording = store, files, looking, recording
        self._cameras, self._now_ns = cameras, now_ns
        self._limits = {"max_frames": max_frames, "max_pixels": max_pixels}

    def url(self, camera: str) -> str:
        """Of a named camera. Raises NoSuchCamera."""
        if camera not in self._cameras:
            raise NoSuchCamera(camera, self._cameras)
        return self._cameras[camera]

    def keep(self, product_id: str, part_id: str | None, received: Received) -> Sweep:
        """A recording that was received becomes a sweep, where it is one.

        Raises WorkFailed, NotWritten, ObjectError.
        """
        try:
            with naming({str(received.draft): "the recording"}):
                found = self._looking.do("survey", {"recording": str(received.draft), **self._limits})
            named = found["facts"].get("part_id") if part_id is None else part_id
            if named is not None and not PART.fullmatch(named):
                said = f"the recording calls its part {named[:80]!r}; allowed are 1 to 128 printable characters"
                named, found["losses"] = None, [*found["losses"], said]
            return self._add(received, product_id, named, found, "upload")
        finally:
            remove(received.draft)

    def record(
        self,
        progress: Callable[[float], object],
        *,
        product_id: str,
        part_id: str | None,
        camera: str,
        seconds: float | None,
        frames: int | None,
    ) -> Json:
        """A sweep from a camera, as the outcome of a job. Raises NoSuchCamera, WorkFailed, NotWritten, ObjectError."""
        url, draft = self.url(camera), self._files.incoming()
        asked = {"camera": url, "recording": str(draft), "seconds": seconds, "frames": frames}
        try:
            with naming({str(draft): "the recording", url: f"camera {camera}"}):
                made = self._recording.do("record", {**asked, "product_id": product_id, "part_id": part_id}, progress)
            received = Received(draft, made["bytes"], made["sha256"])
            sweep = self._add(received, product_id, part_id, made, "camera")
        finally:
            remove(draft)
        return {"sweep_id": sweep.sweep_id, "frames": sweep.frames, "losses": list(sweep.losses)}

    def _add(
        self, received: Received, product_id: str, part_id: str | None, found: Outcome, source: SweepSource
    ) -> Sweep:
        sweep_id, losses = new_id(), tuple(found["losses"])
        self._files.publish(received.draft, "sweep", sweep_id)
        sweep = Sweep(
            sweep_id,
            product_id,
            part_id,
            self._now_ns(),
            found["frames"],
            received.bytes,
            received.sha256,
            source,
            losses,
        )
        try:
            self._store.add_sweep(sweep)
        except BaseException:
            with suppress(OSError, WorldError):
                self._files.remove("sweep", sweep_id)
            raise
        return sweep
