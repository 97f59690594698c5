"""Find out what is caught: synthetic defects of all kinds put on a part, tried at one size after the other."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from models.appearance import Appearance
from models.defects import Defect, Kind, beside_edge, sharpness
from models.detectability import Detectability
from models.errors import LearningError
from models.frame import Frame
from models.registration import shrink_by
from models.rehearsal import Planted, ReferenceSweep, Rehearsal
from models.sites import Site, beside, sites, way
from models.verdict import FrameState, Policy

SIZES = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 24.0, 32.0)
"""Pixels, in pictures 320 wide; larger pictures get larger ones, too."""
CONTRASTS = (30.0, 60.0, 120.0)
"""Grey levels of 255."""
_WIDEST = 12.0
"""Of lines: in pictures 320 wide."""
SPACING, SPACING_FINE = 1 / 7, 1 / 14
"""Of the sites, as a share of the picture's width."""
_APART = 24
"""Pixels between defects that are put on the part at once, in pictures 320 wide; as much again as they are large."""
_BLURS = 9
"""Reference pictures that the lens is judged by."""
_ROOM = 0.8
"""Share of the contrast that material beside an edge must have room for."""
_START = 5.0
"""Size that is tried first."""

_Search: TypeAlias = Generator[Planted, bool, list[float]]


def probe(
    appearance: Appearance,
    policy: Policy | None = None,
    sweeps: Sequence[Iterable[Frame]] = (),
    *,
    kinds: Sequence[Kind] = tuple(Kind),
    contrasts: Sequence[float] = CONTRASTS,
    spacing: float = SPACING,
    progress: Callable[[float], None] | None = None,
) -> Detectability:
    """Put synthetic defects on the part, all along the sweep, and inspect it with them; deterministic.

    `sweeps` are recordings of good parts that the defects are put into, each read some hundred times; a defect is
    caught where it is caught in all of them. Without any, the appearance's own reference pictures serve. `progress`
    is told the share done. Raises PictureError for a sweep of other pictures, LearningError for one that fits nowhere.
    """
    blur = _lens(appearance)
    rehearsals = [
        Rehearsal.of(appearance, policy or Policy(), sweep, blur) for sweep in sweeps or [ReferenceSweep(appearance)]
    ]
    for number, rehearsal in enumerate(rehearsals, start=1):
        scored = sum(frame.state is FrameState.SCORED for frame in rehearsal.scored)
        if not scored:
            raise LearningError(f"none of the {len(rehearsal.scored)} frames of sweep {number} fits the appearance")
    at, by = sites(appearance, spacing * max(appearance.size)), shrink_by(appearance.size)
    sizes = tuple(size for size in (*SIZES, *(by * each for each in SIZES if by * each > SIZES[-1])))
    sizes = tuple(size for size in sizes if size <= max(appearance.size) / 10)
    levels = tuple(sorted(contrasts))
    guesses = {kind: _Guesses(sizes.index(_START)) for kind in kinds}
    searches = [_search(appearance, _Target(site, kind), guesses[kind], levels, sizes) for site in at for kind in kinds]
    answers = _run(searches, rehearsals, way(appearance), progress)
    smallest = np.array(answers).reshape(len(at), len(kinds), len(levels)).transpose(1, 2, 0)
    seen, astray = (sum(getattr(each, name) for each in rehearsals) for name in ("seen", "astray"))
    return Detectability(
        at,
        appearance.s,
        way(appearance),
        appearance.size,
        tuple(kinds),
        levels,
        sizes,
        smallest,
        np.array([_local(appearance, site) for site in at]),
        spacing * max(appearance.size),
        blur,
        len(sweeps),
        astray / max(seen, 1),
    )


def _lens(appearance: Appearance) -> float:
    """The blur of the golden pictures, by the sharpest edges of some of them."""
    places = appearance.keys[np.unique(np.linspace(0, len(appearance.keys) - 1, _BLURS).astype(int))]
    found = [sharpness(appearance.references.get(int(place)).picture) for place in places]
    known = [each for each in found if each is not None]
    return float(np.median(known)) if known else 1.0


