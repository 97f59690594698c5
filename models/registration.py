"""Lay a frame on the picture that should be there, to a fraction of a pixel, with gain and shading."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, sqrt

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt

POSE = 3
"""Shift x, shift y (pixels), rotation (radians about the picture's centre)."""
LIGHT = 4
"""Gain, offset (grey levels), shading across x and y (gain at the edge less gain at the centre)."""
NO_LIGHT = np.array([1.0, 0.0, 0.0, 0.0])
WIDE = 320
"""Registration works on pictures about this wide, whatever the camera's are."""
_CELLS = 800
STEPS, STEPS_FAR = 5, 15
"""Of the iteration at the most: close to a good guess, and without one."""
_SETTLED = 0.08
"""Pixels: a step smaller than this ends the iteration."""
_BOUND = 2.5
"""Robust weights fall off from here, in standard deviations."""
_SHARED = 0.25
"""Neighbouring points share their noise: four count as one."""
_SCAN_POINTS = 240
_GRAIN = 0.7
"""What noise leaves of itself in a smoothed picture, in grey levels."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the pose and the light before the frame is looked at: Gaussian, by mean and precision."""

    pose: Float[np.ndarray, " 3"]
    pose_precision: Float[np.ndarray, "3 3"]
    light: Float[np.ndarray, " 4"]
    light_precision: Float[np.ndarray, "4 4"]


@dataclass(frozen=True, eq=False)
class Registered:
    """Where the frame lies, how it is lit, and how well that explains it."""

    pose: Float[np.ndarray, " 3"]
    light: Float[np.ndarray, " 4"]
    covariance: Float[np.ndarray, "3 3"]
    """Of the pose."""
    residual: float
    """Robust standard deviation of what is left at the points, in grey levels."""
    correlation: float
    """Of the frame's detail with the explained detail over the points, in [-1, 1]."""


def shrink_by(size: tuple[int, int]) -> int:
    """How many pixels of the picture one of registration's is wide."""
    return max(1, round(max(size) / (1.125 * WIDE)))


def smooth(picture: np.ndarray) -> Float[np.ndarray, "h w"]:
    """The picture as registration looks at it: grey, some 320 wide, blurred against noise and aliasing."""
    grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    h, w = grey.shape
    by = shrink_by((w, h))
    if by > 1:
        grey = cv2.resize(grey, (round(w / by), round(h / by)), interpolation=cv2.INTER_AREA)
    # two boxes make a bell of sigma 1.6 at a fifth of a Gaussian's cost
    return cv2.blur(cv2.blur(grey, (5, 5)), (3, 3))


def full_pose(pose: Float[np.ndarray, " 3"], size: tuple[int, int]) -> Float[np.ndarray, " 3"]:
    """A pose in registration's pixels as one in pixels of the picture of this (width, height)."""
    by = shrink_by(size)
    x, y, turn = pose.tolist()
    return np.array([by * x, by * y, turn])


@dataclass(frozen=True)
class Grid:
    """Some 800 square cells over a picture, each of which has a point: rows x cols of them, row by row.

    >>> Grid.over((320, 240))
    Grid(width=320, side=10, rows=23, cols=31, top=5, left=5)
    """

    width: int
    """Of the picture, in pixels."""
    side: int
    rows: int
    cols: int
    top: int
    left: int

    @classmethod
    def over(cls, size: tuple[int, int]) -> Grid:
        """For pictures of this (width, height)."""
        w, h = size
        side = max(4, round(float(np.sqrt(h * w / _CELLS))))
        rim = 2
        rows, cols = (h - 2 * rim) // side, (w - 2 * rim) // side
        return cls(w, side, rows, cols, (h - rows * side) // 2, (w - cols * side) // 2)

    def points(self, within: UInt[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Flat indices into the picture of points that are given by where they lie in their cells, row by row."""
        down, across = np.divmod(within.reshape(self.rows, self.cols).astype(np.int32), np.int32(self.side))
        y = down + np.arange(self.top, self.top + self.rows * self.side, self.side, dtype=np.int32)[:, None]
        x = across + np.arange(self.left, self.left + self.cols * self.side, self.side, dtype=np.int32)[None, :]
        return (y * np.int32(self.width) + x).ravel()


def choose_points(smoothed: np.ndarray) -> UInt[np.ndarray, " n"]:
    """The steepest pixel of every cell of the picture's grid: where it lies in its cell, row by row."""
    h, w = smoothed.shape
    grid = Grid.over((w, h))
    side, rows, cols, top, left = grid.side, grid.rows, grid.cols, grid.top, grid.left
    gx = cv2.Sobel(smoothed, cv2.CV_32F, 1, 0, ksize=1)
    gy = cv2.Sobel(smoothed, cv2.CV_32F, 0, 1, ksize=1)
    steep = (gx * gx + gy * gy)[top : top + rows * side, left : left + cols * side]
    cells = steep.reshape(rows, side, cols, side).transpose(0, 2, 1, 3).reshape(rows, cols, side * side)
    return cells.argmax(axis=2).ravel().astype(np.uint8 if side <= 16 else np.uint16)


@dataclass(frozen=True, eq=False)
class Template:
    """A reference picture made ready for registration: n points of it."""

    size: tuple[int, int]
    points: Float32[np.ndarray, "3 n"]
    """x, y and 1 of each point, in pixels from the centre."""
    jacobian: Float32[np.ndarray, "7 n"]
    """Of the explained value by pose (at gain 1) and by light; its fourth row is the value itself."""
    shape: Float32[np.ndarray, " n"]
    """The values without what lamp and lens do, a quadratic over the picture: the detail."""
    detail: float
    """Standard deviation of the detail, in grey levels."""

    @property
    def agrees(self) -> float:
        """By how much a frame of the same place agrees with it: less than 1 where there is little but noise."""
        return self.detail / float(np.hypot(self.detail, _GRAIN))

    @classmethod
    def of(cls, smoothed: np.ndarray, within: UInt[np.ndarray, " n"]) -> Template:
        """Read values and slopes of a smoothed reference picture at the points that `choose_points` chose."""
        h, w = smoothed.shape
        points = Grid.over((w, h)).points(within)
        flat = smoothed.reshape(-1)
        value, right, left, below, above = (flat.take(points + by).astype(np.float32) for by in (0, 1, -1, w, -w))
        row = points // w
        x = (points - row * w - (w - 1) / 2).astype(np.float32)
        y = (row - (h - 1) / 2).astype(np.float32)
        u, v = x * np.float32(2 / w), y * np.float32(2 / h)
        xy1 = np.stack([x, y, np.ones_like(x)])
        jacobian = np.empty((POSE + LIGHT, len(points)), np.float32)
        jacobian[0] = (left - right) * np.float32(0.5)
        jacobian[1] = (above - below) * np.float32(0.5)
        jacobian[2] = jacobian[1] * x - jacobian[0] * y
        jacobian[3], jacobian[4], jacobian[5], jacobian[6] = value, 1, value * u, value * v
        slow = np.stack([jacobian[4], u, v, u * u, u * v, v * v]).astype(float)
        fit = np.asarray(np.linalg.solve(slow @ slow.T, slow @ value), float)
        shape = (value - fit @ slow).astype(np.float32)
        return cls((w, h), xy1, jacobian, shape, float(np.sqrt(shape @ shape / len(shape))))


def affine(pose: Float[np.ndarray, " 3"], size: tuple[int, int]) -> Float[np.ndarray, "2 3"]:
    """The map from reference pixels to frame pixels."""
    tx, ty, angle = pose.tolist()
    c, s = cos(angle), sin(angle)
    cx, cy = (size[0] - 1) / 2, (size[1] - 1) / 2
    return np.array([[c, -s, cx + tx - c * cx + s * cy], [s, c, cy + ty - s * cx - c * cy]])


def compose(pose: Float[np.ndarray, " 3"], inner: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """The pose that first applies `inner`, then `pose`."""
    (x, y, angle), (u, v, turn) = pose.tolist(), inner.tolist()
    c, s = cos(angle), sin(angle)
    return np.array([x + c * u - s * v, y + s * u + c * v, angle + turn])


def _sample(template: Template, frame: np.ndarray, pose: Float[np.ndarray, " 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Values of the frame where the points lie under `pose`, and where that is: (n,), (2, n)."""
    tw, th = template.size
    x, y, angle = pose.tolist()
    c, s = cos(angle), sin(angle)
    m = np.array([[c, -s, x + (tw - 1) / 2], [s, c, y + (th - 1) / 2]], np.float32)
    at = m @ template.points
    values = cv2.remap(frame, at[:1], at[1:], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return values.reshape(-1).astype(np.float32), at


def _inside(at: Float32[np.ndarray, "2 ..."], frame: np.ndarray) -> Bool[np.ndarray, ...]:
    """Which places lie in the frame, a pixel's rim left out."""
    h, w = frame.shape
    x, y = at
    return (np.abs(x - np.float32(w / 2)) < w / 2 - 1) & (np.abs(y - np.float32(h / 2)) < h / 2 - 1)


def _scale(residual: np.ndarray) -> float:
    """Robust standard deviation, never below what eight bits can show."""
    if not len(residual):
        return np.inf
    size = np.abs(residual)
    size.partition(len(size) // 2)
    middle = size[len(size) // 2]
    return max(1.4826 * float(middle), 0.5)


def register(template: Template, frame: np.ndarray, prior: Prior, steps: int = STEPS) -> Registered:
    """Inverse compositional alignment (Baker and Matthews, IJCV 2004) with a prior in its normal equations.

    `frame` is a picture made by `smooth`. Directions without texture fall back on the prior; robust weights
    leave out what is not explained. The slopes are the reference's, so the points are read once a reference.
    """
    jac = template.jacobian
    pose, light = prior.pose.copy(), prior.light.copy()
    values, at = _sample(template, frame, pose)
    inside = _inside(at, frame)
    precision, gain = np.eye(POSE + LIGHT), 1.0
    known = np.zeros((POSE + LIGHT, POSE + LIGHT))
    known[POSE:, POSE:] = prior.light_precision
    for _ in range(steps):
        residual = values - light.astype(np.float32) @ jac[POSE:]
        sigma = _scale(residual[inside])
        if sigma == np.inf:
            break
        weight = residual * np.float32(1 / (_BOUND * sigma))
        weight *= weight
        weight += 1
        weight *= weight
        weighted = jac * (inside * np.float32(_SHARED / sigma**2) / weight)
        gain = max(float(light[0]), 0.2)
        known[:POSE, :POSE] = prior.pose_precision / gain**2
        apart = np.concatenate([(prior.pose - pose) * gain, prior.light - light])
        precision = weighted @ jac.T + known
        step = cv2.solve(precision, (weighted @ residual + known @ apart)[:, None])[1].ravel()
        pose = compose(pose, step[:POSE] / gain)
        light = light + step[POSE:]
        values, at = _sample(template, frame, pose)
        x, y, turn = step[:POSE].tolist()
        # a turn moves the corners by half the width
        if max(abs(x), abs(y), abs(turn) * frame.shape[1] / 2) < _SETTLED * gain:
            break
    inside = _inside(at, frame)
    residual = (values - light.astype(np.float32) @ jac[POSE:])[inside]
    covariance = cv2.invert(precision)[1][:POSE, :POSE] / gain**2
    if len(residual) < len(values) / 10:
        return Registered(pose, light, covariance, np.inf, -1.0)
    agreement = _agreement(template.shape[inside] * np.float32(gain), residual)
    return Registered(pose, light, covariance, _scale(residual), agreement)


def _agreement(detail: np.ndarray, residual: np.ndarray) -> float:
    """Correlation of detail, with what is not explained clipped: a defect is not a wrong place."""
    energy = float(detail @ detail)
    limit = 2.0 * max(sqrt(energy / len(detail)), 0.5)
    seen = np.minimum(np.maximum(residual, -limit), limit)
    seen -= np.add.reduce(seen) / np.float32(len(seen))
    seen += detail
    return float(seen @ detail) / sqrt(max(float(seen @ seen) * energy, 1e-9))


def scan(
    template: Template, frame: np.ndarray, poses: Float[np.ndarray, "m 3"], light: Float[np.ndarray, " 4"]
) -> Float[np.ndarray, " m"]:
    """Agreement of the frame with the reference picture at many poses, on a few points each: about 1 where it fits.

    What is not explained is clipped, so that a defect weighs no more than its points.
    """
    every = max(1, template.points.shape[1] // _SCAN_POINTS)
    x, y, _ = template.points[:, ::every]
    tw, th = template.size
    c, s = np.cos(poses[:, 2:]).astype(np.float32), np.sin(poses[:, 2:]).astype(np.float32)
    u = c * x - s * y + (poses[:, :1] + (tw - 1) / 2).astype(np.float32)
    v = s * x + c * y + (poses[:, 1:2] + (th - 1) / 2).astype(np.float32)
    values = cv2.remap(frame, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    inside = _inside(np.stack([u, v]), frame)
    r = values - light.astype(np.float32) @ template.jacobian[POSE:, ::every]
    r -= np.partition(r[len(r) // 2], len(x) // 2)[len(x) // 2]
    spread = max(float(light[0]) * template.detail, 0.5)
    np.clip(r, -2 * spread, 2 * spread, out=r)
    r *= inside
    count = np.maximum(np.count_nonzero(inside, axis=1), 1)
    energy = np.einsum("mn,mn->m", r, r) / count - np.square(r.sum(axis=1) / count)
    return np.where(count > len(x) / 4, 1.0 - energy / spread**2, -3.0)
