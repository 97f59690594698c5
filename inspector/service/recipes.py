"""Which recipe is meant, and which are active: asked of the store. Everything here blocks."""

from __future__ import annotations

from collections.abc import Iterator

from inspector.service.errors import NoRecipe
from inspector.stores.base import AbstractStore
from inspector.stores.errors import NoSuchRecipe
from inspector.stores.records import Recipe

_MOST = 200
"""Products that are asked about: the newest."""


def recipe_of(store: AbstractStore, product_id: str, recipe_id: str | None) -> Recipe:
    """The product's recipe of that id, or its active one. Raises NoSuchProduct, NoSuchRecipe, NoRecipe."""
    recipe = store.active_recipe(product_id) if recipe_id is None else store.recipe(recipe_id)
    if recipe is None:
        raise NoRecipe(product_id)
    if recipe.product_id != product_id:
        store.product(product_id)
        raise NoSuchRecipe(recipe.recipe_id)
    return recipe


def active_recipes(store: AbstractStore) -> Iterator[Recipe]:
    """One of each product that has one, the newest product first."""
    for product in store.products(limit=_MOST).items:
        if (recipe := store.active_recipe(product.product_id)) is not None:
            yield recipe
