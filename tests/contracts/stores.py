"""What every store must do; the tests of each inherit this and say which url to open."""

from __future__ import annotations

import itertools
import random
import re
import signal
import subprocess
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar
from unittest.mock import ANY

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import Engine, text
from sqlalchemy.exc import DBAPIError

from inspector.stores import AbstractStore, open_store
from inspector.stores.errors import (
    AlreadyConcluded,
    IdTaken,
    JobEnded,
    NewerStore,
    NoSuch,
    NoSuchAppearance,
    NoSuchInspection,
    NoSuchJob,
    NoSuchNode,
    NoSuchProduct,
    NoSuchRecipe,
    NoSuchSweep,
    NoSuchToken,
    NoSuchWorkspace,
    NotEnded,
    NothingToDecide,
    NotOwner,
    StoreFailed,
    StoreNotOpened,
)
from inspector.stores.records import (
    Buried,
    Checkpoint,
    Claim,
    Page,
    Product,
    Recipe,
    StoredAppearance,
    StoredInspection,
    StoredWorkspace,
    Sweep,
)
from inspector.stores.sql import SqlStore, inspections
from inspector.stores.sql.tables import METADATA
from tests.system.repository import ROOT

T = TypeVar("T")
NOW = 1_700_000_000_123_456_789
"""More than a float can hold."""
SWEEP = Sweep("s1", "plate", "0001", NOW, 398, 5_000_000_000, "ab" * 32, "upload", ("2 frames were cut short",))
APPEARANCE = StoredAppearance(
    "sha256:1", "plate", NOW, ("s1",), {"b": [1.5], "a": None}, ("only one sweep",), 7_000_000
)
BEFORE_AGES = (
    "DROP INDEX ix_inspections_scored",
    "DROP INDEX ix_inspections_part_id_number",
    "ALTER TABLE inspections DROP COLUMN scores_removed_ns",
)
"""What leads from revision 0005 back to 0004."""
ONE_SENTENCE = re.compile(r"[^\n]{20,400}")


def engine(store: AbstractStore) -> Engine:
    """The database behind the store's back."""
    assert isinstance(store, SqlStore)
    return store._database.engine


def behind(store: AbstractStore, *statements: str) -> None:
    """Do something to the database that the store would not."""
    with engine(store).begin() as connection:
        for statement in statements:
            connection.execute(text(statement))


def counted(store: AbstractStore, table: str) -> int:
    """The rows of a table."""
    with engine(store).connect() as connection:
        return connection.execute(text(f"SELECT count(*) FROM {table}")).scalar_one()


def learnt(store: AbstractStore, product_id: str = "plate") -> None:
    """A product with an appearance."""
    store.ensure_product(product_id, NOW)
    store.add_appearance(StoredAppearance("sha256:1", product_id, NOW, (), {}, (), 1))


def recipe(store: AbstractStore, recipe_id: str, product_id: str = "plate", **options: Any) -> Recipe:
    """A recipe on that appearance."""
    return store.add_recipe(recipe_id, product_id, "sha256:1", {"coverage": 0.9}, actor="ann", t_ns=NOW, **options)


def begin(store: AbstractStore, inspection_id: str, product_id: str = "plate", **options: Any) -> StoredInspection:
    """An inspection by that appearance."""
    usual: dict[str, Any] = {"part_id": None, "recipe_id": None, "appearance_id": "sha256:1", "policy": {}}
    return store.begin_inspection(inspection_id, product_id, begun_ns=NOW, **usual | options)


def conclude(store: AbstractStore, inspection_id: str, verdict: str = "OK", **options: Any) -> StoredInspection:
    """The end of it."""
    usual: dict[str, Any] = {"ended_ns": NOW + 1, "result": {"verdict": verdict}, "scores": b"scores"}
    return store.conclude_inspection(inspection_id, "completed", verdict=verdict, **usual | options)


def all_pages(ask: Callable[[int | None], Page[T]]) -> Iterator[T]:
    """The items of page after page."""
    page = ask(None)
    yield from page.items
    while page.next is not None:
        page = ask(page.next)
        assert page.items
        yield from page.items


def at_once(work: Callable[[int], T], count: int) -> list[T | Exception]:
    """What so many threads return, or raise."""

    def caught(k: int) -> T | Exception:
        try:
            return work(k)
        except Exception as error:
            return error

    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(caught, range(count)))


