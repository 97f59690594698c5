"""The services that share a store: which there are, what is told to them, and what is heard from them."""

from __future__ import annotations

import asyncio
import json
import socket
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import structlog

from inspector.errors import StoreError
from inspector.service.events import EVERY, Events
from inspector.service.folder import new_id
from inspector.service.heart import STOPPED, Heart
from inspector.stores.base import AbstractStore
from inspector.stores.records import Buried, Json, Node

TELL_SECONDS = 0.25
"""Events are told so often, as many at a time as there are."""
_LINGER_SECONDS = 30.0
"""For so long after the last listener left, everything is still told to this service."""
_UNTOLD = 4096
"""Events that may wait to be told while the database is away."""
_MOST = 7800
"""Bytes that fit into one notification."""
_PICTURE_BYTES = 1.5e6
"""A second, of pictures for listeners at other services: they go through the database."""
_KEPT_HERE = frozenset({"station", "missed"})
"""Kinds of events that are about this service only."""
_FOR_LISTENERS = frozenset({"scores"})
"""Kinds that are told where somebody listens: they are most of what there is to tell."""
_ENDS = frozenset({"verdict", "aborted", "interrupted"})


class Peers:
    """The other services, seen from this one. On a store that is not shared there are none, and nothing is done.

    Used from the event loop, where handlers are called, too.
    """

    def __init__(
        self,
        store: AbstractStore,
        events: Events,
        *,
        now_ns: Callable[[], int] = time.time_ns,
        facts: Callable[[], Json] = dict,
    ) -> None:
        """`facts` is what the others are told of this service."""
        self.node_id, self.name = new_id(), socket.gethostname()
        self._store, self._events, self._now_ns, self._facts = store, events, now_ns, facts
        self._log = structlog.get_logger("inspector")
        self._nodes: dict[str, Node] = {}
        self._handlers: dict[str, Callable[[Json], object]] = {}
        self._untold: deque[tuple[str, str]] = deque(maxlen=_UNTOLD)
        self._overflowed = 0
        self._changed = False
        self._told: Json = {}
        self._versions = 0
        self._pictures: OrderedDict[str, str] = OrderedDict()
        """Those to tell, who waits for longest first."""
        self._picture_room = 0.0
        self._listened_at: float | None = None
        self._closed = False
        self._voice = ThreadPoolExecutor(1, thread_name_prefix="voice")
        self._ear = ExitStack()
        self._teller: asyncio.Task[None] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._me = Node(self.node_id, self.name, now_ns(), 0.0, {})
        self._heart = Heart(
            store,
            self._me,
            facts=lambda: self._told,
            saw=lambda others: self._soon(self._saw, others),
            freed=self._told_of,
        )

    async def start(self) -> None:
        """Join the others. Raises StoreFailed."""
        self._loop = asyncio.get_running_loop()
        if not self._store.shared:
            return
        await asyncio.to_thread(self._heart.start)
        await asyncio.to_thread(self._ear.enter_context, self._store.listen(self.node_id, self._heard))
        self._events.told, self._events.shown = self._tell_event, self._tell_picture
        self._teller = asyncio.create_task(self._tell())

    async def stop(self) -> None:
        """Leave the others; what waits to be told is told before. A second call does nothing."""
        if self._teller is None:
            return
        self._closed = True
        self._teller.cancel()
        await asyncio.gather(self._teller, return_exceptions=True)
        self._teller = None
        self._events.told = self._events.shown = None
        await asyncio.to_thread(self._leave)

    @property
    def nodes(self) -> tuple[Node, ...]:
        """All services, this one first, as they were a second ago at the most."""
        return replace(self._me, facts=self._facts()), *self._nodes.values()

    def _leave(self) -> None:
        """In a thread."""
        self._voice.shutdown()
        try:
            for kind, facts in self._lost(self._heart.stop(), STOPPED):
                self._untold.append((kind, json.dumps(facts)))
        except StoreError as error:
            # The others find out for themselves.
            self._log.warning("service not signed off", error=str(error))
        self._say([*self._batches(), _message({"from": self.node_id, "do": "left"})])
        self._ear.close()

    def on(self, kind: str, handler: Callable[[Json], object]) -> None:
        """What to do where another service asks for something of that kind."""
        self._handlers[kind] = handler

    def ask(self, node_id: str, kind: str, **facts: object) -> bool:
        """Ask another service for something; False where it is not there. Whether it does it, it does not say."""
        if node_id not in self._nodes or self._closed:
            return False
        head = {"from": self.node_id, "do": "ask", "kind": kind, "facts": facts}
        self._voice.submit(self._say, [_message(head)], [node_id])
        return True

    def troubles(self) -> list[str]:
        """A sentence, where the others take this service for gone, or soon will."""
        why = self._heart.trouble
        return [f"the other services do not hear from this one: {why}"] if why is not None else []

    # What the heart, a thread, found out.

    def _told_of(self, buried: Buried, why: str) -> None:
        for node in buried.nodes:
            self._log.warning("service gone", node_id=node.node_id, name=node.name)
            self._soon(self._forget, node.node_id)
        for kind, facts in self._lost(buried, why):
            self._events.publish_soon(kind, **facts)

    def _lost(self, buried: Buried, why: str) -> Iterator[tuple[str, Json]]:
        """Events of what services had that are gone."""
        for job_id in buried.job_ids:
            self._log.warning("job", job_id=job_id, state="failed", error=why)
            yield "job", {"job_id": job_id, "state": "failed", "error": why}
        for inspection_id in buried.inspection_ids:
            names = {"inspection_id": inspection_id, "product_id": self._store.inspection(inspection_id).product_id}
            self._log.warning("inspection", **names, state="interrupted", why=why)
            yield "interrupted", {**names, "reason": why}

    def _soon(self, function: Callable[..., object], *arguments: object) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(function, *arguments)

    def _saw(self, others: Iterable[Node]) -> None:
        # What a service told itself may be newer than what it has in the store.
        known = {node.node_id: node.facts for node in self._nodes.values()}
        latest = [(node, max(node.facts, known.get(node.node_id, {}), key=_version)) for node in others]
        self._nodes = {node.node_id: replace(node, facts=facts) for node, facts in latest}
        self._events.watched_by({node_id: _watching(node) for node_id, node in self._nodes.items()})

    def _forget(self, node_id: str) -> None:
        self._saw([node for node in self._nodes.values() if node.node_id != node_id])

    # What this service tells.

    def _told_now(self) -> Json:
        """What the others are told of this service: what they need to know to tell it no more than it wants."""
        return {**self._facts(), "listening": self._listening(), "watching": self._events.watched}

    def _listening(self) -> bool:
        now, before = time.monotonic(), self._listened_at
        if self._events.listeners:
            self._listened_at = now
            if before is not None and now - before > _LINGER_SECONDS and self._nodes and self._loop is not None:
                # Scores were not told here meanwhile: whoever came back should look.
                self._loop.call_later(1.0, self._events.hear, "missed", "{}")
        return self._listened_at is not None and now - self._listened_at < _LINGER_SECONDS

    def _tell_event(self, kind: str, data: str) -> None:
        """Events tells what was published."""
        if kind == "":
            self._changed = True
        elif kind not in _KEPT_HERE and self._nodes:
            self._overflowed += len(self._untold) == _UNTOLD
            self._untold.append((kind, data))

    def _tell_picture(self, inspection_id: str, data: str | None) -> None:
        if data is None:
            self._pictures.pop(inspection_id, None)
        elif self._watchers(inspection_id):
            self._pictures[inspection_id] = data

    def _watchers(self, inspection_id: str) -> list[str]:
        return [node.node_id for node in self._nodes.values() if {EVERY, inspection_id} & {*_watching(node)}]

    async def _tell(self) -> None:
        """A few times a second, to all others: what happened here, and whether anybody listens."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(TELL_SECONDS)
            bodies = [*self._batches()]
            bodies += self._news()
            if bodies and not await loop.run_in_executor(self._voice, self._say, bodies):
                self._overflowed += 1
            await self._tell_pictures()

    def _news(self) -> Iterator[bytes]:
        """What is to be known of this service, where that has changed."""
        told = {**self._told_now(), "version": self._versions}
        if told == self._told:
            return
        self._versions += 1
        self._told = {**told, "version": self._versions}
        if self._nodes:
            yield _message({"from": self.node_id, "do": "facts", "name": self.name, "facts": self._told})

    async def _tell_pictures(self) -> None:
        self._picture_room = min(_PICTURE_BYTES * TELL_SECONDS, self._picture_room + _PICTURE_BYTES * TELL_SECONDS)
        while self._pictures and self._picture_room > 0:
            inspection_id, data = self._pictures.popitem(last=False)
            watchers = self._watchers(inspection_id)
            if watchers:
                # Written once, and read by each.
                self._picture_room -= len(data) * (1 + len(watchers)) / 2
                head = {"from": self.node_id, "do": "picture", "inspection_id": inspection_id}
                told = _message(head, data.encode())
                await asyncio.get_running_loop().run_in_executor(self._voice, self._say, [told], watchers)

    def _batches(self) -> Iterator[bytes]:
        """What waits to be told, as messages that fit."""
        events, self._untold = self._untold, deque(maxlen=_UNTOLD)
        changed, self._changed = self._changed, False
        if self._overflowed:
            self._overflowed = 0
            events.append(("missed", "{}"))
        if not self._nodes:
            return
        listening = any(node.facts.get("listening", True) for node in self._nodes.values())
        lines = [f"{kind} {data}".encode() for kind, data in events if listening or kind not in _FOR_LISTENERS]
        head = {"from": self.node_id, "do": "events"}
        for batch in _packed(lines):
            yield _message(head, b"\n".join(batch))
        if changed and not lines:
            yield _message(head)

    def _say(self, bodies: Collection[bytes], to: Collection[str] | None = None) -> bool:
        """In a thread."""
        try:
            for body in bodies:
                self._store.tell(body, to)
        except StoreError as error:
            # The heart says so, once.
            self._log.debug("not told to other services", error=str(error))
            return False
        return True

    # What this service hears.

    def _heard(self, body: bytes | None) -> None:
        """In a thread of the store."""
        self._soon(self._hear, body)

    def _hear(self, body: bytes | None) -> None:
        if body is None:
            self._events.forget_others()
            self._events.hear("missed", "{}")
            return
        first, _, rest = body.partition(b"\n")
        head = json.loads(first)
        if head["from"] == self.node_id:
            return
        match head["do"]:
            case "events":
                self._hear_events(rest)
            case "picture":
                self._events.see(head["inspection_id"], rest.decode())
            case "facts":
                self._hear_facts(head)
            case "left":
                self._forget(head["from"])
            case "ask" if head["kind"] in self._handlers:
                self._handlers[head["kind"]](head["facts"])
            case _:
                self._log.warning("not understood", said=head["do"])

    def _hear_events(self, lines: bytes) -> None:
        self._events.changed(here=False)
        for line in filter(None, lines.split(b"\n")):
            kind, _, data = line.decode().partition(" ")
            self._events.hear(kind, data)
            if kind in _ENDS:
                self._events.forget(json.loads(data)["inspection_id"])

    def _hear_facts(self, head: Json) -> None:
        node_id = head["from"]
        known = self._nodes.get(node_id) or Node(node_id, head["name"], self._now_ns(), 0.0, {})
        self._nodes[node_id] = replace(known, facts=head["facts"])
        self._saw([*self._nodes.values()])


def _message(head: Json, rest: bytes = b"") -> bytes:
    """A line of JSON, and what comes with it."""
    return json.dumps(head, separators=(",", ":")).encode() + b"\n" + rest


def _packed(lines: Iterable[bytes]) -> Iterator[list[bytes]]:
    """As many at a time as fit; one that does not fit alone."""
    batch: list[bytes] = []
    size = 0
    for line in lines:
        if batch and size + len(line) > _MOST:
            yield batch
            batch, size = [], 0
        batch.append(line)
        size += len(line) + 1
    if batch:
        yield batch


def _version(facts: Json) -> int:
    return facts.get("version", 0)


def _watching(node: Node) -> tuple[str, ...]:
    watching: Any = node.facts.get("watching", ())
    return tuple(watching)
