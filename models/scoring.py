"""One frame against the appearance: placed, laid on its reference picture, compared, agreed with the places before."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from models.appearance import Appearance
from models.frame import Frame
from models.localise import Located, Trail, begin, locate, locate_by_look
from models.persistence import Sight, persist
from models.references import Reference
from models.registration import affine, full_pose, shrink_by, smooth
from models.tolerance import BRIGHT, Box, aligned, cells_shown, coarse_evidence, evidence, levels
from models.verdict import Region

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
    agreed: Float[np.ndarray, "rows cols c"] | None
    """Evidence over the limits that the last places agree on: bright and dark of each scale."""
    score: Float[np.ndarray, "rows cols 2"] | None
    """The same over the factor and over what is tolerated there, the highest of the scales; None where the frame
    could not be compared."""
    peak: float
    """The largest score."""
    raw: float
    """The evidence there, in grey levels."""


def remember(appearance: Appearance) -> Memory:
    """Before the first frame."""
    return Memory(begin(appearance.track))


def is_blind(picture: np.ndarray) -> bool:
    """Lamp out, lens covered or saturated: nothing to see."""
    return max(cv2.meanStdDev(picture)[1].ravel().tolist()) < _BLIND_SPREAD


def look(appearance: Appearance, factor: float, memory: Memory, frame: Frame) -> tuple[Memory, Look | None]:
    """Score one frame, `factor` being that of the limits; None where the picture shows nothing."""
    picture = levels(frame.pixels)
    elapsed = _elapsed(appearance, memory, frame)
    smoothed = smooth(appearance.ignored.filled(picture))
    if is_blind(smoothed):
        return Memory(memory.trail, memory.sights, frame.t_ns), None
    references = appearance.references
    x = appearance.preparation.prepare(frame.pixels)
    space = appearance.eigenspace
    z = space.project(x)
    guide = appearance.guide
    if guide.turn is None:
        trail, located = locate(guide, memory.trail, smoothed, z, elapsed, position=frame.encoder)
    else:
        away = guide.turn.away(z.astype(float), space.distance(x, z) ** 2)
        trail, located = locate_by_look(guide, memory.trail, smoothed, away, elapsed)
    distance = appearance.track.misfit(round(located.at), z.astype(float))
    if not located.verified:
        return Memory(trail, memory.sights, frame.t_ns), Look(located, distance, None, None, 0.0, 0.0)
    reference = references.get(located.reference)
    pose = full_pose(located.registered.pose, appearance.size)
    laid = aligned(picture, pose, located.registered.light)
    laid, unseen = appearance.ignored.laid(reference.picture, laid, pose, reference.cell)
    box = cells_shown(pose, appearance.size, reference.cell)
    found = _compared(reference, laid, box, factor)
    by = shrink_by(appearance.size)
    grid, point = by * appearance.path.at(located.reference), by * appearance.path.at(located.at)
    sights, agreed = persist(memory.sights, found, box, (located.at, point, grid), reference.cell, unseen=unseen)
    score = agreed * np.float32(1 / factor) if reference.allowed is None else agreed / (factor * reference.allowed)
    most = int(score.argmax())
    at, channel = divmod(most, agreed.shape[2])
    raw = float(agreed.ravel()[most]) * float(reference.thresholds[channel // 2].ravel()[at])
    peak = float(score.ravel()[most])
    return Memory(trail, sights, frame.t_ns), Look(located, distance, agreed, _highest(score), peak, raw)


def _compared(reference: Reference, laid: np.ndarray, box: Box, factor: float) -> Float[np.ndarray, "rows cols c"]:
    """Evidence over the limits, bright and dark of each scale."""
    fine, *coarse = reference.thresholds
    found = cv2.divide(evidence(reference.band, laid, reference.cell, factor * fine, box), cv2.merge([fine, fine]))
    if reference.coarse is None:
        return found
    wide = coarse_evidence(reference.coarse, laid, reference.cell, box)
    return np.concatenate([found, cv2.divide(wide, cv2.merge([coarse[0], coarse[0]]))], axis=2)


def _highest(score: Float[np.ndarray, "rows cols c"]) -> Float[np.ndarray, "rows cols 2"]:
    return score if score.shape[2] == 2 else np.maximum(score[:, :, :2], score[:, :, 2:])


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
