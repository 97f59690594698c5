"""What a frame really shows: its place on the reference path, and where in the picture the defects are."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from inspector.cameras.simulated.motion import Exposure, Path
from inspector.cameras.simulated.render import Pose, project
from inspector.cameras.simulated.settings import Settings
from inspector.cameras.simulated.surface import Surface


@dataclass(frozen=True)
class DefectTruth:
    """A defect in one frame."""

    index: int
    """Counts the defects of the part from 0."""
    kind: str
    box: tuple[float, float, float, float]
    """x0, y0, x1, y1 in pixels of the frame; may reach beyond it."""
    inside: bool
    """Whether all of the box is in the frame."""


@dataclass(frozen=True)
class FrameTruth:
    """One frame."""

    sequence: int
    s: float
    """Place on the reference path that is closest to where the camera is over the part; below 0 in a lead-in."""
    commanded: float
    """Where the robot believes to be, as a sweep coordinate."""
    pose: Pose
    """Where the camera is over the part."""
    defects: tuple[DefectTruth, ...]


@dataclass(frozen=True)
class Patch:
    """The piece of a surface that a defect changes."""

    box: tuple[float, float, float, float]
    """x0, y0, x1, y1 in units."""
    heights: tuple[float, float]
    """Lowest and highest point in it, in units, with the defect or without."""


def patch_of(clean: Surface, defective: Surface) -> Patch | None:
    """Where the surfaces differ, with two pixels around for interpolation; None where they do not."""
    changed = clean.differs(defective).astype(np.uint8)
    x, y, width, height = cv2.boundingRect(changed)
    if width == 0:
        return None
    x0, y0 = max(0, x - 2), max(0, y - 2)
    window = (slice(y0, y + height + 2), slice(x0, x + width + 2))
    relief = np.stack([clean.height[window], defective.height[window]]) / clean.scale
    box = (x0 / clean.scale, y0 / clean.scale, (x + width + 1) / clean.scale, (y + height + 1) / clean.scale)
    return Patch(box, (float(relief.min()), float(relief.max())))


def frame_truth(
    exposure: Exposure, path: Path, patches: list[tuple[str, Patch | None]], settings: Settings
) -> FrameTruth:
    """What this exposure shows."""
    pose = exposure.pose
    u = path.nearest(np.array([pose.x, pose.y]), exposure.u)
    seen: list[DefectTruth] = []
    for index, (kind, patch) in enumerate(patches):
        if patch is None:
            continue
        x0, y0, x1, y1 = _box(patch, pose, settings)
        width, height = settings.size
        if x1 >= 0 and y1 >= 0 and x0 <= width - 1 and y0 <= height - 1:
            inside = x0 >= 0 and y0 >= 0 and x1 <= width - 1 and y1 <= height - 1
            seen.append(DefectTruth(index, kind, (x0, y0, x1, y1), inside))
    return FrameTruth(exposure.sequence, u / path.last, exposure.u / path.last, pose, tuple(seen))


def _box(patch: Patch, pose: Pose, settings: Settings) -> tuple[float, float, float, float]:
    x0, y0, x1, y1 = patch.box
    corners = np.array([(x, y, h) for x in (x0, x1) for y in (y0, y1) for h in patch.heights])
    seen = project(pose, settings.scale, settings.size, corners)
    spread = settings.blur / 2
    low, high = seen.min(axis=0) - spread, seen.max(axis=0) + spread
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
