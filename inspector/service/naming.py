"""What lies under a camera instead of its part: asked beside everything else, told when it is known."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import structlog

from inspector.errors import WorldError
from inspector.service.files import Files
from inspector.service.recognising import Recognising
from inspector.service.running import Ended, Running
from inspector.stores.records import Json

_SECONDS = 5.0
"""How long a result waits for the name."""
_log = structlog.get_logger("inspector")


class Naming:
    """Used from the event loop; `keep` makes a task that is not lost while it runs."""

    def __init__(
        self, recognising: Recognising, files: Files, keep: Callable[[Coroutine[Any, Any, Any]], asyncio.Task[Any]]
    ) -> None:
        self._recognising, self._files, self._keep = recognising, files, keep

    async def prepare(self) -> None:
        """Have the parts ready that there are, where there are several. Raises WorldError."""
        await asyncio.to_thread(self._recognising.prepare)

    def ask(self, running: Running, pictures: Sequence[bytes]) -> None:
        """What these pictures of its beginning show."""
        running.recognised = self._keep(self._asked(running, pictures))

    async def named(self, running: Running, ended: Ended) -> Ended:
        """With the name, where somebody looks for it; a desk that is too busy is not waited for long."""
        result = ended.result
        if running.recognised is None or not ended.doubted:
            return ended
        with suppress(TimeoutError):
            found = await asyncio.wait_for(asyncio.shield(running.recognised), _SECONDS)
            if found is not None:
                known = {name: value for name, value in found.items() if name != "sentence"}
                reasons = [found["sentence"], *result["reasons"]]
                return replace(ended, result=result | {"recognised": known, "reasons": reasons})
        return ended

    async def _asked(self, running: Running, pictures: Sequence[bytes]) -> Json | None:
        product_id, appearance_id = running.product_id, running.facts["appearance_id"]
        try:
            found = await asyncio.to_thread(self._recognising.recognise, product_id, appearance_id, pictures)
        except WorldError as error:
            _log.warning("recognise", **running.facts, error=self._files.hidden(str(error)))
            return None
        if found is not None and running.phase not in ("ended", "moved"):
            running.tell("recognised", found)
        return found
