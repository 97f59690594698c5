"""A golden sweep inspected with synthetic defects in it, by the one scoring path; and once without, to compare with."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from models.appearance import Appearance
from models.defects import Defect, draw
from models.frame import Frame
from models.inspection import Inspection, begin, step
from models.registration import shrink_by
from models.sites import Site, way
from models.verdict import FrameState, Policy, Region, ScoredFrame

_SAVED_BYTES = 128 * 2**20
"""Of states of the inspection without defects, from which the others go on."""
_SLACK = 8
"""Pixels, in pictures 320 wide, by which the middle of a region may miss the defect that it is caused by."""
_BLANKET = 9
"""A region so many times larger than the defect with its slack says nothing of it."""
_ASTRAY = 1.0
"""Places by which a defect may move the place of a frame before that is counted."""


class ReferenceSweep:
    """The appearance's own reference pictures as a sweep: free of noise, and only of the places that have one."""

    def __init__(self, appearance: Appearance) -> None:
        self._appearance = appearance

    def __iter__(self) -> Iterator[Frame]:
        deep = "16 bit" in self._appearance.references.kind
        for place in (int(key) for key in self._appearance.keys):
            picture = self._appearance.references.get(place).picture
            pixels = np.clip(picture * 257 + 0.5, 0, 65535).astype(np.uint16) if deep else picture
            yield Frame(pixels, place * self._appearance.interval_ns, place)


@dataclass(frozen=True)
class Planted:
    """A defect on the part."""

    site: Site
    defect: Defect


@dataclass(eq=False)
class _Trial:
    """One planted defect on its way through the sweep."""

    planted: Planted
    points: Float[np.ndarray, "n 2"]
    """Where it lies in each frame."""
    start: int
    """It is in view at some of the frames start <= index < end."""
    end: int
    caught: bool = False


@dataclass(eq=False)
class Rehearsal:
    """A sweep of a good part as it was inspected without defects: where each frame lies, and what was found anyway."""

    appearance: Appearance
    sweep: Iterable[Frame]
    """Read once for each attempt."""
    scored: tuple[ScoredFrame, ...]
    saved: tuple[Inspection, ...]
    """The state before every `every`-th frame."""
    every: int
    blur: float
    """Of the lens, in pixels."""
    seen: int = 0
    """Frames with defects that were scored so far."""
    astray: int = 0
    """Those of them that were placed elsewhere than without defects."""
    _places: Int[np.ndarray, " n"] = field(init=False)
    _maps: Float[np.ndarray, "n 2 3"] = field(init=False)
    _way: Float[np.ndarray, "n 2"] = field(init=False)

    def __post_init__(self) -> None:
        placed = [f.reference if f.state is FrameState.SCORED else -1 for f in self.scored]
        self._places = np.array(placed, int)
        none = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
        self._maps = np.array([f.placement or none for f in self.scored], float).reshape(-1, 2, 3)
        self._way = way(self.appearance)

    @classmethod
    def of(cls, appearance: Appearance, policy: Policy, sweep: Iterable[Frame], blur: float) -> Rehearsal:
        """Inspect a sweep; `sweep` is read again for each attempt. Raises PictureError for pictures of another kind."""
        rows, cols = (-(-side // appearance.references.cell) for side in appearance.size)
        # five sights of two float32 a cell; one frame shares four of them with the one before it
        most = max(8, _SAVED_BYTES // (5 * rows * cols * 2 * 4))
        every, saved, state = 1, list[Inspection](), begin(appearance, policy)
        for index, frame in enumerate(sweep):
            if index % every == 0:
                saved.append(state)
            if len(saved) > most:
                every, saved = 2 * every, saved[::2]
            state, _ = step(state, frame)
        return cls(appearance, sweep, state.frames, tuple(saved), every, blur)

    def attempt(self, planted: Sequence[Planted]) -> tuple[bool, ...]:
        """Whether each defect is caught, all of them put on the part at once: keep them well apart.

        A defect stays until it is caught, or out of view. Frames without one are not inspected again: the inspection
        goes on from where it stood without defects.
        """
        trials = [self._trial(each) for each in planted]
        coming = sorted(trials, key=lambda trial: trial.start, reverse=True)
        here: list[_Trial] = []
        state: Inspection | None = None
        for index, frame in enumerate(self.sweep):
            while coming and coming[-1].start <= index:
                here.append(coming.pop())
            here = [trial for trial in here if not trial.caught and trial.end > index]
            if not here and not coming:
                break
            if not here and index < coming[-1].start // self.every * self.every:
                state = None
                continue
            state = self._step(self.saved[index // self.every] if state is None else state, index, frame, here)
        return tuple(trial.caught for trial in trials)

    def _trial(self, planted: Planted) -> _Trial:
        site = planted.site
        at = np.array([site.x, site.y]) + self._way[self._places] - self._way[site.place]
        points = np.einsum("nij,nj->ni", self._maps, np.column_stack([at, np.ones(len(at))]))
        w, h = self.appearance.size
        inside = (points > -0.5).all(axis=1) & (points < np.array([w, h]) - 0.5).all(axis=1)
        inside &= (self._places >= site.first) & (self._places < site.last)
        points[~inside] = np.nan
        shown = np.flatnonzero(inside)
        return _Trial(planted, points, int(shown[0]) if len(shown) else 0, int(shown[-1]) + 1 if len(shown) else 0)

    def _step(self, state: Inspection, index: int, frame: Frame, here: Sequence[_Trial]) -> Inspection:
        shown = [trial for trial in here if not np.isnan(trial.points[index, 0])]
        if shown:
            pixels = frame.pixels.copy()
            for trial in shown:
                x, y = trial.points[index]
                draw(pixels, float(x), float(y), trial.planted.defect, self.blur)
            frame = Frame(pixels, frame.t_ns, frame.sequence, frame.encoder)
        state, scored = step(state, frame)
        before = self.scored[index]
        if shown and scored.s is not None and before.s is not None:
            self.seen += 1
            self.astray += abs(scored.s - before.s) * (self.appearance.places - 1) > _ASTRAY
        for trial in shown:
            trial.caught = self._hits(scored.regions, trial, index) and not self._hits(before.regions, trial, index)
        return state

    def _hits(self, regions: Sequence[Region], trial: _Trial, index: int) -> bool:
        """Whether a region that is over the threshold lies on the defect, and is not much larger."""
        slack = _SLACK * shrink_by(self.appearance.size)
        point = trial.points[index]
        half = np.array(trial.planted.defect.extent(self.appearance.size[0])) + slack
        return any(
            abs(region.x + region.width / 2 - point[0]) <= half[0]
            and abs(region.y + region.height / 2 - point[1]) <= half[1]
            and region.width * region.height <= _BLANKET * 4 * half[0] * half[1]
            for region in regions
        )