def _local(appearance: Appearance, site: Site) -> float:
    contrast = appearance.references.get(site.place).band.contrast
    row, col = (int(v) // appearance.references.cell for v in (site.y, site.x))
    return float(contrast[min(row, contrast.shape[0] - 1), min(col, contrast.shape[1] - 1)])


@dataclass(frozen=True)
class _Target:
    """Where, and with what."""

    site: Site
    kind: Kind


@dataclass
class _Guesses:
    """What sites that have their answers say to those that do not: indices of sizes."""

    first: int
    shifts: dict[tuple[int, int], list[int]] = field(default_factory=dict[tuple[int, int], list[int]])

    def guess(self, level: int, found: dict[int, int]) -> int:
        """From the nearest contrast that has its answer at this site, as others went from there; or as others began."""
        near = min(found, key=lambda i: abs(i - level)) if found else level
        known = self.shifts.get((near, level), [])
        usual = sorted(known)[len(known) // 2] if known else None
        if near == level:
            return self.first if usual is None else usual
        return found[near] + (near - level if usual is None else usual)

    def learn(self, level: int, found: dict[int, int], index: int) -> None:
        """Another site has its answer."""
        for near, other in {level: 0, **found}.items():
            self.shifts.setdefault((near, level), []).append(index - other)


def _search(
    appearance: Appearance, target: _Target, guesses: _Guesses, contrasts: Sequence[float], sizes: Sequence[float]
) -> _Search:
    """Asks for one defect after the other to be tried; the smallest size caught at each contrast in the end.

    The middle contrast first: its answer bounds the others, as stronger defects are not harder to catch.
    """
    site, kind = target.site, target.kind
    if kind is Kind.LINE:
        sizes = [size for size in sizes if size <= _WIDEST * shrink_by(appearance.size)]
    middle = len(contrasts) // 2
    order = [middle, *range(middle + 1, len(contrasts)), *reversed(range(middle))]
    answers = [float("nan")] * len(contrasts)
    found: dict[int, int] = {}
    for level in order:
        contrast = contrasts[level]
        there, bright = _where(appearance, site, kind, contrast)
        if there is None:
            continue
        weaker = [found[i] for i in found if i < level]
        stronger = [found[i] for i in found if i > level]
        low, high = max(stronger, default=0) - 1, min(weaker, default=len(sizes))
        bisection = _bisect(low, high, guesses.guess(level, found))
        try:
            index = next(bisection)
            while True:
                index = bisection.send((yield Planted(there, Defect(kind, sizes[index], contrast, bright))))
        except StopIteration as done:
            guesses.learn(level, found, done.value)
            found[level] = done.value
            answers[level] = sizes[done.value] if done.value < len(sizes) else float("inf")
    return answers


def _bisect(low: int, high: int, start: int) -> Generator[int, bool, int]:
    """The first index in low < index <= high from which on things are caught; `high` is taken to be one.

    Steps of 1, 2, 4 from a guess until it is passed, halves from there.
    """
    caught_at, missed_at, stride = high, low, 1
    index = min(max(start, low + 1), high - 1)
    bounded = [False, False]
    while caught_at - missed_at > 1:
        caught = yield index
        if caught:
            caught_at, bounded[0] = index, True
        else:
            missed_at, bounded[1] = index, True
        if all(bounded):
            index = (caught_at + missed_at) // 2
        else:
            index = caught_at - stride if caught else missed_at + stride
            index = min(max(index, missed_at + 1), caught_at - 1)
            stride *= 2
    return caught_at


def _where(appearance: Appearance, site: Site, kind: Kind, contrast: float) -> tuple[Site | None, bool]:
    """Where a defect of that kind lies, and whether it is brighter than what is there."""
    if kind in (Kind.ADDED, Kind.MISSING):
        bright = kind is Kind.ADDED
        room, within = _ROOM * contrast, SPACING / 2 * max(appearance.size)
        reach = beside_edge(appearance.size)
        return beside(appearance, site, room=room, within=within, reach=reach, bright=bright), bright
    picture = appearance.references.get(site.place).picture
    y, x = int(site.y), int(site.x)
    about = picture[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4]
    return site, float(about.mean()) < 127.5


def _run(
    searches: Sequence[_Search],
    rehearsals: Sequence[Rehearsal],
    at: Float[np.ndarray, "n 2"],
    progress: Callable[[float], None] | None,
) -> list[list[float]]:
    """Try what the searches ask for, as many at once as can be kept apart, until all of them have their answers."""
    answers: list[list[float]] = [[] for _ in searches]
    asked: dict[int, Planted] = {}

    def advance(number: int, caught: bool | None) -> None:
        # what was tried goes to the end of the queue: none is left over that must then be tried alone
        asked.pop(number, None)
        try:
            asked[number] = next(searches[number]) if caught is None else searches[number].send(caught)
        except StopIteration as done:
            answers[number] = done.value

    for number in range(len(searches)):
        advance(number, None)
    apart = _APART * shrink_by(rehearsals[0].appearance.size)
    while asked:
        chosen = _apart(asked, at, apart, rehearsals[0].appearance.size[0])
        planted = [asked[number] for number in chosen]
        caught = np.all([rehearsal.attempt(planted) for rehearsal in rehearsals], axis=0)
        for number, each in zip(chosen, caught, strict=True):
            advance(number, bool(each))
        if progress:
            progress(1 - len(asked) / len(searches))
    return answers


def _apart(asked: dict[int, Planted], at: Float[np.ndarray, "n 2"], apart: float, width: int) -> list[int]:
    """Some of what is asked for, the first as they come, none close to another one while both are in view."""
    taken = np.empty((0, 5))
    chosen: list[int] = []
    for number, each in asked.items():
        site, radius = each.site, _room(each.defect, width)
        point = np.array([site.x, site.y]) - at[site.place]
        near = np.hypot(*(taken[:, :2] - point).T) < apart + taken[:, 2] + radius
        if (near & (taken[:, 3] < site.last) & (site.first < taken[:, 4])).any():
            continue
        taken = np.vstack([taken, [*point, radius, site.first, site.last]])
        chosen.append(number)
    return chosen


def _room(defect: Defect, width: int) -> float:
    """Half of a line's length; all of a disc's width, of which much disturbs more."""
    return max(defect.extent(width)) if defect.kind is Kind.LINE else defect.size
