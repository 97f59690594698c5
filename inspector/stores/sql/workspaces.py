"""Workspaces: what was learnt of where objects are."""

from __future__ import annotations

from dataclasses import asdict

from sqlalchemy import select

from inspector.stores.errors import NoSuchWorkspace
from inspector.stores.records import Page, StoredWorkspace
from inspector.stores.sql.database import found, insert_absent, made, page
from inspector.stores.sql.room import Room, row_by
from inspector.stores.sql.tables import WORKSPACES


class Workspaces(Room):
    """Workspaces."""

    def add_workspace(self, workspace: StoredWorkspace) -> StoredWorkspace:
        with self._database.writing() as connection:
            insert_absent(connection, WORKSPACES, asdict(workspace))
            row = row_by(connection, WORKSPACES, "workspace_id", workspace.workspace_id)
            return made(StoredWorkspace, found(row, NoSuchWorkspace, workspace.workspace_id))

    def workspace(self, workspace_id: str) -> StoredWorkspace:
        with self._database.reading() as connection:
            row = row_by(connection, WORKSPACES, "workspace_id", workspace_id)
            return made(StoredWorkspace, found(row, NoSuchWorkspace, workspace_id))

    def workspaces(self, after: int | None = None, limit: int = 50) -> Page[StoredWorkspace]:
        with self._database.reading() as connection:
            return page(connection, select(WORKSPACES), StoredWorkspace, after, limit)
