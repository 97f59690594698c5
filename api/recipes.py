"""Recipes: an appearance and a policy, versioned; one per product is active, and every change is in the audit trail."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel, Field

from api.deps import (
    IDENTITY,
    TEXT,
    Engineer,
    Id,
    ProductId,
    ServiceDep,
    Viewer,
    WantedDep,
    in_thread,
    once,
    problems,
    tagged,
)
from api.schemas import Asked, Page
from inspector.policies import PolicyFile
from inspector.service.errors import NoRecipe
from inspector.service.folder import new_id
from inspector.service.service import Service
from inspector.stores.errors import NoSuchRecipe
from inspector.stores.records import Recipe
from models.verdict import Policy

router = APIRouter(prefix="/v1/products/{product_id}/recipes", tags=["recipes"])


class NewRecipe(Asked):
    """A new version. An edit of a policy is one, too."""

    appearance_id: Annotated[str | None, Field(pattern=IDENTITY)] = None
    """None for that of the active recipe."""
    policy: PolicyFile = PolicyFile()
    """What is left out is as usual."""
    activate: bool = True
    """Inspect by it from now on. Inspections that run end as they began."""
    note: Annotated[str, Field(max_length=500, pattern=TEXT)] = ""
    """Why, for who reads it later."""


class RecipeOut(BaseModel):
    """A version of a recipe; it never changes, but for being active."""

    recipe_id: str
    product_id: str
    version: int
    """Counts the product's recipes from 1."""
    appearance_id: str
    policy: dict[str, float]
    active: bool
    created_ns: int
    created_by: str
    note: str


class RecipePage(Page[RecipeOut]):
    """Some of them, newest first."""


@router.post("", status_code=201, response_model=RecipeOut, responses=problems(404, 409))
async def add(
    request: Request, product_id: ProductId, asked: NewRecipe, service: ServiceDep, who: Engineer
) -> Response:
    """A new version of the recipe, active unless asked otherwise."""
    policy = Policy(**asked.policy.model_dump())

    async def do() -> tuple[int, BaseModel]:
        recipe = await in_thread(_add, service, product_id, asked, policy, who.actor)
        _announce(service, recipe)
        return 201, recipe_out(recipe)

    return await once(request, service, who, do)


@router.get("", response_model=RecipePage, responses=problems(404))
async def recipes(
    request: Request, product_id: ProductId, service: ServiceDep, who: Viewer, wanted: WantedDep
) -> Response:
    """All versions of a product's recipe."""
    page = await in_thread(service.store.recipes, product_id, *wanted)
    return tagged(request, RecipePage.of(page, recipe_out))


@router.get("/{recipe_id}", response_model=RecipeOut, responses=problems(404))
async def recipe(request: Request, product_id: ProductId, recipe_id: Id, service: ServiceDep, who: Viewer) -> Response:
    """One version."""
    found = await in_thread(service.store.recipe, recipe_id)
    if found.product_id != product_id:
        raise NoSuchRecipe(recipe_id)
    return tagged(request, recipe_out(found))


@router.post("/{recipe_id}/activate", response_model=RecipeOut, responses=problems(404))
async def activate(product_id: ProductId, recipe_id: Id, service: ServiceDep, who: Engineer) -> RecipeOut:
    """Inspect by this version from now on."""
    recipe = await in_thread(
        service.store.activate_recipe, product_id, recipe_id, actor=who.actor, t_ns=service.now_ns()
    )
    _announce(service, recipe)
    return recipe_out(recipe)


def _add(service: Service, product_id: str, asked: NewRecipe, policy: Policy, actor: str) -> Recipe:
    appearance_id = asked.appearance_id
    if appearance_id is None:
        active = service.store.active_recipe(product_id)
        if active is None:
            raise NoRecipe(product_id)
        appearance_id = active.appearance_id
    return service.store.add_recipe(
        new_id(),
        product_id,
        appearance_id,
        asdict(policy),
        note=asked.note,
        activate=asked.activate,
        actor=actor,
        t_ns=service.now_ns(),
    )


def _announce(service: Service, recipe: Recipe) -> None:
    if recipe.active:
        service.inspections.load(recipe.appearance_id)
        names = {"recipe_id": recipe.recipe_id, "product_id": recipe.product_id, "version": recipe.version}
        service.events.publish("recipe", **names)


def recipe_out(recipe: Recipe) -> RecipeOut:
    """As it goes over the wire."""
    return RecipeOut(**asdict(recipe))
