"""Pictures located and parts tracked, in the processes that score: one turn each among the frames of inspections."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Iterator
from itertools import count

from inspector.protocol import SentFrame
from inspector.scorers.pool import Pool, Scorer
from inspector.scorers.wire import Head
from inspector.service.errors import Busy, LocatorLost, PictureRefused, Stopping, TooManyTracked
from inspector.service.files import Files
from inspector.service.folder import new_id
from inspector.service.load import Load
from inspector.stores.base import AbstractStore
from inspector.stores.records import StoredWorkspace
from models.errors import AppearanceError

CREDITS = 2
"""Frames of a tracked part that may be unanswered: one in work, and the newest."""
_WAITING = 16
"""Pictures that may wait to be located, of each scorer."""


class _Line:
    """Single pictures of one scorer, one after the other: together they have one turn among its inspections."""

    def __init__(self, scorer: Scorer) -> None:
        self.scorer, self.name = scorer, f"locate-{scorer.number}"
        self._numbers = count()
        self._asked: dict[int, asyncio.Future[bytes]] = {}

    async def locate(self, facts: Head, picture: bytes) -> bytes:
        """What is said of it, as JSON. Raises Busy, PictureRefused, LocatorLost, AppearanceError."""
        if len(self._asked) >= _WAITING:
            raise Busy(len(self._asked))
        number = next(self._numbers)
        future = self._asked[number] = asyncio.get_running_loop().create_future()
        try:
            self.scorer.ask(self, {"do": "locate", "id": self.name, "sequence": number, **facts}, picture)
            return await asyncio.shield(future)
        finally:
            self._asked.pop(number, None)

    def prepare(self, facts: Head) -> None:
        """Have a workspace ready; one that cannot be read is told to who asks for it."""
        self.scorer.ask(self, {"do": "prepare", "id": self.name, "sequence": next(self._numbers), **facts})

    def heard(self, head: Head, body: bytes) -> None:
        """See Listener."""
        future = self._asked.get(head["sequence"])
        if future is None or future.done():
            return
        if head["did"] == "failed":
            future.set_exception(AppearanceError(head["why"]))
        elif "refused" in head:
            future.set_exception(PictureRefused(head["refused"]))
        else:
            future.set_result(body)

    def sent(self, head: Head) -> None:
        """See Listener."""

    def died(self, why: str) -> None:
        """See Listener."""
        for future in self._asked.values():
            if not future.done():
                future.set_exception(LocatorLost(why))


class Trail:
    """One part that is tracked; `messages` are taken by the connection that sends its frames.

    Of frames that come faster than they are located only the newest is kept: what is old is of no use to a hand.
    """

    def __init__(self, scorer: Scorer, workspace: StoredWorkspace, path: str) -> None:
        self.id, self.scorer, self.workspace = new_id(), scorer, workspace
        self.messages: deque[bytes] = deque()
        self.news = asyncio.Event()
        self.ended: str | None = None
        """Why nothing more will be said."""
        self.hand: tuple[float, ...] | None = None
        """Where the hand is at the frames that come."""
        self.load = Load()
        self._facts: Head = {"workspace_id": workspace.workspace_id, "path": path}
        self._ready: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._last = -1
        self._at_work = False
        self._newest: tuple[SentFrame, tuple[float, ...] | None] | None = None

    async def prepare(self) -> None:
        """Have the scorer ready for frames. Raises AppearanceError, LocatorLost."""
        self.scorer.ask(self, {"do": "prepare", "id": self.id, "sequence": 0, **self._facts})
        await self._ready

    def offer(self, sent: SentFrame) -> None:
        """Every frame is answered by one message: `located`, `refused`, `dropped` or `duplicate`."""
        if self.ended is not None:
            return
        if sent.sequence <= self._last:
            self.tell({"kind": "duplicate", "sequence": sent.sequence})
            return
        self._last = sent.sequence
        self.load.came(sent.t_ns)
        if not self._at_work:
            self._ask(sent, self.hand)
            return
        if self._newest is not None:
            why = "a newer frame came before this one was located"
            self.tell({"kind": "dropped", "sequence": self._newest[0].sequence, "why": why})
        self._newest = sent, self.hand

    def tell(self, message: dict[str, object]) -> None:
        """One message more."""
        self._said(json.dumps(message).encode())

    def end(self, why: str) -> None:
        """Nothing more will be said. A second call changes nothing."""
        self.ended = self.ended or why
        self.news.set()

    def heard(self, head: Head, body: bytes) -> None:
        """See Listener."""
        if not self._ready.done():
            if head["did"] == "failed":
                self._ready.set_exception(AppearanceError(head["why"]))
            else:
                self._ready.set_result(None)
            return
        self._at_work = False
        if head["did"] == "failed":
            self.end(head["why"])
            return
        self.load.took(head["took"])
        if "refused" in head:
            self.tell({"kind": "refused", "sequence": head["sequence"], "why": head["refused"]})
        else:
            self._said(b'{"kind":"located",' + body[1:])
        if self._newest is not None:
            newest, self._newest = self._newest, None
            self._ask(*newest)

    def sent(self, head: Head) -> None:
        """See Listener."""

    def died(self, why: str) -> None:
        """See Listener."""
        if not self._ready.done():
            self._ready.set_exception(LocatorLost(why))
        self.end(why)

    def _ask(self, sent: SentFrame, hand: tuple[float, ...] | None) -> None:
        self._at_work = True
        head: Head = {"do": "track", "id": self.id, "sequence": sent.sequence, "t_ns": sent.t_ns, "hand": hand}
        self.scorer.ask(self, head | self._facts, sent.picture)

    def _said(self, message: bytes) -> None:
        self.messages.append(message)
        self.news.set()


class Locating:
    """All that is located and tracked here. Used from the event loop; the store is asked in threads."""

    def __init__(self, store: AbstractStore, files: Files, pool: Pool, *, most: int) -> None:
        self._store, self._files, self._pool, self._most = store, files, pool, most
        self._lines = {scorer: _Line(scorer) for scorer in pool.scorers}
        self._trails: dict[str, Trail] = {}
        self._stopping = False

    async def start(self) -> None:
        """The newest workspace is loaded before parts come: the first one holds a scorer up for half a second."""
        newest = await asyncio.to_thread(self._store.workspaces, None, 1)
        for workspace in newest.items:
            for line in self._lines.values():
                line.prepare(await asyncio.to_thread(self._facts, workspace.workspace_id))

    async def locate(self, workspace_id: str, picture: bytes) -> bytes:
        """What is said of a picture, as JSON.

        Raises NoSuchWorkspace, Busy, PictureRefused, LocatorLost, AppearanceError, Stopping.
        """
        facts = await asyncio.to_thread(self._known, workspace_id)
        line = self._lines[min(self._alive(), key=lambda each: (each.waiting, each.number))]
        return await line.locate(facts, picture)

    async def track(self, workspace_id: str) -> Trail:
        """A part to be tracked, until `forget`; its workspace is loaded.

        Raises NoSuchWorkspace, TooManyTracked, LocatorLost, AppearanceError, Stopping.
        """
        workspace = await asyncio.to_thread(self._store.workspace, workspace_id)
        path = await asyncio.to_thread(self._files.local, "workspace", workspace_id)
        scorers = self._alive()
        if len(self._trails) >= self._most:
            raise TooManyTracked(self._most)
        scorer = min(scorers, key=lambda each: (len(each.listeners), each.number))
        trail = Trail(scorer, workspace, str(path))
        self._trails[trail.id] = trail
        try:
            await trail.prepare()
        except BaseException:
            self.forget(trail)
            raise
        return trail

    def forget(self, trail: Trail) -> None:
        """It is not tracked any more."""
        if self._trails.pop(trail.id, None) is not None:
            trail.scorer.forget(trail.id)
            trail.scorer.dismiss(trail.id)

    def loads(self) -> Iterator[tuple[Scorer, float]]:
        """What tracking needs of each scorer's time."""
        return ((trail.scorer, trail.load.share) for trail in self._trails.values())

    def stop(self) -> None:
        """Nothing more is located."""
        self._stopping = True
        for trail in self._trails.values():
            trail.end("the service is being stopped")

    def _known(self, workspace_id: str) -> Head:
        self._store.workspace(workspace_id)
        return self._facts(workspace_id)

    def _facts(self, workspace_id: str) -> Head:
        return {"workspace_id": workspace_id, "path": str(self._files.local("workspace", workspace_id))}

    def _alive(self) -> list[Scorer]:
        if self._stopping:
            raise Stopping
        alive = [scorer for scorer in self._pool.scorers if scorer.alive]
        if not alive:
            raise LocatorLost("no process is there to do it")
        return alive
