"""Recipes: numbered versions, one of them active, each edit in the audit trail."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, Row, func, select, update

from inspector.stores.errors import NoSuchRecipe
from inspector.stores.records import Json, Page, Recipe
from inspector.stores.sql.database import found, insert_new, made, page
from inspector.stores.sql.products import appearance_of
from inspector.stores.sql.room import Room, product_row, row_by, write_down
from inspector.stores.sql.tables import RECIPES

TOLD = ("recipe_id", "product_id", "version", "appearance_id", "policy", "active", "note")
"""What the audit trail says of a recipe."""


class Recipes(Room):
    """Recipes."""

    def add_recipe(
        self,
        recipe_id: str,
        product_id: str,
        appearance_id: str,
        policy: Json,
        *,
        note: str = "",
        activate: bool = True,
        actor: str,
        t_ns: int,
    ) -> Recipe:
        with self._database.writing() as connection:
            product_row(connection, product_id, lock=True)
            appearance_of(connection, product_id, appearance_id)
            before = _active(connection, product_id)
            if activate:
                _deactivate(connection, product_id)
            latest = select(func.max(RECIPES.c.version)).where(RECIPES.c.product_id == product_id)
            values = {
                "recipe_id": recipe_id,
                "product_id": product_id,
                "version": (connection.execute(latest).scalar() or 0) + 1,
                "appearance_id": appearance_id,
                "policy": policy,
                "active": activate,
                "created_ns": t_ns,
                "created_by": actor,
                "note": note,
            }
            after = insert_new(connection, RECIPES, "recipe", recipe_id, values)
            _write_down(connection, "recipe.add", before, after, actor=actor, t_ns=t_ns)
            return made(Recipe, after)

    def activate_recipe(self, product_id: str, recipe_id: str, *, actor: str, t_ns: int) -> Recipe:
        with self._database.writing() as connection:
            product_row(connection, product_id, lock=True)
            mine = (RECIPES.c.recipe_id == recipe_id, RECIPES.c.product_id == product_id)
            row = found(connection.execute(select(RECIPES).where(*mine)).one_or_none(), NoSuchRecipe, recipe_id)
            if row.active:
                return made(Recipe, row)
            before = _active(connection, product_id)
            _deactivate(connection, product_id)
            after = connection.execute(update(RECIPES).where(*mine).values(active=True).returning(RECIPES)).one()
            _write_down(connection, "recipe.activate", before, after, actor=actor, t_ns=t_ns)
            return made(Recipe, after)

    def recipe(self, recipe_id: str) -> Recipe:
        with self._database.reading() as connection:
            return made(Recipe, found(row_by(connection, RECIPES, "recipe_id", recipe_id), NoSuchRecipe, recipe_id))

    def recipes(self, product_id: str, after: int | None = None, limit: int = 50) -> Page[Recipe]:
        with self._database.reading() as connection:
            product_row(connection, product_id)
            query = select(RECIPES).where(RECIPES.c.product_id == product_id)
            return page(connection, query, Recipe, after, limit)

    def active_recipe(self, product_id: str) -> Recipe | None:
        with self._database.reading() as connection:
            product_row(connection, product_id)
            row = _active(connection, product_id)
            return made(Recipe, row) if row else None


def _active(connection: Connection, product_id: str) -> Row[Any] | None:
    query = select(RECIPES).where(RECIPES.c.product_id == product_id, RECIPES.c.active)
    return connection.execute(query).one_or_none()


def _deactivate(connection: Connection, product_id: str) -> None:
    connection.execute(update(RECIPES).where(RECIPES.c.product_id == product_id, RECIPES.c.active).values(active=False))


def _write_down(
    connection: Connection, action: str, before: Row[Any] | None, after: Row[Any], *, actor: str, t_ns: int
) -> None:
    write_down(
        connection,
        t_ns=t_ns,
        actor=actor,
        action=action,
        thing=after.recipe_id,
        before=_told(before) if before else None,
        after=_told(after),
    )


def _told(row: Row[Any]) -> Json:
    return {name: row._mapping[name] for name in TOLD}  # pyright: ignore[reportPrivateUsage]
