"""Batches of the service: many recordings that it has, inspected once more by one recipe; each as a replay is kept.

inspector.errors.WorldError
└── NothingChosen            a batch of no recording
"""

from __future__ import annotations

import hashlib
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Literal

from inspector.errors import WorldError
from inspector.locations import shown_place
from inspector.service.desk import Desk
from inspector.service.files import Files
from inspector.service.recipes import recipe_of
from inspector.service.recognising import Recognising
from inspector.service.replays import Replay, Replays
from inspector.stores.base import AbstractStore
from inspector.stores.errors import IdTaken, NoSuchInspection, NoSuchSweep
from inspector.stores.records import Json, StoredInspection, Sweep
from models.errors import InspectionError
from models.verdict import Policy

Of = Literal["inspections", "sweeps"]
_PAGE = 200
_TOLD = 1000
"""Sentences about failures that an outcome holds, at the most."""
_APART_NS = 300_000_000
"""Between two words about progress."""


class NothingChosen(WorldError):
    """A batch of no recording."""

    def __init__(self, product_id: str, of: Of) -> None:
        super().__init__(f"no {of} of product {product_id!r} were chosen; allowed are ids, or a filter that some match")


@dataclass(frozen=True)
class Batch:
    """What is to be inspected once more."""

    product_id: str
    of: Of
    ids: tuple[str, ...]
    recipe_id: str
    policy: Policy | None
    """In place of the recipe's."""

    @property
    def request(self) -> Json:
        """For the job."""
        policy = None if self.policy is None else asdict(self.policy)
        return {"of": f"{len(self.ids)} {self.of}", "recipe_id": self.recipe_id, "policy": policy}


