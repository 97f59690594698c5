"""Pictures of recorded frames, and what was said of them: for whoever looks at an inspection that has ended.

inspector.errors.WorldError
└── NoSuchPicture            a frame, or a picture of it, that there is not
"""

from __future__ import annotations

import threading
from base64 import b64decode, b64encode
from collections import OrderedDict
from dataclasses import dataclass

from inspector.errors import WorldError
from inspector.locations import shown_place
from inspector.scores_json import scores_from_bytes, scores_to_bytes
from inspector.service.desk import Desk, WorkFailed, naming
from inspector.service.errors import NotConcluded, RecordingGone
from inspector.service.files import Files
from inspector.service.scored import kept_scores
from inspector.stores.base import AbstractStore
from inspector.stores.records import Json, StoredInspection
from models.frame import EncodedPicture
from models.verdict import ScoredFrame

_HELD_BYTES = 32 << 20
"""Of pictures that were told, for who else looks at the same frame."""
_SCORED = 4
"""Inspections whose scores stay at hand."""
Key = tuple[str, int, str]


class NoSuchPicture(WorldError):
    """A frame, or a picture of it, that there is not."""

    def __init__(self, inspection_id: str, index: int, kind: str | None, why: str) -> None:
        what = f"picture {kind!r} of " if kind else ""
        super().__init__(f"there is no {what}frame {index} of inspection {inspection_id!r}: {why}")


@dataclass(frozen=True)
class Reference:
    """What is expected somewhere."""

    picture: EncodedPicture
    place: int
    """Of the reference sweep, counted from 0."""
    s: float
    """Of that place."""


class Pictures:
    """Looks recorded frames up. Everything here blocks."""

    def __init__(self, store: AbstractStore, files: Files, desk: Desk) -> None:
        self._store, self._files, self._desk = store, files, desk
        self._lock = threading.Lock()
        self._told: OrderedDict[Key, EncodedPicture] = OrderedDict()
        self._scores: OrderedDict[str, tuple[ScoredFrame, ...]] = OrderedDict()

    def frame(self, inspection_id: str, index: int) -> ScoredFrame:
        """What was said of a frame. Raises NoSuchInspection, NotConcluded, ScoresGone, NoSuchPicture."""
        scored = self._frame(self._ended(inspection_id), index)
        if scored is None:
            raise NoSuchPicture(inspection_id, index, None, "the inspection has no scores")
        return scored

    def picture(self, inspection_id: str, index: int, kind: str) -> EncodedPicture:
        """`frame`, `expected`, `seen` or `difference`.

        Raises NoSuchInspection, NotConcluded, RecordingGone, ScoresGone, NoSuchPicture, WorkFailed.
        """
        key = inspection_id, index, kind
        with self._lock:
            if (known := self._told.get(key)) is not None:
                self._told.move_to_end(key)
                return known
        stored = self._ended(inspection_id)
        waited = self._files.waiting(inspection_id) is not None
        try:
            made = self._look(stored, index, kind)
        except WorkFailed:
            if not waited:
                raise
            # It may have been brought to where it is kept meanwhile.
            made = self._look(self._ended(inspection_id), index, kind)
        if "missing" in made:
            raise NoSuchPicture(inspection_id, index, kind, made["missing"])
        picture = EncodedPicture(made["format"], b64decode(made["data"]))
        self._keep(key, picture)
        return picture

    def _look(self, stored: StoredInspection, index: int, kind: str) -> Json:
        # What was recorded can be shown without its score; how it was compared cannot.
        as_recorded = kind == "frame" and stored.scores == "removed"
        scored, (recording, thing) = None if as_recorded else self._frame(stored, index), self._recording(stored)
        appearance = self._files.local_appearance(stored.appearance_id)
        asked = {
            "recording": recording,
            "index": index,
            "kind": kind,
            "appearance": str(appearance),
            "policy": stored.policy,
            "scored": b64encode(scores_to_bytes([scored])).decode() if scored is not None else None,
        }
        with naming({shown_place(recording): f"the recording of {thing}", str(appearance): "the appearance"}):
            return self._desk.do("picture", asked)

    def sampling(self, product_id: str, appearance_id: str) -> Json:
        """How densely the reference sweep of an appearance shows the part. Raises NoSuchAppearance, WorkFailed."""
        return self._of_appearance("sampling", product_id, appearance_id)

    def reference(self, product_id: str, appearance_id: str, s: float) -> Reference:
        """The reference picture that is nearest to s. Raises NoSuchAppearance, WorkFailed."""
        made = self._of_appearance("reference", product_id, appearance_id, s=s)
        return Reference(EncodedPicture(made["format"], b64decode(made["data"])), made["place"], made["s"])

    def ignored(self, product_id: str, appearance_id: str, s: float) -> EncodedPicture:
        """What is not looked at, on the reference picture nearest to s. Raises NoSuchAppearance, WorkFailed."""
        made = self._of_appearance("ignored", product_id, appearance_id, s=s)
        return EncodedPicture(made["format"], b64decode(made["data"]))

    def _of_appearance(self, task: str, product_id: str, appearance_id: str, **more: object) -> Json:
        self._store.appearance(product_id, appearance_id)
        path = str(self._files.local_appearance(appearance_id))
        with naming({path: f"appearance {appearance_id}"}):
            return self._desk.do(task, {"appearance": path, **more})

    def _ended(self, inspection_id: str) -> StoredInspection:
        stored = self._store.inspection(inspection_id)
        closed = stored.recording != "being written" or self._files.waiting(inspection_id) is not None
        if stored.state == "processing" or not closed:
            raise NotConcluded(inspection_id, "frame to look at")
        return stored

    def _frame(self, stored: StoredInspection, index: int) -> ScoredFrame | None:
        """None for all frames of an inspection that was cut off, and never had scores. Raises ScoresGone."""
        inspection_id = stored.inspection_id
        with self._lock:
            scores = self._scores.get(inspection_id)
        if scores is None:
            kept = kept_scores(self._store, stored)
            if kept is None:
                return None
            scores = scores_from_bytes(kept)
            with self._lock:
                self._scores[inspection_id] = scores
                while len(self._scores) > _SCORED:
                    self._scores.popitem(last=False)
        if index >= len(scores):
            raise NoSuchPicture(inspection_id, index, None, f"it has {len(scores)} frames, counted from 0")
        return scores[index]

    def _recording(self, stored: StoredInspection) -> tuple[str, str]:
        """Of the inspection itself, or of what it is a replay of; and in words."""
        kind, _, of = str((stored.result or {}).get("replay_of", "")).partition(" ")
        if kind == "sweep":
            if self._files.size("sweep", of) is not None:
                return self._files.place("sweep", of), f"sweep {of}"
            raise RecordingGone(stored.inspection_id, "none", f"sweep {of} is not there any more")
        source = self._store.inspection(of) if kind == "inspection" else stored
        if (waiting := self._files.waiting(source.inspection_id)) is not None:
            return str(waiting), f"inspection {source.inspection_id}"
        if source.recording == "kept" and self._files.size("inspection", source.inspection_id) is not None:
            return self._files.place("inspection", source.inspection_id), f"inspection {source.inspection_id}"
        raise RecordingGone(source.inspection_id, source.recording, source.recording_note)

    def _keep(self, key: Key, picture: EncodedPicture) -> None:
        with self._lock:
            self._told[key] = picture
            while sum(len(each.data) for each in self._told.values()) > _HELD_BYTES:
                self._told.popitem(last=False)
