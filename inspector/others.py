"""Appearances of other recipes by the names of their parts, ready to be asked which of them lies there."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from functools import partial

from inspector.learner import load_appearance
from inspector.locations import Location
from inspector.objects import ObjectError
from models.appearance import Appearance
from models.errors import AppearanceError
from models.recognition import Card, Other

_HELD = 4
"""Appearances that stay loaded. Of all the others only their cards are held, a megabyte each as a rule."""


class Others:
    """Reads appearances as they are asked for."""

    def __init__(self) -> None:
        self._cards: dict[Location, Card] = {}
        self._loaded: OrderedDict[Location, Appearance] = OrderedDict()

    def of(self, parts: Mapping[str, Location]) -> list[Other]:
        """Those in these files, by the names of their parts; no cards are kept but these. Raises AppearanceError."""
        self._cards = {path: self._card(path) for path in parts.values()}
        return [Other(name, self._cards[path], partial(self.load, path)) for name, path in sorted(parts.items())]

    def readable(self, parts: Mapping[str, Location]) -> list[Other]:
        """The same without files that cannot be read: they name no part, and that is all."""
        return self.of({name: path for name, path in parts.items() if self._can_be_read(path)})

    def _can_be_read(self, path: Location) -> bool:
        try:
            self._cards[path] = self._card(path)
        except (AppearanceError, ObjectError):
            return False
        return True

    def load(self, path: Location) -> Appearance:
        """The appearance in a file, from memory where it was asked for of late. Raises AppearanceError, ObjectError."""
        if path not in self._loaded:
            self._loaded[path] = load_appearance(path)
        self._loaded.move_to_end(path)
        while len(self._loaded) > _HELD:
            self._loaded.popitem(last=False)
        return self._loaded[path]

    def _card(self, path: Location) -> Card:
        return self._cards[path] if path in self._cards else Card.of(self.load(path))
