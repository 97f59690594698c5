"""Jobs: long work, and how far it is."""

from __future__ import annotations

from sqlalchemy import select, update

from inspector.stores.errors import JobEnded, NoSuchJob
from inspector.stores.records import Job, JobKind, JobState, Json, Page
from inspector.stores.sql.database import found, insert_new, made, page
from inspector.stores.sql.products import ensure_product
from inspector.stores.sql.room import Room, row_by
from inspector.stores.sql.tables import JOBS


class Jobs(Room):
    """Jobs."""

    def add_job(
        self, job_id: str, kind: JobKind, product_id: str | None, request: Json, t_ns: int, *, node: str | None = None
    ) -> Job:
        values = {
            "job_id": job_id,
            "kind": kind,
            "product_id": product_id,
            "state": "running",
            "progress": 0.0,
            "created_ns": t_ns,
            "request": request,
            "node": node,
        }
        with self._database.writing() as connection:
            if product_id is not None:
                ensure_product(connection, product_id, t_ns)
            return made(Job, insert_new(connection, JOBS, "job", job_id, values))

    def update_job(
        self,
        job_id: str,
        *,
        progress: float | None = None,
        state: JobState | None = None,
        ended_ns: int | None = None,
        outcome: Json | None = None,
        error: str | None = None,
    ) -> Job:
        given = {"progress": progress, "state": state, "ended_ns": ended_ns, "outcome": outcome, "error": error}
        values = {name: value for name, value in given.items() if value is not None}
        with self._database.writing() as connection:
            running = select(JOBS).where(JOBS.c.job_id == job_id).with_for_update()
            before = found(connection.execute(running).one_or_none(), NoSuchJob, job_id)
            if before.state != "running":
                raise JobEnded(job_id, before.state)
            statement = update(JOBS).where(JOBS.c.job_id == job_id).values(values or {"progress": before.progress})
            return made(Job, connection.execute(statement.returning(JOBS)).one())

    def job(self, job_id: str) -> Job:
        with self._database.reading() as connection:
            return made(Job, found(row_by(connection, JOBS, "job_id", job_id), NoSuchJob, job_id))

    def jobs(
        self,
        *,
        product_id: str | None = None,
        state: JobState | None = None,
        after: int | None = None,
        limit: int = 50,
    ) -> Page[Job]:
        query = select(JOBS)
        if product_id is not None:
            query = query.where(JOBS.c.product_id == product_id)
        if state is not None:
            query = query.where(JOBS.c.state == state)
        with self._database.reading() as connection:
            return page(connection, query, Job, after, limit)

    def fail_running_jobs(self, t_ns: int, why: str) -> tuple[str, ...]:
        statement = (
            update(JOBS)
            .where(JOBS.c.state == "running")
            .values(state="failed", ended_ns=t_ns, error=why)
            .returning(JOBS.c.job_id)
        )
        with self._database.writing() as connection:
            return tuple(sorted(connection.execute(statement).scalars()))
