"""How parts of a product came out over time: for control charts, drift along the sweep, and what people said."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from math import ceil

from inspector.service.desk import Desk
from inspector.stores.base import AbstractStore
from inspector.stores.records import Json, StoredInspection

JUDGED = ("OK", "NG", "REVIEW")
"""Verdicts on parts; the others tell of sweeps."""
_GROUPS, _FEWEST = 40, 10
"""About so many groups, and so many parts in each at the least."""
_PAGE = 200


class Trends:
    """Reads what is stored of live inspections. Everything here blocks."""

    def __init__(self, store: AbstractStore, desk: Desk) -> None:
        self._store, self._desk = store, desk

    def of(self, product_id: str, last: int, group: int | None) -> Json:
        """Of the latest inspections that gave a verdict on a part, oldest first. Raises NoSuchProduct, WorkFailed."""
        self._store.product(product_id)
        found = list(self._latest(product_id, last))[::-1]
        parts = [each for each in found if each.verdict in JUDGED]
        return {
            "parts": len(parts),
            "verdicts": dict(Counter(each.verdict for each in found)),
            "groups": [_group(some) for some in _grouped(parts, group)],
            "drift": self._drift(parts),
            "people": _people(parts),
        }

    def _latest(self, product_id: str, last: int) -> Iterator[StoredInspection]:
        after: int | None = None
        while last > 0:
            page = self._store.inspections(
                product_id=product_id, state="completed", source="live", after=after, limit=min(last, _PAGE)
            )  # fmt: skip
            yield from page.items
            last, after = last - len(page.items), page.next
            if after is None:
                return

    def _drift(self, parts: Sequence[StoredInspection]) -> Json | None:
        # By another recipe scores have other units: its first part would look like a drift.
        recipe_id = parts[-1].recipe_id if parts else None
        known = [each for each in parts if each.recipe_id == recipe_id and (each.result or {}).get("profile")]
        if not known:
            return None
        profiles = [(each.result or {})["profile"] for each in known]
        made = self._desk.do("drift", {"profiles": profiles}, lambda share: None)
        for change in made["changes"]:
            since = int(change.pop("since"))
            change |= {"since_ns": known[since].ended_ns, "inspection_id": known[since].inspection_id}
        return made


def _grouped(parts: Sequence[StoredInspection], size: int | None) -> Iterator[Sequence[StoredInspection]]:
    """Groups of one size; where it does not divide, the oldest has fewer."""
    if size is None:
        size = max(_FEWEST, ceil(len(parts) / _GROUPS))
    first = len(parts) % size
    if first:
        yield parts[:first]
    for at in range(first, len(parts), size):
        yield parts[at : at + size]


def _group(parts: Sequence[StoredInspection]) -> Json:
    return {
        "start_ns": parts[0].ended_ns,
        "end_ns": parts[-1].ended_ns,
        "parts": len(parts),
        "rejected": sum(each.verdict == "NG" for each in parts),
        "review": sum(each.verdict == "REVIEW" for each in parts),
    }


def _people(parts: Sequence[StoredInspection]) -> Json:
    """By the latest disposition of each part; what nobody looked at is not known."""
    looked = [(each.verdict, each.disposition) for each in parts if each.disposition is not None]
    said = Counter((verdict, disposition["verdict"]) for verdict, disposition in looked)
    by = Counter(verdict for verdict, _ in looked)
    return {
        "looked_at_ok": by["OK"],
        "looked_at_rejected": by["NG"],
        "looked_at_review": by["REVIEW"],
        "escapes": said["OK", "NG"],
        "false_rejects": said["NG", "OK"],
        "confirmed": sum(disposition["decision"] == "confirm" for _, disposition in looked),
        "undecided": len(parts) - len(looked),
    }
