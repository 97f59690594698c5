"""Which part lies under the camera, where it is not the one that was meant: asked of the recipes that are active."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from contextlib import suppress

from inspector.objects import ObjectError
from inspector.service.desk import Desk
from inspector.service.files import Files
from inspector.service.recipes import active_recipes
from inspector.stores.base import AbstractStore
from inspector.stores.records import Json


class Recognising:
    """At a desk of its own, so that it does not wait for what takes minutes. Everything here blocks."""

    def __init__(self, store: AbstractStore, files: Files, desk: Desk) -> None:
        self._store, self._files, self._desk = store, files, desk

    def others(self, product_id: str, appearance_id: str, *, far: bool = False) -> dict[str, str]:
        """Files of the appearances that other products' active recipes have, by product.

        Those of this computer; or, for whoever is `far`, those that every service has.
        """
        found: dict[str, str] = {}
        for recipe in active_recipes(self._store):
            if recipe.product_id != product_id and recipe.appearance_id != appearance_id:
                # One that cannot be had names no part, and that is all.
                with suppress(ObjectError):
                    found[recipe.product_id] = self._file(recipe.appearance_id, far)
        return found

    def _file(self, appearance_id: str, far: bool) -> str:
        if far:
            return self._files.place("appearance", appearance_id)
        return str(self._files.local_appearance(appearance_id))

    def recognise(self, product_id: str, appearance_id: str, pictures: Sequence[bytes]) -> Json | None:
        """What pictures from the beginning of a sweep show, that are not of the part as it was learnt.

        By the names of `recognised` of a result, and its `sentence`. Raises WorkFailed, WorkerDied, DeskClosed.
        """
        asked = {
            "own": str(self._files.local_appearance(appearance_id)),
            "others": self.others(product_id, appearance_id),
            "pictures": [b64encode(picture).decode() for picture in pictures],
        }
        return self._desk.do("recognise", asked)["recognised"]

    def prepare(self) -> None:
        """Have the appearances of active recipes at hand, where there are several. Raises as `recognise`."""
        if len(others := self.others("", "")) > 1:
            self._desk.do("recognise", {"own": next(iter(others.values())), "others": others, "pictures": []})
