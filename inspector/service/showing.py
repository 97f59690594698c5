"""A recorded frame as pictures: as it was recorded, what was expected there, laid on that, what is out of tolerance."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from math import isfinite

import numpy as np

from inspector.drawing import heat
from inspector.learner import load_appearance
from inspector.locations import Location, to_location
from inspector.picture_headers import kind_of
from inspector.pictures import decode, encode_jpeg, encode_png
from inspector.recording import SweepReader
from models.appearance import Appearance
from models.frame import EncodedPicture, Frame
from models.inspection import Explanation, explain, out_of_tolerance
from models.sampling import sampling
from models.spread import ALL, unpack_cells
from models.verdict import Policy, ScoredFrame

_HELD_BYTES = 64 << 20
_OPEN = 4
"""Recordings that are read on from where they were left."""
SHOWN = ("jpeg", "png", "webp", "bmp")
"""Kinds of pictures that browsers show."""


@dataclass(frozen=True)
class Kept:
    """A frame of a recording, with its picture as it was recorded, or without loss."""

    t_ns: int
    sequence: int
    picture: EncodedPicture


class Shelf:
    """Frames of the recordings that were looked at last, up to so many bytes of encoded pictures.

    Recordings are read from their beginning, and on from where they were left: going forward costs a frame each.
    """

    def __init__(self, most_bytes: int = _HELD_BYTES) -> None:
        self._most, self._bytes = most_bytes, 0
        self._kept: OrderedDict[tuple[Location, int], Kept] = OrderedDict()
        self._passes: OrderedDict[Location, Iterator[tuple[int, Frame]]] = OrderedDict()
        self._reached: dict[Location, int] = {}
        """The next index of each pass."""

    def frame(self, path: Location, index: int) -> Kept | None:
        """The frame that is so manieth in the recording, counted from 0; None where it has no such. RecordingError."""
        if (path, index) in self._kept:
            self._kept.move_to_end((path, index))
            return self._kept[path, index]
        for at, frame in self._pass(path, index):
            self._reached[path] = at + 1
            kept = Kept(frame.t_ns, frame.sequence, frame.encoded or encode_png(frame.pixels))
            self._keep((path, at), kept)
            if at == index:
                return kept
        return None

    def _pass(self, path: Location, index: int) -> Iterator[tuple[int, Frame]]:
        if path not in self._passes or index < self._reached[path]:
            self._passes[path], self._reached[path] = enumerate(SweepReader(path)), 0
        self._passes.move_to_end(path)
        while len(self._passes) > _OPEN:
            del self._reached[self._passes.popitem(last=False)[0]]
        return self._passes[path]

    def _keep(self, key: tuple[Location, int], kept: Kept) -> None:
        if key not in self._kept:
            self._bytes += len(kept.picture.data)
        self._kept[key] = kept
        while self._bytes > self._most and len(self._kept) > 1:
            self._bytes -= len(self._kept.popitem(last=False)[1].picture.data)


_shelf = Shelf()


def picture(
    *, recording: str, index: int, kind: str, appearance: str, policy: Policy, scored: ScoredFrame | None
) -> EncodedPicture | str:
    """Of the frame that is so manieth in the recording; `scored` says how it was compared, as far as that is known.

    A sentence where there is no such picture. Raises RecordingError, AppearanceError.
    """
    kept = _shelf.frame(to_location(recording), index)
    if kept is None or (scored is not None and scored.t_ns != kept.t_ns):
        return "the recording does not have it, or has lost frames"
    if kind == "frame":
        return _as_recorded(kept)
    explanation = scored and _explained(appearance, kept, scored)
    if scored is None or explanation is None:
        return f"it was not compared with what is expected: it is {scored.state.value if scored else 'not scored'}"
    if kind == "difference":
        return encode_png(heat(out_of_tolerance(load_cached(appearance), policy, scored, explanation)))
    return encode_jpeg(explanation.expected if kind == "expected" else explanation.seen)


def sampling_of(appearance: str) -> dict[str, object]:
    """How densely the reference sweep shows the part, as JSON; infinite is null."""
    learnt = load_cached(appearance)
    found = sampling(learnt)
    return {
        "s": _numbers(found.s),
        "pixels_per_frame": _numbers(found.pixels),
        "frames_per_spot": _numbers(found.shown),
        "curve_per_frame": _numbers(found.curve),
        "reference_s": _numbers(learnt.s[learnt.keys]),
        "moves": learnt.shifts,
        "width": learnt.size[0],
        "height": learnt.size[1],
        "interval_ns": learnt.interval_ns,
        "advice": [asdict(each) for each in found.advice],
    }


def _numbers(values: np.ndarray) -> list[float | None]:
    return [round(value, 6) if isfinite(value) else None for value in values.astype(float).tolist()]


def reference(appearance: str, s: float) -> tuple[EncodedPicture, int, float]:
    """The reference picture that shows most of what is seen at s, with its place and its own s."""
    learnt = load_cached(appearance)
    place = learnt.key_at(s)
    data = learnt.pictures[int(np.searchsorted(learnt.keys, place))]
    return EncodedPicture(kind_of(data) or "jpeg", data), place, float(learnt.s[place])


def ignored(appearance: str, s: float) -> EncodedPicture:
    """What was learnt not to be looked at, on the reference picture there, as a PNG of its size.

    255 fixed in the picture, byte for byte as the mask that was given; 128 excused on the part; 0 elsewhere.
    """
    learnt = load_cached(appearance)
    width, height = learnt.size
    shown = np.zeros((height, width), np.uint8)
    tolerance = learnt.tolerance[int(np.searchsorted(learnt.keys, learnt.key_at(s)))]
    if tolerance:
        excused = np.all(unpack_cells(tolerance, learnt.references.cells) >= ALL, axis=2)
        cell = learnt.references.cell
        shown[np.kron(excused, np.ones((cell, cell), bool))[:height, :width]] = 128
    if (mask := learnt.preparation.ignore) is not None:
        shown[mask] = 255
    return encode_png(shown)


def _as_recorded(kept: Kept) -> EncodedPicture:
    """Byte for byte where browsers show it, else without loss."""
    kind = kind_of(kept.picture.data)
    return EncodedPicture(kind, kept.picture.data) if kind in SHOWN else encode_png(decode(kept.picture))


@lru_cache(maxsize=2)
def _explained(appearance: str, kept: Kept, scored: ScoredFrame) -> Explanation | None:
    """Of a frame; kept for the next picture of it."""
    frame = Frame(decode(kept.picture), kept.t_ns, kept.sequence, None, kept.picture)
    return explain(load_cached(appearance), frame, scored)


@lru_cache(2)
def load_cached(path: str) -> Appearance:
    """An appearance, kept for the next time: files of appearances never change."""
    return load_appearance(path)