class StoreContract(ABC):
    """Inherit, and give the url of an empty store."""

    @abstractmethod
    @pytest.fixture
    def url(self) -> str:
        """The store under test."""

    @pytest.fixture
    def store(self, url: str) -> Iterator[AbstractStore]:
        with open_store(url) as store:
            yield store

    # Products, sweeps, appearances.

    def test_a_product_comes_into_being_once(self, store: AbstractStore) -> None:
        assert store.ensure_product("plate", NOW) == Product("plate", NOW)
        assert store.ensure_product("plate", NOW + 5) == Product("plate", NOW)
        assert store.product("plate") == Product("plate", NOW)
        assert store.products().items == (Product("plate", NOW),)

    def test_a_sweep_brings_its_product_and_comes_back_as_it_was(self, store: AbstractStore) -> None:
        store.add_sweep(SWEEP)
        assert store.product("plate").created_ns == NOW
        assert store.sweep("s1") == SWEEP
        assert store.sweeps("plate") == Page((SWEEP,), None)
        with pytest.raises(IdTaken, match="sweep 's1' is there already"):
            store.add_sweep(SWEEP)

    def test_an_appearance_may_be_learnt_again_and_stays_as_it_was_first(self, store: AbstractStore) -> None:
        store.ensure_product("plate", NOW)
        store.ensure_product("cap", NOW)
        again = StoredAppearance("sha256:1", "plate", NOW + 9, (), {}, (), 1)
        of_another = StoredAppearance("sha256:1", "cap", NOW + 9, (), {}, (), 1)
        assert store.add_appearance(APPEARANCE) == APPEARANCE
        assert store.add_appearance(again) == APPEARANCE
        assert store.add_appearance(of_another) == of_another
        assert store.appearance("plate", "sha256:1") == APPEARANCE
        assert store.appearances("plate").items == (APPEARANCE,)
        assert list(store.appearance("plate", "sha256:1").facts) == ["b", "a"]

    def test_what_is_unknown_is_said_by_its_name(self, store: AbstractStore) -> None:
        store.ensure_product("plate", NOW)
        asked: list[tuple[type[NoSuch], Callable[[], object]]] = [
            (NoSuchProduct, lambda: store.product("?")),
            (NoSuchProduct, lambda: store.sweeps("?")),
            (NoSuchProduct, lambda: store.appearances("?")),
            (NoSuchProduct, lambda: store.recipes("?")),
            (NoSuchProduct, lambda: store.active_recipe("?")),
            (NoSuchProduct, lambda: store.add_appearance(APPEARANCE.__class__("?", "?", 0, (), {}, (), 0))),
            (NoSuchProduct, lambda: recipe(store, "r", "?")),
            (NoSuchProduct, lambda: begin(store, "i", "?")),
            (NoSuchProduct, lambda: store.activate_recipe("?", "r", actor="ann", t_ns=NOW)),
            (NoSuchSweep, lambda: store.sweep("?")),
            (NoSuchAppearance, lambda: store.appearance("plate", "?")),
            (NoSuchWorkspace, lambda: store.workspace("?")),
            (NoSuchAppearance, lambda: store.add_recipe("r", "plate", "?", {}, actor="ann", t_ns=NOW)),
            (NoSuchAppearance, lambda: begin(store, "i", appearance_id="?")),
            (NoSuchJob, lambda: store.job("?")),
            (NoSuchJob, lambda: store.update_job("?", progress=0.5)),
            (NoSuchRecipe, lambda: store.recipe("?")),
            (NoSuchRecipe, lambda: store.activate_recipe("plate", "?", actor="ann", t_ns=NOW)),
            (NoSuchInspection, lambda: store.inspection("?")),
            (NoSuchInspection, lambda: store.scores("?")),
            (NoSuchInspection, lambda: conclude(store, "?")),
            (NoSuchInspection, lambda: store.acknowledge_inspection("?", NOW)),
            (NoSuchInspection, lambda: store.set_recording("?", "kept")),
            (NoSuchToken, lambda: store.revoke_token("?", actor="ann", t_ns=NOW)),
        ]
        for error, ask in asked:
            with pytest.raises(error, match=r"there is no [a-z]+ '\?'"):
                ask()
        assert store.audit().items == ()

    def test_any_text_can_be_asked_for_and_kept(self, store: AbstractStore) -> None:
        for odd in ("'; DROP TABLE products; --", "%", "ä€😀", "a\0b", "\ud800", "x" * 10_000):
            with pytest.raises(NoSuchProduct):
                store.product(odd)
            kept = odd.replace("\0", "?").replace("\ud800", "?")
            assert store.add_audit(t_ns=NOW, actor=odd, action="a", thing="t", after={"odd": odd}).actor == kept
        assert store.audit(after=10**30, limit=1).items[0].actor == "x" * 10_000

    # Workspaces.

    def test_workspaces_are_of_no_product_and_listed_newest_first(self, store: AbstractStore) -> None:
        made = [
            StoredWorkspace(f"sha256:{k}", name, NOW + k, "upload", {"objects": ["cup"]}, 7_000_000_000)
            for k, name in enumerate(["cups", None, "jig"])
        ]
        assert [store.add_workspace(each) for each in made] == made
        assert store.workspace("sha256:1") == made[1]
        assert [*all_pages(lambda after: store.workspaces(after, 2))] == made[::-1]
        again = replace(made[0], name="other", created_ns=NOW + 9)
        assert store.add_workspace(again) == made[0]
        assert len(store.workspaces().items) == 3
        assert store.products().items == ()

    # Jobs.

    def test_a_job_may_be_of_no_product(self, store: AbstractStore) -> None:
        job = store.add_job("j1", "workspace", None, {}, NOW)
        assert job.product_id is None
        assert store.jobs().items == (job,)
        assert store.jobs(product_id="plate").items == ()
        assert store.products().items == ()

    def test_a_job_runs_and_ends_once(self, store: AbstractStore) -> None:
        job = store.add_job("j1", "learn", "plate", {"sweep_ids": ["s1"]}, NOW)
        assert (job.state, job.progress, job.ended_ns, job.outcome, job.error) == ("running", 0.0, None, None, None)
        assert store.update_job("j1", progress=0.25).progress == 0.25
        ended = store.update_job("j1", progress=1, state="done", ended_ns=NOW + 1, outcome={"appearance_id": "x"})
        assert store.job("j1") == ended
        assert (ended.state, ended.outcome, ended.request) == ("done", {"appearance_id": "x"}, {"sweep_ids": ["s1"]})
        with pytest.raises(JobEnded, match="job 'j1' is done"):
            store.update_job("j1", progress=0.5)
        with pytest.raises(IdTaken):
            store.add_job("j1", "learn", "plate", {}, NOW)
        assert store.job("j1") == ended

    def test_jobs_are_listed_and_those_that_a_crash_ended_have_failed(self, store: AbstractStore) -> None:
        for k, product in enumerate(["plate", "cap", "plate"]):
            store.add_job(f"j{k}", "learn", product, {}, NOW)
        store.update_job("j0", state="done", ended_ns=NOW)
        assert [job.job_id for job in store.jobs().items] == ["j2", "j1", "j0"]
        assert [job.job_id for job in store.jobs(product_id="plate").items] == ["j2", "j0"]
        assert [job.job_id for job in store.jobs(product_id="plate", state="running").items] == ["j2"]
        assert store.fail_running_jobs(NOW + 2, "the service was killed") == ("j1", "j2")
        assert store.fail_running_jobs(NOW + 3, "the service was killed") == ()
        assert (store.job("j1").state, store.job("j1").error) == ("failed", "the service was killed")
        assert (store.job("j0").state, store.job("j1").ended_ns) == ("done", NOW + 2)

    # Recipes.

    def test_recipes_are_numbered_and_one_is_active(self, store: AbstractStore) -> None:
        learnt(store)
        learnt(store, "cap")
        assert store.active_recipe("plate") is None
        first, second = recipe(store, "r1"), recipe(store, "r2", activate=False, note="tried")
        other = recipe(store, "r3", "cap")
        assert [(each.version, each.active) for each in (first, second, other)] == [(1, True), (2, False), (1, True)]
        assert store.active_recipe("plate") == first == store.recipe("r1")
        now_active = store.activate_recipe("plate", "r2", actor="bob", t_ns=NOW)
        assert (now_active.version, now_active.active, now_active.note) == (2, True, "tried")
        assert store.active_recipe("plate") == now_active
        assert [(each.recipe_id, each.active) for each in store.recipes("plate").items] == [("r2", True), ("r1", False)]
        with pytest.raises(NoSuchRecipe):
            store.activate_recipe("plate", "r3", actor="bob", t_ns=NOW)
        with pytest.raises(IdTaken):
            recipe(store, "r1")
        assert store.active_recipe("plate") == now_active

    def test_every_edit_of_a_recipe_is_in_the_audit_trail(self, store: AbstractStore) -> None:
        learnt(store)
        recipe(store, "r1")
        recipe(store, "r2", activate=False)
        for _ in range(2):
            store.activate_recipe("plate", "r2", actor="bob", t_ns=NOW + 1)
        told = [
            (entry.action, entry.actor, entry.t_ns, entry.thing, (entry.before or {}).get("recipe_id"))
            for entry in reversed(store.audit().items)
        ]
        assert told == [
            ("recipe.add", "ann", NOW, "r1", None),
            ("recipe.add", "ann", NOW, "r2", "r1"),
            ("recipe.activate", "bob", NOW + 1, "r2", "r1"),
        ]
        after = store.audit().items[0].after
        assert after is not None
        assert (after["policy"], after["version"], after["active"]) == ({"coverage": 0.9}, 2, True)

    def test_recipes_that_are_added_at_once_have_versions_of_their_own(self, store: AbstractStore) -> None:
        learnt(store)
        added = [each for k in range(3) for each in at_once(lambda j, k=k: recipe(store, f"r{k}-{j}"), 8)]
        assert [each for each in added if isinstance(each, Exception)] == []
        recipes = store.recipes("plate", limit=100).items
        assert [each.version for each in recipes] == list(range(24, 0, -1))
        assert [each.version for each in recipes if each.active] == [24]
        entries = store.audit(limit=100).items
        for newer, older in itertools.pairwise(entries):
            assert newer.before == older.after

    # Inspections.

    def test_an_inspection_is_begun_concluded_and_acknowledged(self, store: AbstractStore) -> None:
        learnt(store)
        recipe(store, "r1")
        begun = begin(store, "i1", part_id="0007", recipe_id="r1", policy={"coverage": 0.9})
        assert (begun.state, begun.verdict, begun.recording, begun.source) == (
            "processing",
            None,
            "being written",
            "live",
        )
        assert store.scores("i1") is None
        with pytest.raises(NotEnded):
            store.acknowledge_inspection("i1", NOW)
        with pytest.raises(IdTaken):
            begin(store, "i1")
        ended = conclude(store, "i1", "NG", result={"deviations": [{"s_start": 0.1}]}, scores=bytes(range(256)))
        assert (ended.state, ended.verdict, ended.ended_ns, ended.ok_number) == ("completed", "NG", NOW + 1, None)
        assert (ended.part_id, ended.policy, ended.recipe_id) == ("0007", {"coverage": 0.9}, "r1")
        assert store.inspection("i1") == ended
        assert store.scores("i1") == bytes(range(256))
        assert store.acknowledge_inspection("i1", NOW + 5).acknowledged_ns == NOW + 5
        assert store.acknowledge_inspection("i1", NOW + 9).acknowledged_ns == NOW + 5
        assert store.inspection("i1").result == {"deviations": [{"s_start": 0.1}]}

    def test_an_inspection_is_concluded_once(self, store: AbstractStore) -> None:
        learnt(store)
        begin(store, "i1")
        begin(store, "i2")
        outcomes = at_once(lambda k: conclude(store, "i1", "OK", scores=bytes([k])), 8)
        assert [type(each) for each in outcomes].count(AlreadyConcluded) == 7
        winner = next(k for k, each in enumerate(outcomes) if isinstance(each, StoredInspection))
        assert store.scores("i1") == bytes([winner])
        aborted = store.conclude_inspection(
            "i2", "aborted", verdict=None, ended_ns=NOW, result=None, scores=None, reason="idle for 60 s"
        )
        assert (aborted.state, aborted.reason, store.scores("i2")) == ("aborted", "idle for 60 s", None)
        with pytest.raises(AlreadyConcluded, match="inspection 'i2' is aborted already"):
            conclude(store, "i2")

    def test_scores_go_by_age_and_everything_else_stays(self, store: AbstractStore) -> None:
        learnt(store)
        for k in range(6):
            begin(store, f"i{k}")
        for k, ended_ns in enumerate((40, 10, 30, 20)):
            conclude(store, f"i{k}", "NG", ended_ns=ended_ns, result={"k": k}, scores=bytes([k]))
        store.conclude_inspection(
            "i4", "failed", verdict=None, ended_ns=5, result=None, scores=None, reason="its scorer died"
        )
        was = [store.inspection(f"i{k}") for k in range(6)]
        assert [each.scores for each in was] == ["kept"] * 4 + ["none", "being written"]
        assert store.remove_scores(40, 2, NOW) == 2
        assert [store.scores(f"i{k}") for k in range(6)] == [b"\0", None, b"\2", None, None, None]
        assert [store.remove_scores(40, 2, NOW + 1), store.remove_scores(40, 2, NOW + 2)] == [1, 0]
        assert [store.scores(f"i{k}") for k in range(4)] == [b"\0", None, None, None]
        now = [store.inspection(f"i{k}") for k in range(6)]
        assert [each.scores_removed_ns for each in now] == [None, NOW, NOW + 1, NOW, None, None]
        assert [each.scores for each in now] == ["kept"] + ["removed"] * 3 + ["none", "being written"]
        assert [replace(each, scores_removed_ns=None) for each in now] == was

    def test_what_a_crash_left_in_processing_is_aborted(self, store: AbstractStore) -> None:
        learnt(store)
        for k in range(3):
            begin(store, f"i{k}")
        conclude(store, "i1")
        assert store.abort_processing(NOW + 7, "the service was killed") == ("i0", "i2")
        assert store.abort_processing(NOW + 8, "the service was killed") == ()
        left = store.inspection("i0")
        assert (left.state, left.ended_ns, left.reason) == ("aborted", NOW + 7, "the service was killed")
        assert store.inspection("i1").state == "completed"

    def test_pages_are_the_whole_list_newest_first_whatever_is_asked(self, store: AbstractStore) -> None:
        learnt(store)
        learnt(store, "cap")
        chance = random.Random(1)
        for k in range(40):
            begin(store, f"i{k}", chance.choice(["plate", "cap"]), source=chance.choice(["live", "replay"]))
            if chance.random() < 0.8:
                conclude(store, f"i{k}", chance.choice(["OK", "NG"]))
        everything = store.inspections(limit=100).items
        assert [each.inspection_id for each in everything] == [f"i{k}" for k in reversed(range(40))]
        names = ("product_id", "verdict", "state", "source")
        for asked in itertools.product((None, "cap"), (None, "NG"), (None, "completed"), (None, "replay")):
            filters: dict[str, Any] = dict(zip(names, asked, strict=True))
            wanted = [
                each
                for each in everything
                if all(value is None or getattr(each, name) == value for name, value in filters.items())
            ]
            for limit in (1, 3, len(wanted), 100):
                ask = partial(store.inspections, limit=limit, **filters)
                assert wanted == list(all_pages(lambda after, ask=ask: ask(after=after)))

    @pytest.mark.parametrize("few", [0, 2, 10_000])
    def test_parts_are_found_by_how_their_number_begins(
        self, store: AbstractStore, monkeypatch: pytest.MonkeyPatch, few: int
    ) -> None:
        monkeypatch.setattr(inspections, "_FEW", few)
        learnt(store)
        parts = ["A_1", "Ax1", "a_1", "A_", "B", "%", None, "Ü1", "Ü😀", "Ý"]
        for part in parts:
            begin(store, f"of {part}", part_id=part)
        for asked in ("A_", "A", "%", "a", "A_12", "Ü", "U"):
            found = [each.part_id for each in store.inspections(part=asked).items]
            assert found == [each for each in reversed(parts) if each is not None and each.startswith(asked)]
        assert len(store.inspections(product_id="plate", part="A", limit=2).items) == 2
        for limit in (1, 2, 3):
            ask = partial(store.inspections, part="A", limit=limit)
            paged = all_pages(lambda after, ask=ask: ask(after=after))
            assert [each.part_id for each in paged] == ["A_", "Ax1", "A_1"]

    def test_what_comes_while_paging_moves_nothing(self, store: AbstractStore) -> None:
        for k in range(9):
            store.add_sweep(Sweep(f"s{k}", "plate", None, NOW, 1, 1, "", "camera"))
        first = store.sweeps("plate", limit=4)
        store.add_sweep(Sweep("new", "plate", None, NOW, 1, 1, "", "camera"))
        second = store.sweeps("plate", first.next, limit=4)
        third = store.sweeps("plate", second.next, limit=4)
        seen = [each.sweep_id for page in (first, second, third) for each in page.items]
        assert seen == [f"s{k}" for k in reversed(range(9))]
        assert third.next is None
        assert store.sweeps("plate", after=-(10**30)).items == ()

    def test_what_people_say_is_kept_beside_the_verdict_and_the_last_word_counts(self, store: AbstractStore) -> None:
        learnt(store)
        begin(store, "i1")
        with pytest.raises(NotEnded):
            store.dispose("i1", "confirm", None, actor="ann", t_ns=NOW)
        assert conclude(store, "i1", "NG").disposition is None
        with pytest.raises(NothingToDecide, match="inspection 'i1' is NG already; confirm it"):
            store.dispose("i1", "overrule", "NG", actor="ann", t_ns=NOW)
        first = store.dispose("i1", "confirm", None, comment="a notch", actor="ann", t_ns=NOW + 5)
        told = {"decision": "confirm", "verdict": "NG", "comment": "a notch", "actor": "ann", "t_ns": NOW + 5}
        assert (first.verdict, first.disposition) == ("NG", told)
        second = store.dispose("i1", "overrule", "OK", comment="dust\0", actor="bob", t_ns=NOW + 6)
        assert (second.verdict, second.disposition) == ("NG", store.inspections().items[0].disposition)
        assert second.disposition == told | {
            "decision": "overrule", "verdict": "OK", "comment": "dust?", "actor": "bob", "t_ns": NOW + 6
        }  # fmt: skip
        said = store.dispositions("i1").items
        assert [(each.decision, each.verdict, each.actor) for each in said] == [
            ("overrule", "OK", "bob"),
            ("confirm", "NG", "ann"),
        ]
        assert store.dispositions("i1", after=said[0].number).items == said[1:]
        trail = store.audit().items
        assert [(each.action, each.thing, each.before) for each in trail] == [
            ("inspection.dispose", "i1", told),
            ("inspection.dispose", "i1", None),
        ]
        assert trail[0].after == {"given": "NG", **(second.disposition or {})}
        with pytest.raises(NoSuchInspection):
            store.dispose("i2", "confirm", None, actor="ann", t_ns=NOW)
        with pytest.raises(NoSuchInspection):
            store.dispositions("i2")

    def test_what_has_no_verdict_cannot_be_confirmed_but_a_person_may_say_what_it_is(
        self, store: AbstractStore
    ) -> None:
        learnt(store)
        begin(store, "i1")
        store.abort_processing(NOW, "killed")
        with pytest.raises(NothingToDecide, match="has no verdict to confirm; say what it is"):
            store.dispose("i1", "confirm", None, actor="ann", t_ns=NOW)
        assert (store.dispose("i1", "overrule", "OK", actor="ann", t_ns=NOW).disposition or {})["verdict"] == "OK"

    # Recordings.

    def test_recordings_are_listed_oldest_first_and_ok_ones_are_counted(self, store: AbstractStore) -> None:
        learnt(store)
        learnt(store, "cap")
        for k, (product, verdict) in enumerate([("plate", "OK"), ("cap", "OK"), ("plate", "NG"), ("plate", "OK")]):
            begin(store, f"i{k}", product)
            conclude(store, f"i{k}", verdict)
            store.set_recording(f"i{k}", "kept", 1000 + k)
        begin(store, "replay", source="replay", is_simulated=True, recording="none")
        assert conclude(store, "replay").ok_number is None
        begin(store, "now")
        kept = store.recordings()
        assert store.recordings("kept", limit=3) == kept[:3]
        assert store.recordings("kept", kept[2].number, limit=3) == kept[3:]
        assert [each.inspection_id for each in kept] == ["i0", "i1", "i2", "i3"]
        assert [each.ok_number for each in kept] == [1, 1, None, 2]
        assert (kept[2].verdict, kept[2].bytes, kept[2].ended_ns, kept[2].source) == ("NG", 1002, NOW + 1, "live")
        removed = store.set_recording("i0", "removed", note="older than 30 days")
        assert (removed.recording, removed.recording_bytes, removed.recording_note) == (
            "removed",
            0,
            "older than 30 days",
        )
        assert [each.inspection_id for each in store.recordings()] == ["i1", "i2", "i3"]
        assert [each.inspection_id for each in store.recordings("being written")] == ["now"]

    def test_ok_parts_that_are_concluded_at_once_are_counted_each(self, store: AbstractStore) -> None:
        learnt(store)
        for k in range(8):
            begin(store, f"i{k}")
        ended = at_once(lambda k: conclude(store, f"i{k}"), 8)
        assert sorted(each.ok_number or 0 for each in ended if isinstance(each, StoredInspection)) == list(range(1, 9))

    # Audit trail and tokens.

    def test_the_audit_trail_cannot_be_changed(self, store: AbstractStore) -> None:
        entry = store.add_audit(
            t_ns=NOW, actor="ann", action="camera.bumped", thing="plate", before={"a": 1}, after=None
        )
        insert = "INSERT INTO audit (number, t_ns, actor, action, thing) VALUES (1, 0, 'eve', '', '')"
        for statement in (
            "UPDATE audit SET actor = 'eve'",
            "DELETE FROM audit",
            f"{insert} ON CONFLICT (number) DO UPDATE SET actor = 'eve'",
            insert.replace("INSERT", "INSERT OR REPLACE")
            if engine(store).dialect.name == "sqlite"
            else "TRUNCATE audit",
        ):
            with pytest.raises(DBAPIError, match="the audit trail is append-only"):
                behind(store, statement)
        assert store.audit() == Page((entry,), None)

    def test_a_token_is_found_by_its_hash_and_revoked_once(self, store: AbstractStore) -> None:
        token = store.add_token("t1", "line 3", "operator", "cd" * 32, actor="ann", t_ns=NOW)
        assert store.token_by_hash("cd" * 32) == token
        assert store.token_by_hash("ef" * 32) is None
        for taken in (("t1", "00" * 32), ("t2", "cd" * 32)):
            with pytest.raises(IdTaken):
                store.add_token(taken[0], "again", "admin", taken[1], actor="ann", t_ns=NOW)
        revoked = store.revoke_token("t1", actor="bob", t_ns=NOW + 1)
        assert store.revoke_token("t1", actor="eve", t_ns=NOW + 2) == revoked
        assert (store.tokens(), revoked.revoked_ns) == ((revoked,), NOW + 1)
        assert [(entry.action, entry.actor) for entry in store.audit().items] == [
            ("token.revoke", "bob"),
            ("token.add", "ann"),
        ]
        assert "cd" * 32 not in str(store.audit())

    # Requests that may come twice.

    def test_a_claim_is_new_once_and_then_has_an_answer(self, store: AbstractStore) -> None:
        claims = at_once(lambda k: store.claim("begin", "key", "same", NOW), 8)
        assert sorted(each.state for each in claims if isinstance(each, Claim)) == ["new"] + ["pending"] * 7
        assert store.claim("begin", "key", "another", NOW) == Claim("other")
        assert store.claim("conclude", "key", "another", NOW) == Claim("new")
        store.settle("begin", "key", 201, b'{"inspection_id": "i1"}')
        assert store.claim("begin", "key", "same", NOW) == Claim("settled", 201, b'{"inspection_id": "i1"}')
        store.release("begin", "key")
        assert store.claim("begin", "key", "same", NOW).state == "settled"

    def test_a_claim_whose_work_was_not_done_is_new_again(self, store: AbstractStore) -> None:
        for key in ("a", "b", "c"):
            assert store.claim("begin", key, "", NOW).state == "new"
        store.release("begin", "a")
        assert store.claim("begin", "a", "another", NOW).state == "new"
        store.settle("begin", "b", 200, b"")
        assert store.release_pending_claims() == 2
        assert [store.claim("begin", key, "", NOW + 10).state for key in ("b", "c")] == ["settled", "new"]
        assert store.forget_claims(NOW + 1) == 1
        assert store.claim("begin", "b", "", NOW).state == "new"
        assert store.forget_claims(NOW + 100) == 0

    def test_who_was_taken_for_gone_has_no_word_in_what_another_began_anew(self, store: AbstractStore) -> None:
        for node in ("asleep", "awake"):
            store.join(node, node, NOW)
        assert store.claim("begin", "key", "", NOW, node="asleep").state == "new"
        store.leave("asleep", "it was silent")
        store.settle("begin", "key", 500, b"of nobody", node="asleep")
        assert store.claim("begin", "key", "", NOW, node="awake").state == "new"
        store.release("begin", "key", node="asleep")
        store.settle("begin", "key", 500, b"too late", node="asleep")
        assert store.claim("begin", "key", "", NOW, node="asleep").state == "pending"
        store.settle("begin", "key", 201, b"done", node="awake")
        store.settle("begin", "key", 500, b"again", node="awake")
        assert store.claim("begin", "key", "", NOW, node="asleep") == Claim("settled", 201, b"done")

    # Services that share the store.

    def test_services_join_say_that_they_live_and_leave(self, store: AbstractStore) -> None:
        assert store.nodes() == ()
        store.join("n1", "left", NOW)
        store.join("n2", "right", NOW + 1)
        one, two = store.nodes()
        assert (one.node_id, one.name, one.started_ns, one.facts, two.node_id) == ("n1", "left", NOW, {}, "n2")
        assert 0 <= one.silent_seconds < 60
        behind(store, "UPDATE nodes SET beaten_ns = beaten_ns - 3600000000000")
        store.beat("n1", {"running": 3})
        store.beat("n1")
        one, two = store.nodes()
        assert (one.facts, two.facts) == ({"running": 3}, {})
        assert one.silent_seconds < 60
        assert 3600 <= two.silent_seconds < 3660
        for _ in range(2):
            store.leave("n1", "it was stopped")
        assert [node.node_id for node in store.nodes()] == ["n2"]
        with pytest.raises(NoSuchNode, match="there is no service 'n1'"):
            store.beat("n1")
        store.join("n2", "right", NOW + 2)
        assert store.nodes()[0].silent_seconds < 60

    def test_what_silent_services_had_is_free_again_and_told_once(self, store: AbstractStore) -> None:
        learnt(store)
        for node in ("lives", "dead"):
            store.join(node, node, NOW)
            begin(store, f"i-{node}", node=node)
            store.add_job(f"j-{node}", "learn", "plate", {}, NOW, node=node)
            store.claim("begin", node, "", NOW, node=node)
            store.claim("begin", f"{node}, settled", "", NOW, node=node)
            store.settle("begin", f"{node}, settled", 200, b"", node=node)
        begin(store, "i-done", node="dead")
        conclude(store, "i-done", node="dead")
        store.add_job("j-nobody", "learn", "plate", {}, NOW)
        begin(store, "i-nobody")
        nobody = store.bury(60, "it is gone")
        assert (nobody.nodes, nobody.job_ids, nobody.inspection_ids) == ((), ("j-nobody",), ("i-nobody",))
        behind(store, "UPDATE nodes SET beaten_ns = beaten_ns - 3600000000000 WHERE node_id = 'dead'")
        assert store.claim("begin", "lives", "", NOW).state == "pending"
        buried = [each for each in at_once(lambda k: store.bury(60, "it is gone"), 4) if isinstance(each, Buried)]
        assert len(buried) == 4
        assert [node.node_id for each in buried for node in each.nodes] == ["dead"]
        assert [job_id for each in buried for job_id in each.job_ids] == ["j-dead"]
        assert [inspection_id for each in buried for inspection_id in each.inspection_ids] == ["i-dead"]
        job, left = store.job("j-dead"), store.inspection("i-dead")
        assert (job.state, job.error, store.job("j-lives").state) == ("failed", "it is gone", "running")
        assert (left.state, left.node, store.inspection("i-lives").node) == ("processing", None, "lives")
        gone = store.leave("lives", "it was stopped")
        assert ([node.node_id for node in gone.nodes], gone.inspection_ids) == (["lives"], ("i-lives",))
        assert store.job("j-lives").error == "it was stopped"
        assert abs((left.left_ns or 0) - time.time_ns()) < 60e9
        assert abs((job.ended_ns or 0) - time.time_ns()) < 60e9
        assert sorted(each.inspection_id for each in store.ownerless()) == ["i-dead", "i-lives", "i-nobody"]
        claims = {key: store.claim("begin", key, "", NOW).state for key in ("dead", "dead, settled", "lives")}
        assert claims == {"dead": "new", "dead, settled": "settled", "lives": "new"}

    def test_an_inspection_is_of_one_service_and_no_other_writes_to_it(self, store: AbstractStore) -> None:
        learnt(store)
        begun = begin(store, "i1", node="n1")
        assert (begun.node, begun.left_ns, begun.takes) == ("n1", None, 0)
        assert store.ownerless() == ()
        writes: list[Callable[[str], object]] = [
            lambda node: store.save_checkpoint("i1", node, 0, b"", b""),
            lambda node: store.release_inspection("i1", node, NOW),
            lambda node: conclude(store, "i1", node=node),
        ]
        for write in writes:
            with pytest.raises(NotOwner, match="'i1' is not of this service any more: service 'n1' has it"):
                write("n2")
        with pytest.raises(NotOwner):
            conclude(store, "i1")
        taken, none = store.take_inspection("i1", "n2")
        assert (taken.node, taken.takes, none) == ("n2", 1, None)
        with pytest.raises(NotOwner, match="service 'n2' has it"):
            conclude(store, "i1", node="n1")
        left = store.release_inspection("i1", "n2", NOW + 5)
        assert (left.node, left.left_ns, store.ownerless()) == (None, NOW + 5, (left,))
        with pytest.raises(NotOwner, match="no service has it"):
            conclude(store, "i1", node="n2")
        assert store.take_inspection("i1", "n1")[0].left_ns is None
        ended = conclude(store, "i1", node="n1")
        assert (ended.node, ended.takes, ended.ok_number) == ("n1", 2, 1)
        for late in (
            lambda: store.take_inspection("i1", "n2"),
            lambda: store.release_inspection("i1", "n1", NOW),
            lambda: store.save_checkpoint("i1", "n1", 0, b"", b""),
        ):
            with pytest.raises(AlreadyConcluded):
                late()
        with pytest.raises(NoSuchInspection):
            store.take_inspection("i2", "n1")
        with pytest.raises(NoSuchInspection):
            store.save_checkpoint("i2", "n1", 0, b"", b"")

    def test_who_takes_an_inspection_gets_what_was_saved_of_it(self, store: AbstractStore) -> None:
        learnt(store)
        begin(store, "i1", node="n1")
        begin(store, "i2", node="n1")
        for number, added in enumerate([b"a", b"bb", b"", b"d\0"]):
            store.save_checkpoint("i1", "n1", number, b"state %d" % number, added)
        store.save_checkpoint("i1", "n1", 3, b"state once more", b"dd")
        store.save_checkpoint("i2", "n1", 0, b"other", b"other")
        assert store.take_inspection("i1", "n2")[1] == Checkpoint(b"state once more", (b"a", b"bb", b"", b"dd"))
        with pytest.raises(NotOwner):
            store.save_checkpoint("i1", "n1", 4, b"late", b"late")
        store.save_checkpoint("i1", "n2", 4, b"further", b"e")
        assert store.take_inspection("i1", "n3")[1] == Checkpoint(b"further", (b"a", b"bb", b"", b"dd", b"e"))
        conclude(store, "i1", node="n3")
        assert counted(store, "checkpoints") == counted(store, "checkpoint_parts") == 1
        assert store.abort_processing(NOW, "the end") == ("i2",)
        assert counted(store, "checkpoints") == counted(store, "checkpoint_parts") == 0

    def test_whoever_takes_an_inspection_last_has_it(self, store: AbstractStore) -> None:
        learnt(store)
        begin(store, "i1", node="first")

        def take_and_save(k: int) -> int:
            taken, checkpoint = store.take_inspection("i1", f"n{k}")
            assert taken.takes - 1 >= (len(checkpoint.added) if checkpoint else 0)
            store.save_checkpoint("i1", f"n{k}", len(checkpoint.added) if checkpoint else 0, b"%d" % k, b"")
            return taken.takes

        outcomes = at_once(take_and_save, 8)
        assert {type(each) for each in outcomes} <= {int, NotOwner}
        now = store.inspection("i1")
        assert (now.takes, now.node in {f"n{k}" for k in range(8)}) == (8, True)
        # The last one was disturbed by nobody.
        assert outcomes[int((now.node or "")[1:])] == 8
        assert store.take_inspection("i1", "n9")[1] == Checkpoint((now.node or "")[1:].encode(), ANY)

    def test_a_state_that_a_crash_has_lost_is_told_apart_from_none(self, store: AbstractStore) -> None:
        learnt(store)
        begin(store, "i1", node="n1")
        store.save_checkpoint("i1", "n1", 0, b"state", b"a")
        behind(store, "DELETE FROM checkpoints")
        assert store.take_inspection("i1", "n2")[1] == Checkpoint(b"", (b"a",))
        store.save_checkpoint("i1", "n2", 1, b"later", b"b")
        assert store.take_inspection("i1", "n3")[1] == Checkpoint(b"later", (b"a", b"b"))

    def test_a_checkpoint_is_of_one_piece_whoever_takes_the_inspection_meanwhile(self, store: AbstractStore) -> None:
        learnt(store)
        begin(store, "i1", node="first")

        def feed(k: int) -> int:
            """Take it and go on, until another takes it: the state tells of all that was added."""
            saved = 0
            for turn in range(8):
                node = f"n{k}-{turn}"
                _, checkpoint = store.take_inspection("i1", node)
                added = [*checkpoint.added] if checkpoint else []
                assert (checkpoint.state if checkpoint else b"") == b"".join(added)
                with suppress(NotOwner):
                    for number in range(4):
                        added.append(f"{node}-{number} ".encode())
                        store.save_checkpoint("i1", node, len(added) - 1, b"".join(added), added[-1])
                        saved += 1
            return saved

        outcomes = at_once(feed, 4)
        assert [each for each in outcomes if isinstance(each, Exception)] == []
        _, checkpoint = store.take_inspection("i1", "last")
        assert checkpoint is not None
        assert checkpoint.state == b"".join(checkpoint.added)
        assert len(checkpoint.added) == sum(each for each in outcomes if isinstance(each, int))

    def test_only_one_does_what_only_one_may_do(self, store: AbstractStore) -> None:
        with store.only_one("tidy") as mine, store.only_one("tidy") as again, store.only_one("else") as other:
            assert (mine, again, other) == (True, False, True)
            with store.only_one("tidy") as once_more:
                assert not once_more
        with suppress(KeyError), store.only_one("tidy") as mine:
            assert mine
            raise KeyError
        with store.only_one("tidy") as mine:
            assert mine

    # The store itself.

    def test_a_transaction_that_fails_leaves_nothing(self, store: AbstractStore) -> None:
        learnt(store)
        behind(store, "DROP TABLE scores")
        begin(store, "i1")
        with pytest.raises(StoreFailed, match="scores") as failed:
            conclude(store, "i1")
        assert ONE_SENTENCE.fullmatch(str(failed.value))
        assert store.inspection("i1").state == "processing"
        assert conclude(store, "i1", scores=None).ok_number == 1

    def test_it_answers_and_may_be_closed_twice(self, url: str) -> None:
        store = open_store(url)
        store.ping()
        store.close()
        store.close()

    def test_the_scripts_build_the_tables(self, store: AbstractStore) -> None:
        with engine(store).connect() as connection:
            context = MigrationContext.configure(
                connection, opts={"compare_type": True, "compare_server_default": True, "target_metadata": METADATA}
            )
            assert compare_metadata(context, METADATA) == []


