"""What was recorded, inspected once more; what was scored, judged once more.

inspector.errors.WorldError
└── NoScores                 an inspection without scores
"""

from __future__ import annotations

import time
from base64 import b64decode, b64encode
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

from inspector.errors import WorldError
from inspector.locations import shown_place
from inspector.service.desk import Desk, naming
from inspector.service.errors import RecordingGone, ScoresGone
from inspector.service.files import Files
from inspector.service.folder import new_id
from inspector.service.recipes import recipe_of
from inspector.service.recognising import Recognising
from inspector.service.scored import kept_scores
from inspector.stores.base import AbstractStore
from inspector.stores.records import Json, Recipe, StoredInspection
from models.verdict import Policy

_AT_A_TIME = 20
"""Inspections whose scores are handed over at once."""


class NoScores(WorldError):
    """An inspection without scores."""

    def __init__(self, inspection_id: str, state: str) -> None:
        super().__init__(f"inspection {inspection_id!r} has no scores: it is {state}; allowed are completed ones")


@dataclass(frozen=True)
class Replay:
    """What is to be replayed, and by what."""

    recording: str
    """A path or a URL."""
    thing: str
    """What the recording is of, in words."""
    part_id: str | None
    recipe: Recipe
    """Its policy is the one to judge by."""

    @property
    def names(self) -> Json:
        """For the result."""
        recipe = self.recipe
        return {
            "result_id": new_id(),
            "product_id": recipe.product_id,
            "part_id": self.part_id,
            "recipe_id": recipe.recipe_id,
        }

    @property
    def request(self) -> Json:
        """For the job."""
        return {"of": self.thing, "recipe_id": self.recipe.recipe_id, "policy": self.recipe.policy}


