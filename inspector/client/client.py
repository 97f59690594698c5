"""Client: what a line, or whoever teaches one, asks of the service."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import quote

from inspector.client.asking import Asker
from inspector.client.base import AbstractInspection, OnMessage
from inspector.client.errors import ServiceRefused
from inspector.client.posting import PostedInspection
from inspector.client.streaming import StreamedInspection
from inspector.errors import NotARecording

TRANSPORTS: Mapping[str, type[AbstractInspection]] = {"ws": StreamedInspection, "rest": PostedInspection}
_BLOCK = 1 << 20
_POLL_SECONDS = 0.5


class Client:
    """One service. A context manager: leaving it closes its connections."""

    def __init__(
        self,
        url: str,
        token: str | None = None,
        *,
        timeout: float = 10.0,
        patience: float = 30.0,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        """`timeout`: seconds that one answer may take; `patience`: that a service may be away, or busy, in all.

        Raises NotSendable.
        """
        self._asker = Asker(url, token, timeout=timeout, patience=patience, clock=clock, sleep=sleep)

    def begin(
        self,
        product_id: str,
        part_id: str,
        *,
        recipe_id: str | None = None,
        transport: str = "ws",
        on_message: OnMessage = lambda message: None,
    ) -> AbstractInspection:
        """An inspection that is ready for frames; `part_id` is the serial number, `recipe_id` the active one if None.

        By `ws` the line hears of deviations and of an early NG as they come; by `rest` it gets the answers to its
        frames. Raises ServiceUnreachable, ServiceRefused, NotUnderstood, as everything here does.
        """
        asked = {"product_id": product_id, "part_id": part_id, "recipe_id": recipe_id}
        asker = self._asker.of_session()
        begun = asker.open_session("/v1/inspections", asked, "inspection_id", "recipe_id", "appearance_id")
        return TRANSPORTS[transport](asker, begun, on_message)

    def upload_sweep(self, path: Path | str, product_id: str, part_id: str | None = None) -> str:
        """The `sweep_id` of a recording, given to the service. Raises NotARecording, too."""
        told = self._asker.post_once(
            _of(product_id, "sweeps"),
            "sweep_id",
            content=_blocks(Path(path)),
            params={} if part_id is None else {"part_id": part_id},
            headers={"Content-Type": "application/octet-stream"},
        )
        return told["sweep_id"]

    def learn(
        self,
        product_id: str,
        sweep_ids: Sequence[str],
        *,
        add_to: str | None = None,
        on_progress: Callable[[float], object] = lambda share: None,
    ) -> str:
        """The `appearance_id` of what was learnt from golden sweeps, the first of which is the map; waits for it.

        `add_to` names an appearance that they are added to. `on_progress` is told the share that is done, in [0, 1].
        """
        asked = {"sweep_ids": list(sweep_ids), "add_to": add_to}
        job_id = self._asker.post(_of(product_id, "appearances"), asked, "job_id")["job_id"]
        while True:
            job = self._asker.get(f"/v1/jobs/{job_id}", "state", "progress", "appearance_id", "error")
            on_progress(job["progress"])
            if job["state"] == "done":
                return job["appearance_id"]
            if job["state"] == "failed":
                raise ServiceRefused(200, "Not learnt", job["error"] or "nobody said why")
            self._asker.sleep(_POLL_SECONDS)

    def make_recipe(
        self,
        product_id: str,
        appearance_id: str | None = None,
        *,
        policy: Mapping[str, float] | None = None,
        activate: bool = True,
        note: str = "",
    ) -> str:
        """The `recipe_id` of a new version, active at once; the appearance is the active recipe's if None."""
        asked: dict[str, Any] = {"appearance_id": appearance_id, "activate": activate, "note": note}
        asked["policy"] = dict(policy or {})
        return self._asker.post(_of(product_id, "recipes"), asked, "recipe_id")["recipe_id"]

    def close(self) -> None:
        """Let the connections go."""
        self._asker.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _of(product_id: str, what: str) -> str:
    return f"/v1/products/{quote(product_id, safe='')}/{what}"


def _blocks(path: Path) -> Iterator[bytes]:
    try:
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                yield block
    except OSError as error:
        raise NotARecording(path, error.strerror or str(error)) from error
