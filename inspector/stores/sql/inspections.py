"""Inspections, their scores, and what became of their recordings."""

from __future__ import annotations

from sqlalchemy import ColumnElement, Connection, delete, func, insert, select, update

from inspector.stores.errors import NoSuchInspection, NoSuchRecipe, NotEnded, NothingToDecide
from inspector.stores.records import (
    Decision,
    Disposition,
    Ended,
    InspectionSource,
    InspectionState,
    Json,
    Page,
    RecordingState,
    StoredInspection,
    StoredRecording,
)
from inspector.stores.sql.database import found, insert_new, made, names, page
from inspector.stores.sql.owned import forget_checkpoints, inspection_row, not_owned, owned_by
from inspector.stores.sql.products import appearance_of
from inspector.stores.sql.room import Room, product_row, row_by, write_down
from inspector.stores.sql.tables import DISPOSITIONS, INSPECTIONS, PRODUCTS, RECIPES, SCORES

_COLUMN = INSPECTIONS.c
_FEW = 10_000
"""Inspections of parts that begin alike: so many are looked up. Of more, the newest are soon met by going through
all."""
_LAST_WORD = "decision", "verdict", "comment", "actor", "t_ns"


class Inspections(Room):
    """Inspections, scores, recordings."""

    def begin_inspection(
        self,
        inspection_id: str,
        product_id: str,
        *,
        part_id: str | None,
        recipe_id: str | None,
        appearance_id: str,
        policy: Json,
        begun_ns: int,
        source: InspectionSource = "live",
        is_simulated: bool = False,
        recording: RecordingState = "being written",
        node: str | None = None,
    ) -> StoredInspection:
        values = {
            "inspection_id": inspection_id,
            "product_id": product_id,
            "part_id": part_id,
            "recipe_id": recipe_id,
            "appearance_id": appearance_id,
            "policy": policy,
            "state": "processing",
            "is_simulated": is_simulated,
            "source": source,
            "begun_ns": begun_ns,
            "recording": recording,
            "node": node,
        }
        with self._database.writing() as connection:
            product_row(connection, product_id)
            appearance_of(connection, product_id, appearance_id)
            if recipe_id is not None:
                found(row_by(connection, RECIPES, "recipe_id", recipe_id), NoSuchRecipe, recipe_id)
            return made(StoredInspection, insert_new(connection, INSPECTIONS, "inspection", inspection_id, values))

    def conclude_inspection(
        self,
        inspection_id: str,
        state: Ended,
        *,
        verdict: str | None,
        ended_ns: int,
        result: Json | None,
        scores: bytes | None,
        reason: str | None = None,
        node: str | None = None,
    ) -> StoredInspection:
        mine = _COLUMN.inspection_id == inspection_id
        values = {"state": state, "verdict": verdict, "ended_ns": ended_ns, "result": result, "reason": reason}
        ended = update(INSPECTIONS).where(mine, *owned_by(node)).values(values)
        with self._database.writing() as connection:
            row = connection.execute(ended.returning(INSPECTIONS)).one_or_none()
            if row is None:
                raise not_owned(connection, inspection_id)
            if state == "completed" and verdict == "OK" and row.source == "live":
                counted = (
                    update(PRODUCTS)
                    .where(PRODUCTS.c.product_id == row.product_id)
                    .values(ok_count=PRODUCTS.c.ok_count + 1)
                    .returning(PRODUCTS.c.ok_count)
                )
                numbered = update(INSPECTIONS).where(mine).values(ok_number=connection.execute(counted).scalar_one())
                row = connection.execute(numbered.returning(INSPECTIONS)).one()
            if scores is not None:
                connection.execute(insert(SCORES).values(inspection_id=inspection_id, scores=scores))
            forget_checkpoints(connection, [inspection_id])
            return made(StoredInspection, row)

    def acknowledge_inspection(self, inspection_id: str, t_ns: int) -> StoredInspection:
        first = (
            update(INSPECTIONS)
            .where(
                _COLUMN.inspection_id == inspection_id,
                _COLUMN.state != "processing",
                _COLUMN.acknowledged_ns.is_(None),
            )
            .values(acknowledged_ns=t_ns)
        )
        with self._database.writing() as connection:
            connection.execute(first)
            row = inspection_row(connection, inspection_id)
            if row.state == "processing":
                raise NotEnded(inspection_id)
            return made(StoredInspection, row)

    def dispose(
        self, inspection_id: str, decision: Decision, verdict: str | None, *, comment: str = "", actor: str, t_ns: int
    ) -> StoredInspection:
        mine = _COLUMN.inspection_id == inspection_id
        with self._database.writing() as connection:
            # Locked, so that who comes at the same time sees this as what was said before.
            row = connection.execute(select(INSPECTIONS).where(mine).with_for_update()).one_or_none()
            row = found(row, NoSuchInspection, inspection_id)
            if row.state == "processing":
                raise NotEnded(inspection_id)
            holds = row.verdict if decision == "confirm" else verdict
            if holds is None or (decision == "overrule" and holds == row.verdict):
                raise NothingToDecide(inspection_id, holds)
            said = {"decision": decision, "verdict": holds, "comment": comment, "actor": actor, "t_ns": t_ns}
            kept = insert(DISPOSITIONS).values(inspection_id=inspection_id, **said).returning(DISPOSITIONS)
            # As the database has it: there are texts that it does not take as they are.
            last = connection.execute(kept).one()._mapping  # pyright: ignore[reportPrivateUsage]
            after = {name: last[name] for name in _LAST_WORD}
            changed = update(INSPECTIONS).where(mine).values(disposition=after).returning(INSPECTIONS)
            before = row.disposition
            row = connection.execute(changed).one()
            write_down(
                connection,
                t_ns=t_ns,
                actor=actor,
                action="inspection.dispose",
                thing=inspection_id,
                before=before,
                after={"given": row.verdict, **after},
            )
            return made(StoredInspection, row)

    def dispositions(self, inspection_id: str, after: int | None = None, limit: int = 50) -> Page[Disposition]:
        query = select(DISPOSITIONS).where(DISPOSITIONS.c.inspection_id == inspection_id)
        with self._database.reading() as connection:
            inspection_row(connection, inspection_id)
            return page(connection, query, Disposition, after, limit)

    def inspection(self, inspection_id: str) -> StoredInspection:
        with self._database.reading() as connection:
            return made(StoredInspection, inspection_row(connection, inspection_id))

    def inspections(
        self,
        *,
        product_id: str | None = None,
        verdict: str | None = None,
        state: InspectionState | None = None,
        source: InspectionSource | None = None,
        part: str | None = None,
        after: int | None = None,
        limit: int = 50,
    ) -> Page[StoredInspection]:
        asked = {"product_id": product_id, "verdict": verdict, "state": state, "source": source}
        query = select(INSPECTIONS).where(
            *(_COLUMN[name] == value for name, value in asked.items() if value is not None)
        )
        with self._database.reading() as connection:
            if part is not None:
                query = query.where(_begins(connection, part))
            return page(connection, query, StoredInspection, after, limit)

    def scores(self, inspection_id: str) -> bytes | None:
        with self._database.reading() as connection:
            inspection_row(connection, inspection_id)
            query = select(SCORES.c.scores).where(SCORES.c.inspection_id == inspection_id)
            return connection.execute(query).scalar_one_or_none()

    def remove_scores(self, before_ns: int, limit: int, t_ns: int) -> int:
        # As the index has it, in which nothing is whose scores are gone.
        kept = (_COLUMN.result.is_not(None), _COLUMN.scores_removed_ns.is_(None))
        due = select(_COLUMN.number).where(*kept, _COLUMN.ended_ns < before_ns).order_by(_COLUMN.ended_ns).limit(limit)
        marked = update(INSPECTIONS).where(_COLUMN.number.in_(due)).values(scores_removed_ns=t_ns)
        with self._database.writing() as connection:
            gone = connection.execute(marked.returning(_COLUMN.inspection_id)).scalars().all()
            connection.execute(delete(SCORES).where(SCORES.c.inspection_id.in_(gone)))
            return len(gone)

    def abort_processing(self, t_ns: int, why: str) -> tuple[str, ...]:
        statement = (
            update(INSPECTIONS)
            .where(_COLUMN.state == "processing")
            .values(state="aborted", ended_ns=t_ns, reason=why)
            .returning(_COLUMN.inspection_id)
        )
        with self._database.writing() as connection:
            aborted = sorted(connection.execute(statement).scalars())
            forget_checkpoints(connection, aborted)
            return tuple(aborted)

    def set_recording(
        self, inspection_id: str, recording: RecordingState, bytes: int = 0, note: str | None = None
    ) -> StoredInspection:
        statement = (
            update(INSPECTIONS)
            .where(_COLUMN.inspection_id == inspection_id)
            .values(recording=recording, recording_bytes=bytes, recording_note=note)
            .returning(INSPECTIONS)
        )
        with self._database.writing() as connection:
            row = connection.execute(statement).one_or_none()
            return made(StoredInspection, found(row, NoSuchInspection, inspection_id))

    def recordings(
        self, recording: RecordingState = "kept", after: int | None = None, limit: int | None = None
    ) -> tuple[StoredRecording, ...]:
        size = _COLUMN.recording_bytes.label("bytes")
        query = select(*(size if name == "bytes" else _COLUMN[name] for name in names(StoredRecording)))
        query = query.where(_COLUMN.recording == recording).order_by(_COLUMN.number).limit(limit)
        if after is not None:
            query = query.where(_COLUMN.number > after)
        with self._database.reading() as connection:
            return tuple(made(StoredRecording, row) for row in connection.execute(query))


def _begins(connection: Connection, part: str) -> ColumnElement[bool]:
    """By the index or by looking at each: planners know too little of how texts begin to choose."""
    among = INSPECTIONS.alias()
    # By bytes, as both indexes are. LIKE would not tell the same letters apart in every database.
    first, beyond = (">=", "<") if connection.dialect.name == "sqlite" else ("~>=~", "~<~")
    alike = (among.c.part_id.bool_op(first)(part), among.c.part_id.bool_op(beyond)(part + chr(0x10FFFF)))
    few = select(among.c.number).where(*alike).limit(_FEW + 1)
    if connection.execute(select(func.count()).select_from(few.subquery())).scalar_one() <= _FEW:
        return _COLUMN.number.in_(few)
    return func.substr(_COLUMN.part_id, 1, len(part)) == part
