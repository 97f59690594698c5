"""One frame against the appearance: placed, laid on its reference picture, compared, agreed with the places before."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from models.appearance import Appearance
from models.frame import Frame
from models.limits import Limits
from models.localise import Located, Trail, begin, locate, locate_by_look
from models.persistence import Sight, persist
from models.registration import affine, full_pose, shrink_by, smooth
from models.tolerance import BRIGHT, aligned, beyond, cells_shown, evidence, levels
from models.verdict import Region

_WIDENS = 0.5
"""Scores of golden sweeps from here on widen the band."""
_BLIND_SPREAD = 2.0
"""A picture that varies by less than this (standard deviation, grey levels) shows nothing."""


@dataclass(frozen=True, eq=False)
class Memory:
    """What is carried from frame to frame: a small value."""

    trail: Trail
    sights: tuple[Sight, ...] = ()
    t_ns: int | None = None


@dataclass(frozen=True, eq=False)
class Look:
    """What one frame showed; `score` is laid on the reference picture."""

    located: Located
    z_distance: float
    """Distance of z from the curve where the frame was placed: about 1 on a good part."""
    score: Float[np.ndarray, "rows cols 2"] | None
    """Evidence over threshold that the last places agree on; None where the frame could not be compared."""
    peak: float
    """The largest score agreed on."""
    raw: float
    """The evidence there, in grey levels."""


def remember(appearance: Appearance) -> Memory:
    """Before the first frame."""
    return Memory(begin(appearance.track))


def is_blind(picture: np.ndarray) -> bool:
    """Lamp out, lens covered or saturated: nothing to see."""
    return max(cv2.meanStdDev(picture)[1].ravel().tolist()) < _BLIND_SPREAD


def look(appearance: Appearance, limits: Limits, memory: Memory, frame: Frame) -> tuple[Memory, Look | None]:
    """Score one frame; None where the picture shows nothing."""
    picture = levels(frame.pixels)
    elapsed = _elapsed(appearance, memory, frame)
    smoothed = smooth(picture)
    if is_blind(smoothed):
        return Memory(memory.trail, memory.sights, frame.t_ns), None
    references = appearance.references
    x = appearance.preparation.prepare(frame.pixels)
    space = appearance.eigenspace
    z = space.project(x)
    guide = appearance.guide
    if guide.turn is None:
        trail, located = locate(guide, memory.trail, smoothed, z, elapsed)
    else:
        away = guide.turn.away(z.astype(float), space.distance(x, z) ** 2)
        trail, located = locate_by_look(guide, memory.trail, smoothed, away, elapsed)
    distance = appearance.track.misfit(round(located.at), z.astype(float))
    if not located.verified:
        return Memory(trail, memory.sights, frame.t_ns), Look(located, distance, None, 0.0, 0.0)
    reference = references.get(located.reference)
    threshold = limits.threshold(reference.band.contrast)
    pose = full_pose(located.registered.pose, appearance.size)
    laid = aligned(picture, pose, located.registered.light)
    box = cells_shown(pose, appearance.size, reference.cell)
    found = evidence(reference.band, laid, reference.cell, threshold, box)
    score = cv2.divide(found, cv2.merge([threshold, threshold]))
    by = shrink_by(appearance.size)
    grid, point = by * appearance.path.at(located.reference), by * appearance.path.at(located.at)
    sights, score = persist(memory.sights, score, box, (located.at, point, grid), reference.cell)
    most = int(score.argmax())
    peak = float(score.ravel()[most])
    shown = Look(located, distance, score, peak, peak * float(threshold.ravel()[most // 2]))
    return Memory(trail, sights, frame.t_ns), shown


def regions(appearance: Appearance, shown: Look) -> tuple[Region, ...]:
    """Where the score is at the threshold or above, in pixels of the frame; the strongest first."""
    if shown.score is None or shown.peak < 1.0:
        return ()
    size, cell = appearance.size, appearance.references.cell
    m = affine(full_pose(shown.located.registered.pose, size), size)
    found: list[Region] = []
    for polarity, name in ((BRIGHT, "bright"), (1 - BRIGHT, "dark")):
        layer = shown.score[:, :, polarity]
        count, labels, boxes, _ = cv2.connectedComponentsWithStats((layer >= 1.0).astype(np.uint8), connectivity=8)
        for i in range(1, count):
            x, y, width, height = (int(v) for v in boxes[i, :4])
            peak = float(layer[y : y + height, x : x + width][labels[y : y + height, x : x + width] == i].max())
            found.append(_region(m, (x * cell, y * cell, (x + width) * cell, (y + height) * cell), size, peak, name))
    return tuple(sorted(found, key=lambda region: -region.score))


def _region(m: np.ndarray, box: tuple[int, int, int, int], size: tuple[int, int], peak: float, polarity: str) -> Region:
    corners = m @ np.array([[box[0], box[2], box[0], box[2]], [box[1], box[1], box[3], box[3]], [1, 1, 1, 1]], float)
    x0, y0 = np.clip(np.floor(corners.min(axis=1)), 0, np.array(size) - 1)
    x1, y1 = np.clip(np.ceil(corners.max(axis=1)), np.array([x0, y0]) + 1, size)
    return Region(int(x0), int(y0), int(x1 - x0), int(y1 - y0), peak, polarity)


def _elapsed(appearance: Appearance, memory: Memory, frame: Frame) -> float:
    """Nominal frame intervals since the frame before: 1 where times cannot tell."""
    if memory.t_ns is None or appearance.interval_ns <= 0:
        return 1.0
    return min(max((frame.t_ns - memory.t_ns) / appearance.interval_ns, 0.05), 12.0)


def spread_beyond(appearance: Appearance, picture: np.ndarray, shown: Look) -> dict[int, np.ndarray]:
    """What a good picture shows beyond the band, for the key places about it: uint8 (2 h, w[, 3]), bright above dark.

    Only what persists counts: noise and misregistration widen nothing.
    """
    located = shown.located
    reference = appearance.references.get(located.reference)
    if shown.score is None or shown.peak < _WIDENS:
        return {}
    h, w = picture.shape[:2]
    laid = aligned(picture, full_pose(located.registered.pose, (w, h)), located.registered.light)
    already = appearance.references.excess(located.reference)
    parts: list[np.ndarray] = []
    for polarity, excess in enumerate(beyond(reference.band, laid)):
        mask = _pixels(shown.score[:, :, polarity] >= _WIDENS, reference.cell, (h, w))
        more = np.clip(np.ceil(excess * (mask if excess.ndim == 2 else mask[:, :, None])), 0, 255).astype(np.uint8)
        # what is beyond the band is beyond what widened it already, too
        parts.append(np.where(more > 0, cv2.add(more, already[polarity]), np.uint8(0)))
    found: dict[int, np.ndarray] = {}
    key = int(np.searchsorted(appearance.keys, located.reference))
    for place in (int(place) for place in appearance.keys[max(0, key - 1) : key + 2]):
        dx, dy = shrink_by(appearance.size) * appearance.path.between(located.reference, place)
        m = np.array([[1, 0, dx], [0, 1, dy]])
        found[place] = np.vstack([cv2.warpAffine(part, m, (w, h), flags=cv2.INTER_NEAREST) for part in parts])
    return found


def _pixels(cells: Bool[np.ndarray, "rows cols"], cell: int, shape: tuple[int, int]) -> UInt8[np.ndarray, "h w"]:
    """The pixels of some cells and of those about them."""
    grown = cv2.dilate(cells.astype(np.uint8), np.ones((3, 3), np.uint8))
    size = (cells.shape[1] * cell, cells.shape[0] * cell)
    return cv2.resize(grown, size, interpolation=cv2.INTER_NEAREST)[: shape[0], : shape[1]]