class Batches:
    """Chooses recordings, and has them replayed at a desk, by an executor. Everything here blocks."""

    def __init__(
        self,
        store: AbstractStore,
        files: Files,
        replays: Replays,
        recognising: Recognising,
        *,
        desk: Desk,
        executor: str,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._store, self._files, self._replays, self._recognising = store, files, replays, recognising
        self._desk, self._executor, self._now_ns = desk, executor, now_ns

    def choose(
        self,
        product_id: str,
        of: Of,
        *,
        ids: Sequence[str] | None,
        last: int,
        verdict: str | None,
        part: str | None,
        recipe_id: str | None,
        policy: Policy | None,
    ) -> Batch:
        """Those of the ids; else the newest of the product, inspections with this verdict, whose part begins so.

        The recipe is the active one where none is named. Raises NoSuch, NoRecipe, NothingChosen.
        """
        recipe = recipe_of(self._store, product_id, recipe_id)
        if ids is not None:
            chosen = list(dict.fromkeys(ids))
            for each in chosen:
                self._check(product_id, of, each)
        elif of == "sweeps":
            chosen = [sweep.sweep_id for sweep in self._sweeps(product_id, last)]
        else:
            chosen = [each.inspection_id for each in self._inspections(product_id, last, verdict, part)]
        if not chosen:
            raise NothingChosen(product_id, of)
        return Batch(product_id, of, tuple(chosen), recipe.recipe_id, policy)

    def _check(self, product_id: str, of: Of, id: str) -> None:
        if of == "sweeps" and self._store.sweep(id).product_id != product_id:
            raise NoSuchSweep(id)
        if of == "inspections" and self._store.inspection(id).product_id != product_id:
            raise NoSuchInspection(id)

    def _sweeps(self, product_id: str, last: int) -> Iterator[Sweep]:
        after: int | None = None
        while last > 0:
            page = self._store.sweeps(product_id, after, min(last, _PAGE))
            yield from page.items
            last, after = last - len(page.items), page.next
            if after is None:
                return

    def _inspections(
        self, product_id: str, last: int, verdict: str | None, part: str | None
    ) -> Iterator[StoredInspection]:
        """Live ones that have a recording."""
        after: int | None = None
        while last > 0:
            page = self._store.inspections(
                product_id=product_id, verdict=verdict, part=part, source="live", after=after, limit=_PAGE
            )  # fmt: skip
            kept = [each for each in page.items if each.recording == "kept"][:last]
            yield from kept
            last, after = last - len(kept), page.next
            if after is None:
                return

    def run(self, progress: Callable[[float], object], batch: Batch) -> Json:
        """The outcome of a job: counts, verdicts, and a sentence for each recording that could not be inspected.

        What is there from before, of the same recording, recipe and policy, is not done again. Raises WorkFailed,
        WorkerDied, DeskClosed, StoreError; what is done by then is kept.
        """
        counts, verdicts, said = Counter[str](recordings=len(batch.ids)), Counter[str](), list[str]()
        todo: dict[int, tuple[str, Replay]] = {}
        for number, id in enumerate(batch.ids):
            try:
                asked = self._replay(batch, id)
            except InspectionError as error:
                counts["failed"] += 1
                said.append(f"{batch.of[:-1]} {id}: {error}")
                continue
            new, done = self._free(asked)
            if done is None:
                todo[number] = new, asked
            else:
                counts["before"] += 1
                verdicts[str(done.verdict)] += 1
        told_ns = 0

        def made(piece: Json) -> None:
            nonlocal told_ns
            inspection_id, asked = todo[piece["number"]]
            if (why := piece.get("error")) is not None:
                counts["failed"] += 1
                said.append(f"{asked.thing}: {self._named(asked, why)}")
            else:
                counts["done"] += 1
                verdicts[self._keep(inspection_id, asked, piece)] += 1
            if self._now_ns() - told_ns >= _APART_NS:
                told_ns = self._now_ns()
                progress((counts["before"] + counts["done"] + counts["failed"]) / counts["recordings"])

        if todo:
            self._do(todo, made)
        more = [f"and {len(said) - _TOLD} more"] if len(said) > _TOLD else []
        names = ("recordings", "before", "done", "failed")
        return {
            "batch": {**{name: counts[name] for name in names}, "verdicts": dict(verdicts)},
            "said": [*said[:_TOLD], *more],
        }

    def _replay(self, batch: Batch, id: str) -> Replay:
        inspection_id, sweep_id = (id, None) if batch.of == "inspections" else (None, id)
        return self._replays.prepare(inspection_id, sweep_id, batch.recipe_id, batch.policy)

    def _free(self, asked: Replay) -> tuple[str, StoredInspection | None]:
        """An id for what it becomes, and what it became before: the same is asked for by the same id."""
        told = json.dumps({**asked.request, "appearance_id": asked.recipe.appearance_id}, sort_keys=True)
        number = 0
        while True:
            inspection_id = hashlib.sha256(f"{told} {number}".encode()).hexdigest()[:32]
            try:
                found = self._store.inspection(inspection_id)
            except NoSuchInspection:
                return inspection_id, None
            if found.state == "completed":
                return inspection_id, found
            # Begun, and the service died before it was concluded.
            number += 1

    def _do(self, todo: dict[int, tuple[str, Replay]], made: Callable[[Json], object]) -> None:
        recipe = next(iter(todo.values()))[1].recipe
        pieces = [
            {"number": number, "recording": asked.recording, "names": asked.names}
            for number, (_, asked) in todo.items()
        ]
        asked = {
            "executor": self._executor,
            "pieces": pieces,
            "appearance": str(self._files.local_appearance(recipe.appearance_id)),
            "policy": recipe.policy,
            "others": self._recognising.others(
                recipe.product_id, recipe.appearance_id, far=self._executor.startswith(("dask:", "ray:"))
            ),
        }
        self._desk.do("batch", asked, made=made)

    def _keep(self, inspection_id: str, asked: Replay, piece: Json) -> str:
        """Its verdict."""
        try:
            return str(self._replays.keep(inspection_id, asked, piece, self._now_ns()).verdict)
        except IdTaken:
            # The same batch at another service.
            return str(piece["result"]["verdict"])

    def _named(self, asked: Replay, why: str) -> str:
        return self._files.hidden(why.replace(shown_place(asked.recording), "its recording"))
