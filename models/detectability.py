"""What can be found on a part, and where not: the smallest defect that is caught, all along the sweep."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from models.defects import Kind
from models.sites import Site

_INNER = 0.06
"""A site that gets further than this share of the width from the picture's rim is not at the rim."""
_WEAK = 1.5
"""A stretch is weak where even its best place needs so many times the usual size."""
_STEPS = 100
"""Of the chart along s."""


@dataclass(frozen=True, eq=False)
class Detectability:
    """The smallest defect that is caught at each site of a part, by kind and contrast.

    A defect is caught where a region over the threshold lies on it in at least one frame of its visit. Between sites
    nothing was tried; between the sizes in `sizes` neither. That what is larger is caught, too, is assumed.
    """

    sites: tuple[Site, ...]
    s: Float[np.ndarray, " n"]
    """Sweep coordinate of each place."""
    way: Float[np.ndarray, "n 2"]
    """Displacement of the picture at each place from the first, in pixels of the picture."""
    size: tuple[int, int]
    """(width, height) of the pictures."""
    kinds: tuple[Kind, ...]
    contrasts: tuple[float, ...]
    """Grey levels, ascending."""
    sizes: tuple[float, ...]
    """Those that were tried, ascending, in pixels."""
    smallest: Float[np.ndarray, "kinds contrasts sites"]
    """In pixels; inf where none is caught, nan where nothing could be tried: no edge that strong nearby."""
    local: Float[np.ndarray, " sites"]
    """Local contrast of the reference picture at each site, in grey levels: what thresholds go by."""
    spacing: float
    """Of the sites, in pixels."""
    blur: float
    """Sigma of the lens that the defects were drawn with, in pixels."""
    sweeps: int
    """Recordings that the defects were put into; 0 for the appearance's own reference pictures, which have no noise."""
    astray: float
    """Share of the frames with defects whose place a defect moved by more than one."""

    def at(self, kind: Kind, contrast: float) -> Float[np.ndarray, " sites"]:
        """Smallest size caught at each site, for a defect of at least that contrast; inf below all that were tried."""
        graded = [i for i, each in enumerate(self.contrasts) if each <= contrast]
        if not graded:
            return np.full(len(self.sites), np.inf)
        return self.smallest[self.kinds.index(kind), graded[-1]]

    @cached_property
    def inner(self) -> Bool[np.ndarray, " sites"]:
        """Which sites are not at the rim of the picture all the time that they are in view."""
        return np.array([site.depth >= _INNER * max(self.size) for site in self.sites])

    @cached_property
    def s_of(self) -> Float[np.ndarray, " sites"]:
        """Where along the sweep each site comes nearest to the middle of the picture."""
        return self.s[[site.place for site in self.sites]]

    @cached_property
    def points(self) -> Float[np.ndarray, "sites 2"]:
        """Where the sites lie on the part, in pixels of the first place's picture."""
        return np.array([(site.x, site.y) for site in self.sites]) - self.way[[site.place for site in self.sites]]

    @cached_property
    def views(self) -> Int[np.ndarray, "sites 2"]:
        """The places first <= place < last at which each site is in view."""
        return np.array([(site.first, site.last) for site in self.sites])

    def about(self, s: float, x: float, y: float, within: float | None = None) -> Int[np.ndarray, " m"]:
        """The sites around what lies at (x, y) in the picture at s: those in view then, within one spacing."""
        place = int(np.abs(self.s - s).argmin())
        off = np.hypot(*(self.points + self.way[place] - (x, y)).T)
        first, last = self.views.T
        seen = (first - 1 <= place) & (place <= last)
        return np.flatnonzero(seen & (off <= (self.spacing if within is None else within)))

    def along(self, kind: Kind, contrast: float) -> Along:
        """The smallest size caught along the sweep, the picture's rim left out."""
        s = (np.arange(_STEPS) + 0.5) / _STEPS
        travel = float(np.hypot(*np.diff(self.way, axis=0).T).sum())
        near = max(0.5 / _STEPS, 0.75 * self.spacing / max(travel, 1.0))
        sizes = np.where(self.inner, self.at(kind, contrast), np.nan)
        three = np.full((3, _STEPS), np.nan)
        for i, each in enumerate(s):
            here = sizes[(np.abs(self.s_of - each) <= near) & ~np.isnan(sizes)]
            if len(here):
                three[:, i] = here.min(), np.sort(here)[len(here) // 2], here.max()
        return Along(s, *three)

    def usual(self, kind: Kind, contrast: float) -> float:
        """The median of the sites that are not at the rim; nan where nothing was tried."""
        tried = self.at(kind, contrast)[self.inner]
        tried = np.sort(tried[~np.isnan(tried)])
        return float(tried[len(tried) // 2]) if len(tried) else float("nan")

    def weak(self, kind: Kind, contrast: float) -> tuple[Stretch, ...]:
        """Stretches in which even the best place needs clearly more than usual, or in which nothing is caught."""
        along, usual = self.along(kind, contrast), self.usual(kind, contrast)
        over = np.isinf(along.best) | (along.best >= _WEAK * usual)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], over.astype(np.int8), [0]])))
        return tuple(
            Stretch(a / _STEPS, b / _STEPS, kind, contrast, float(along.best[a:b].min()))
            for a, b in zip(edges[::2], edges[1::2], strict=True)
        )

    def over_picture(self, kind: Kind, contrast: float, cols: int = 16) -> Float[np.ndarray, "2 rows cols"]:
        """What a defect that lies there in the picture must have to be caught at all, whenever it is in view.

        The usual of it over the sweep, and the worst; nan where nothing was tried.
        """
        w, h = self.size
        rows = max(1, round(cols * h / w))
        sizes = self.at(kind, contrast)
        found = np.full((_STEPS, rows, cols), np.nan)
        xs, ys = (np.arange(cols) + 0.5) * w / cols, (np.arange(rows) + 0.5) * h / rows
        for i, place in enumerate(np.linspace(0, len(self.s) - 1, _STEPS).astype(int)):
            points = self.points + self.way[place]
            first, last = self.views.T
            seen = np.flatnonzero((first <= place) & (place < last) & ~np.isnan(sizes))
            if not len(seen):
                continue
            off = np.hypot(points[seen, 0] - xs[None, :, None], points[seen, 1] - ys[:, None, None])
            nearest = off.argmin(axis=2)
            found[i] = np.where(off.min(axis=2) <= self.spacing, sizes[seen][nearest], np.nan)
        ordered = np.sort(found, axis=0)
        tried = (~np.isnan(found)).sum(axis=0)
        usual, worst = (
            np.take_along_axis(ordered, np.maximum(at, 0)[None], axis=0)[0] for at in (tried // 2, tried - 1)
        )
        return np.stack([usual, worst])


@dataclass(frozen=True, eq=False)
class Along:
    """Sizes over s: of the best place in the picture, the usual one, and the worst; nan where nothing was tried."""

    s: Float[np.ndarray, " m"]
    best: Float[np.ndarray, " m"]
    usual: Float[np.ndarray, " m"]
    worst: Float[np.ndarray, " m"]


@dataclass(frozen=True)
class Stretch:
    """Between s_start <= s < s_end nothing of that kind and contrast below `size` pixels is caught; inf: nothing is."""

    s_start: float
    s_end: float
    kind: Kind
    contrast: float
    size: float


def expected_size(found: Detectability, s: float, x: float, y: float, *, contrast: float, kind: Kind) -> float:
    """The size from which on a defect at (x, y) in the picture at s is caught, in pixels; inf where nothing says so.

    The worst of the sites within one spacing decides. Where nothing of the kind could be tried, spots answer.
    """
    near = found.about(s, x, y)
    if not len(near):
        return float("inf")
    of_kind, spots = found.at(kind, contrast)[near], found.at(Kind.SPOT, contrast)[near]
    return float(np.where(np.isnan(of_kind), spots, of_kind).max())


def expected_caught(
    found: Detectability, s: float, x: float, y: float, *, size: float, contrast: float, kind: Kind
) -> bool:
    """Whether a defect of that size and contrast at (x, y) in the picture at s should be found."""
    return size >= expected_size(found, s, x, y, contrast=contrast, kind=kind)
