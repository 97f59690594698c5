"""Points of a part, spread evenly over all that a sweep shows: where synthetic defects are put."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int

from models.appearance import Appearance
from models.registration import shrink_by

_RIM = 0.025
"""The outermost points lie this share of the width from the picture's rim."""
_THIN = 0.7
"""Share of the spacing below which two points are one too many."""
_AT_LEAST = 24
"""Of the sweep's places, however little the picture moves."""
_LONGEST = 8
"""No point is followed for more than one in so many of the sweep's places, either way."""


@dataclass(frozen=True)
class Site:
    """A point of the part while it passes through the picture once."""

    place: int
    """The key place, one with a picture, at which it comes nearest to the middle of the picture."""
    x: float
    """In pixels of the reference picture of that place, as y."""
    y: float
    first: int
    """It is in view at the places first <= place < last."""
    last: int
    depth: float
    """How far from the picture's rim it gets, in pixels."""


def way(appearance: Appearance) -> Float[np.ndarray, "n 2"]:
    """Displacement of the picture at each place from the first, in pixels of the picture."""
    return shrink_by(appearance.size) * appearance.path.points


def sites(appearance: Appearance, spacing: float) -> tuple[Site, ...]:
    """Points about `spacing` pixels apart, in the order in which the camera passes them.

    What comes into view twice, on two rows of the sweep, is two sites: each visit has its own chance.
    """
    at = way(appearance)
    keys = appearance.keys
    anchors = np.unique([appearance.path.key(float(place)) for place in _anchors(at, spacing)])
    reach = max(20, len(at) // _LONGEST)
    found: list[Site] = []
    points = np.empty((0, 2))
    for anchor in anchors:
        for x, y in _grid(appearance.size, spacing):
            site = visit(at, appearance.size, int(anchor), (x, y), reach=reach, keys=keys)
            # others are met again, nearer to the middle, from another anchor
            if abs(anchors - site.place).min() < abs(anchor - site.place):
                continue
            point = np.array([site.x, site.y]) - at[site.place]
            close = np.flatnonzero(np.hypot(*(points - point).T) < _THIN * spacing)
            if not any(found[i].first < site.last and site.first < found[i].last for i in close):
                found.append(site)
                points = np.vstack([points, point])
    return tuple(sorted(found, key=lambda site: (site.place, site.y, site.x)))


def visit(
    at: Float[np.ndarray, "n 2"],
    size: tuple[int, int],
    place: int,
    point: tuple[float, float],
    *,
    reach: int,
    keys: Int[np.ndarray, " m"],
) -> Site:
    """The site of the point that lies at `point` in the picture of the key place `place`; `keys` are all of them.

    It is followed for `reach` places at the most.
    """
    start, end = max(0, place - reach), min(len(at), place + reach + 1)
    ways = at[start:end] - at[place] + np.array(point)
    depths = np.minimum(ways, np.array(size) - 1 - ways).min(axis=1)
    out = np.flatnonzero(depths < 0)
    here = place - start
    first = int(out[out < here].max(initial=-1)) + 1
    last = int(out[out > here].min(initial=end - start))
    shown = keys[(keys >= start + first) & (keys < start + last)]
    off = np.hypot(*(ways[shown - start] - np.array(size) / 2).T) + 1e-6 * abs(shown - place)
    nearest = int(shown[off.argmin()])
    x, y = ways[nearest - start]
    depth = float(depths[first:last].max())
    return Site(nearest, float(x), float(y), start + first, start + last, depth)


def _anchors(at: Float[np.ndarray, "n 2"], spacing: float) -> Int[np.ndarray, " m"]:
    """Places as far apart as the spacing, or closer where the picture hardly moves; both ends among them."""
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(at, axis=0).T))])
    # where the picture stands still, too, the way goes on
    travelled += np.arange(len(at)) * 1e-6
    by_travel = np.searchsorted(travelled, np.arange(0.0, travelled[-1], spacing))
    few = travelled[-1] < _AT_LEAST * spacing
    by_place = np.linspace(0, len(at) - 1, _AT_LEAST + 1 if few else 2)
    return np.unique(np.concatenate([by_travel, by_place]).astype(int))


def _grid(size: tuple[int, int], spacing: float) -> list[tuple[float, float]]:
    """Points over a picture, the outermost close to its rim, and some through its middle."""
    rim = _RIM * max(size)
    xs, ys = (np.linspace(rim, side - 1 - rim, 2 * round((side - 2 * rim) / spacing / 2 + 0.2) + 1) for side in size)
    return [(float(x), float(y)) for y in ys for x in xs]


def beside(appearance: Appearance, site: Site, *, room: float, within: float, reach: int, bright: bool) -> Site | None:
    """The nearest point to a site, `within` pixels, that could be `room` grey levels brighter (or darker) and be
    like what lies beside it, up to `reach` pixels away; None where there is none.
    """
    picture = appearance.references.get(site.place).picture
    grey = cv2.blur(picture if picture.ndim == 2 else np.ascontiguousarray(picture.mean(axis=2)), (3, 3))
    h, w = grey.shape
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    x0, x1 = (int(np.clip(site.x + sign * (within + reach), 0, w)) for sign in (-1, 1))
    y0, y1 = (int(np.clip(site.y + sign * (within + reach), 0, h)) for sign in (-1, 1))
    part = grey[y0:y1, x0:x1].astype(np.float32)
    if not part.size:
        return None
    more = cv2.dilate(part, square) - part if bright else part - cv2.erode(part, square)
    rows, cols = np.nonzero(more >= room)
    off = np.hypot(cols + x0 - site.x, rows + y0 - site.y)
    if not len(off) or off.min() > within:
        return None
    i = int(off.argmin())
    return Site(site.place, float(cols[i] + x0), float(rows[i] + y0), site.first, site.last, site.depth)
