"""Products: the kinds of part that are inspected here."""

from __future__ import annotations

from fastapi import APIRouter
from fastapi.requests import Request
from fastapi.responses import Response
from pydantic import BaseModel

from api.deps import ProductId, ServiceDep, Viewer, WantedDep, in_thread, problems, tagged
from api.recipes import RecipeOut, recipe_out
from api.schemas import Page
from inspector.service.service import Service
from inspector.stores.records import Product

router = APIRouter(prefix="/v1/products", tags=["products"])


class ProductOut(BaseModel):
    """A product."""

    product_id: str
    created_ns: int
    active_recipe: RecipeOut | None
    """What its parts are inspected by."""


class ProductPage(Page[ProductOut]):
    """Some of them, newest first."""


@router.get("", response_model=ProductPage)
async def products(request: Request, service: ServiceDep, who: Viewer, wanted: WantedDep) -> Response:
    """All products. One comes into being with its first sweep."""

    def read() -> ProductPage:
        return ProductPage.of(service.store.products(*wanted), lambda product: _told(service, product))

    return tagged(request, await in_thread(read))


@router.get("/{product_id}", response_model=ProductOut, responses=problems(404))
async def product(request: Request, product_id: ProductId, service: ServiceDep, who: Viewer) -> Response:
    """A product, and what its parts are inspected by."""
    return tagged(request, await in_thread(lambda: _told(service, service.store.product(product_id))))


def _told(service: Service, product: Product) -> ProductOut:
    active = service.store.active_recipe(product.product_id)
    return ProductOut(
        product_id=product.product_id,
        created_ns=product.created_ns,
        active_recipe=None if active is None else recipe_out(active),
    )