OPENS = """
import sys
from inspector.stores import open_store
print("ready", flush=True)
sys.stdin.readline()
with open_store(sys.argv[1]) as store:
    store.ensure_product(sys.argv[2], 1)
"""
WORKS = """
import sys
from inspector.stores import open_store
from inspector.stores.records import StoredAppearance
store = open_store(sys.argv[1])
store.ensure_product("plate", 1)
store.add_appearance(StoredAppearance("sha256:1", "plate", 1, (), {}, (), 1))
for k in range(100_000):
    name = f"i{k}"
    store.begin_inspection(name, "plate", part_id=None, recipe_id=None, appearance_id="sha256:1", policy={}, begun_ns=k)
    store.conclude_inspection(name, "completed", verdict="OK", ended_ns=k, result={"k": k}, scores=b"s" * 5000)
    print(name, flush=True)
"""


def process(program: str, *arguments: str) -> subprocess.Popen[str]:
    """The program, with pipes to talk to it."""
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT)


class DurableStoreContract(StoreContract):
    """For stores that are there when their process is gone."""

    def test_what_was_kept_is_there_when_it_is_opened_again(self, url: str) -> None:
        with open_store(url) as store:
            store.add_sweep(SWEEP)
            store.add_appearance(APPEARANCE)
        with open_store(url) as store, open_store(url) as another:
            assert store.sweep("s1") == another.sweep("s1") == SWEEP
            another.ensure_product("cap", NOW)
            assert store.product("cap").created_ns == NOW

    def test_a_database_of_before_dispositions_keeps_what_it_has(self, url: str) -> None:
        with open_store(url) as store:
            learnt(store)
            begin(store, "i1")
            was = conclude(store, "i1", "NG")
            store.add_token("t1", "line 3", "operator", "cd" * 32, actor="ann", t_ns=NOW)
            job = store.add_job("j1", "learn", "plate", {"sweep_ids": ["s1"]}, NOW)
            behind(
                store,
                *BEFORE_AGES,
                "DROP TABLE workspaces",
                *(f"DROP TABLE {name}" for name in ("nodes", "told", "checkpoints", "checkpoint_parts")),
                "DROP INDEX ix_claims_pending",
                *(f"ALTER TABLE {name} DROP COLUMN node" for name in ("inspections", "jobs", "claims")),
                *(f"ALTER TABLE inspections DROP COLUMN {name}" for name in ("left_ns", "takes")),
                "DROP TABLE dispositions",
                "ALTER TABLE inspections DROP COLUMN disposition",
                "UPDATE alembic_version SET version_num = '0001'",
            )
        with open_store(url) as store:
            assert (store.inspection("i1"), store.scores("i1"), len(store.audit().items)) == (was, b"scores", 1)
            assert store.dispose("i1", "confirm", None, actor="ann", t_ns=NOW).disposition is not None
            assert (store.job("j1"), store.add_job("j2", "workspace", None, {}, NOW).product_id) == (job, None)
            with pytest.raises(DBAPIError, match="the audit trail is append-only"):
                behind(store, "DELETE FROM audit")

    def test_scores_of_a_database_of_before_their_ages_go_by_age(self, url: str) -> None:
        with open_store(url) as store:
            learnt(store)
            was = [conclude(store, begin(store, f"i{k}").inspection_id, ended_ns=k) for k in range(3)]
            behind(store, *BEFORE_AGES, "UPDATE alembic_version SET version_num = '0004'")
        with open_store(url) as store:
            assert [store.inspection(f"i{k}") for k in range(3)] == was
            assert store.remove_scores(2, 10, NOW) == 2
            assert [store.scores(f"i{k}") for k in range(3)] == [None, None, b"scores"]
            assert [store.inspection(f"i{k}").scores for k in range(3)] == ["removed", "removed", "kept"]

    def test_processes_that_open_a_new_store_at_once_all_get_it(self, url: str) -> None:
        processes = [process(OPENS, url, f"p{k}") for k in range(3)]
        for each in processes:
            assert each.stdout is not None
            assert each.stdout.readline() == "ready\n"
        for each in processes:
            assert each.stdin is not None
            each.stdin.write("go\n")
            each.stdin.flush()
        assert [each.communicate()[0] for each in processes] == [""] * 3
        assert [each.returncode for each in processes] == [0] * 3
        with open_store(url) as store:
            assert {each.product_id for each in store.products().items} == {"p0", "p1", "p2"}

    @pytest.mark.parametrize("after", [1, 20])
    def test_what_was_concluded_is_there_after_a_kill(self, url: str, after: int) -> None:
        worker = process(WORKS, url)
        assert worker.stdout is not None
        for _ in range(after):
            worker.stdout.readline()
        worker.send_signal(signal.SIGKILL)
        said, _ = worker.communicate()
        concluded = after + len(said.splitlines())
        with open_store(url) as store:
            left = store.abort_processing(NOW, "killed")
            assert len(left) <= 1
            assert store.inspections(state="processing").items == ()
            for k in range(concluded):
                assert store.inspection(f"i{k}").result == {"k": k}
                assert store.scores(f"i{k}") == b"s" * 5000

    def test_a_database_of_a_newer_program_is_refused(self, url: str) -> None:
        with open_store(url) as store:
            behind(store, "UPDATE alembic_version SET version_num = '9999'")
        with pytest.raises(NewerStore, match="a newer program has written it \\(revision 9999, known is ") as refused:
            open_store(url)
        assert ONE_SENTENCE.fullmatch(str(refused.value))

    def test_a_database_of_another_program_is_left_alone(self, url: str) -> None:
        with open_store(url) as store:
            behind(store, "UPDATE alembic_version SET version_num = version_num", "DROP TABLE alembic_version")
        with pytest.raises(StoreNotOpened, match="already exists"):
            open_store(url)