class Replays:
    """Replays recordings, and judges stored scores again. Everything here blocks."""

    def __init__(
        self,
        store: AbstractStore,
        files: Files,
        desk: Desk,
        recognising: Recognising,
        now_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._store, self._files, self._desk, self._now_ns = store, files, desk, now_ns
        self._recognising = recognising

    def prepare(
        self, inspection_id: str | None, sweep_id: str | None, recipe_id: str | None, policy: Policy | None
    ) -> Replay:
        """What one of the two ids means; the recipe is that of the inspection, or the product's active one.

        Raises NoSuch, RecordingGone, NoRecipe.
        """
        if inspection_id is not None:
            stored = self._store.inspection(inspection_id)
            thing, part_id, product_id = f"inspection {inspection_id}", stored.part_id, stored.product_id
            place, recipe_id = self._recording(stored), recipe_id or stored.recipe_id
        else:
            sweep = self._store.sweep(sweep_id or "")
            thing, part_id, product_id = f"sweep {sweep.sweep_id}", sweep.part_id, sweep.product_id
            place = self._files.place("sweep", sweep.sweep_id)
        recipe = recipe_of(self._store, product_id, recipe_id)
        if policy is not None:
            recipe = replace(recipe, policy=asdict(policy))
        return Replay(place, thing, part_id, recipe)

    def _recording(self, stored: StoredInspection) -> str:
        if stored.recording == "kept" and self._files.size("inspection", stored.inspection_id) is not None:
            return self._files.place("inspection", stored.inspection_id)
        raise RecordingGone(stored.inspection_id, stored.recording, stored.recording_note)

    def replay(self, progress: Callable[[float], object], asked: Replay) -> StoredInspection:
        """The inspection that it became: simulated, of source `replay`, its scores stored. Raises WorkFailed."""
        recipe, begun_ns = asked.recipe, self._now_ns()
        appearance = self._files.local_appearance(recipe.appearance_id)
        shown = {shown_place(asked.recording): f"the recording of {asked.thing}", str(appearance): "the appearance"}
        with naming(shown):
            made = self._desk.do(
                "replay",
                {
                    "recording": asked.recording,
                    "appearance": str(appearance),
                    "policy": recipe.policy,
                    "names": asked.names,
                    "others": self._recognising.others(recipe.product_id, recipe.appearance_id),
                },
                progress,
            )
        return self.keep(new_id(), asked, made, begun_ns)

    def keep(self, inspection_id: str, asked: Replay, made: Json, begun_ns: int) -> StoredInspection:
        """What a replay came to, as an inspection of that id. Raises IdTaken."""
        recipe = asked.recipe
        # Begun and concluded at once, when it is done: what fails, or is killed, leaves nothing half.
        self._store.begin_inspection(
            inspection_id,
            recipe.product_id,
            part_id=asked.part_id,
            recipe_id=recipe.recipe_id,
            appearance_id=recipe.appearance_id,
            policy=recipe.policy,
            begun_ns=begun_ns,
            source="replay",
            is_simulated=True,
            recording="none",
        )
        return self._store.conclude_inspection(
            inspection_id,
            "completed",
            verdict=made["result"]["verdict"],
            ended_ns=self._now_ns(),
            result=made["result"] | {"inspection_id": inspection_id, "replay_of": asked.thing},
            scores=b64decode(made["scores"]),
        )

    def choose(self, product_id: str, inspection_ids: Sequence[str] | None, last: int) -> list[StoredInspection]:
        """Completed inspections of a product: those named, or the latest live ones, newest first.

        Raises NoSuchProduct, NoSuchInspection, NoScores, and of those named ScoresGone.
        """
        self._store.product(product_id)
        if inspection_ids is not None:
            chosen = [self._store.inspection(inspection_id) for inspection_id in inspection_ids]
            for each in chosen:
                if each.product_id != product_id or each.state != "completed":
                    raise NoScores(each.inspection_id, f"of product {each.product_id}, {each.state}")
                if each.scores_removed_ns is not None:
                    raise ScoresGone(each.inspection_id, each.scores_removed_ns)
            return chosen
        return list(self._latest(product_id, last))

    def _latest(self, product_id: str, last: int) -> Iterator[StoredInspection]:
        after: int | None = None
        while last > 0:
            page = self._store.inspections(
                product_id=product_id, state="completed", source="live", after=after, limit=min(last, 200)
            )  # fmt: skip
            yield from page.items
            last, after = last - len(page.items), page.next
            if after is None:
                return

    def rejudge(self, policy: Policy, chosen: Sequence[StoredInspection]) -> Json:
        """What another policy would have said of them; nothing is stored. Raises WorkFailed.

        Those whose scores are gone are left out, and counted as `gone`.
        """
        now: dict[str, Json] = {}
        for appearance_id in dict.fromkeys(each.appearance_id for each in chosen):
            path = str(self._files.local_appearance(appearance_id))
            alike = [each for each in chosen if each.appearance_id == appearance_id]
            for at in range(0, len(alike), _AT_A_TIME):
                some = list(self._scored(alike[at : at + _AT_A_TIME]))
                if not some:
                    continue
                with naming({path: f"appearance {appearance_id}"}):
                    asked = {"appearance": path, "policy": asdict(policy), "inspections": some}
                    made = self._desk.do("rejudge", asked)
                now |= {each["inspection_id"]: each for each in made["inspections"]}
        found = [
            {"part_id": each.part_id, "ended_ns": each.ended_ns, "before": each.verdict, **now[each.inspection_id]}
            for each in chosen
            if each.inspection_id in now
        ]
        return {
            "changed": sum(each["before"] != each["now"] for each in found),
            "gone": len(chosen) - len(found),
            "counts": {
                "before": dict(Counter(each["before"] for each in found)),
                "now": dict(Counter(each["now"] for each in found)),
            },
            "inspections": found,
        }

    def _scored(self, chosen: Sequence[StoredInspection]) -> Iterator[Json]:
        for stored in chosen:
            try:
                scores = kept_scores(self._store, stored)
            except ScoresGone:
                continue
            if scores is None:
                raise NoScores(stored.inspection_id, stored.state)
            result = stored.result or {}
            yield {
                "inspection_id": stored.inspection_id,
                "scores": b64encode(scores).decode(),
                "policy": stored.policy,
                "dropped": result.get("frames_dropped", 0),
                "stopped": result.get("stopped", False),
            }
