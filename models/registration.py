"""Lay a frame on the picture that should be there, to a fraction of a pixel, with gain and shading."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int

POSE = 3
"""Shift x, shift y (pixels), rotation (radians about the picture's centre)."""
LIGHT = 4
"""Gain, offset (grey levels), shading across x and y (gain at the edge less gain at the centre)."""
NO_LIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_CELLS = 1200
_BLUR = 1.5


@dataclass(frozen=True)
class Prior:
    """What is known of the pose and the light before the frame is looked at: Gaussian, by mean and precision."""

    pose: Float[np.ndarray, "3"]
    pose_precision: Float[np.ndarray, "3 3"]
    light: Float[np.ndarray, "4"]
    light_precision: Float[np.ndarray, "4 4"]


@dataclass(frozen=True, eq=False)
class Registered:
    """Where the frame lies, how it is lit, and how well that explains it."""

    pose: Float[np.ndarray, "3"]
    light: Float[np.ndarray, "4"]
    covariance: Float[np.ndarray, "3 3"]
    """Of the pose, from the points alone (the prior left out of its noise level)."""
    residual: float
    """Robust standard deviation of what is left at the points, in grey levels."""
    correlation: float
    """Of the frame with the explained picture over the points, in [-1, 1]."""
    outliers: float
    """Share of points that are not explained."""


def shrink_by(size: tuple[int, int]) -> int:
    """How many pixels of the picture one of registration's is wide: it works on pictures some 320 wide."""
    return max(1, round(max(size) / 360))


def smooth(picture: np.ndarray) -> Float[np.ndarray, "h w"]:
    """The picture as registration looks at it: grey, some 320 wide, blurred against noise and aliasing."""
    grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    h, w = grey.shape
    by = shrink_by((w, h))
    if by > 1:
        grey = cv2.resize(grey, (round(w / by), round(h / by)), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(grey, (0, 0), _BLUR)


def full_pose(pose: Float[np.ndarray, "3"], size: tuple[int, int]) -> Float[np.ndarray, "3"]:
    """A pose in registration's pixels as one in pixels of the picture of this (width, height)."""
    return pose * np.array([shrink_by(size), shrink_by(size), 1.0])


def choose_points(smoothed: np.ndarray, ignore: np.ndarray | None = None) -> Int[np.ndarray, "n"]:
    """The steepest pixel of every cell of a grid of some 1,200: flat indices into the picture."""
    h, w = smoothed.shape
    side = max(4, int(np.sqrt(h * w / _CELLS)))
    gx = cv2.Sobel(smoothed, cv2.CV_32F, 1, 0, ksize=1)
    gy = cv2.Sobel(smoothed, cv2.CV_32F, 0, 1, ksize=1)
    steep = gx * gx + gy * gy
    if ignore is not None:
        steep[ignore] = -1
    rim = 2
    rows, cols = (h - 2 * rim) // side, (w - 2 * rim) // side
    top, left = (h - rows * side) // 2, (w - cols * side) // 2
    cells = steep[top : top + rows * side, left : left + cols * side].reshape(rows, side, cols, side)
    cells = cells.transpose(0, 2, 1, 3).reshape(rows, cols, side * side)
    best = cells.argmax(axis=2)
    y = top + np.arange(rows)[:, None] * side + best // side
    x = left + np.arange(cols)[None, :] * side + best % side
    keep = cells.max(axis=2) >= 0
    return (y * w + x)[keep].astype(np.int32)


@dataclass(frozen=True, eq=False)
class Template:
    """A reference picture made ready for registration."""

    size: tuple[int, int]
    x: Float[np.ndarray, "n"]
    """Points, in pixels from the centre."""
    y: Float[np.ndarray, "n"]
    value: Float[np.ndarray, "n"]
    jacobian: Float[np.ndarray, "n 7"]
    """Of the explained value by pose (at gain 1) and by light."""
    shape: Float[np.ndarray, "n"]
    """The detail at the points: values without their slow part."""
    slow: Float[np.ndarray, "n 6"]
    """Orthonormal: what lamp and lens do, a quadratic over the picture; detail is what is left without it."""
    detail: float
    """Standard deviation of the detail, in grey levels."""

    @classmethod
    def of(cls, smoothed: np.ndarray, points: Int[np.ndarray, "n"]) -> Template:
        """Read values and slopes of a smoothed reference picture at the chosen points."""
        h, w = smoothed.shape
        flat = smoothed.reshape(-1)
        value = flat[points].astype(np.float32)
        gx = (flat[points + 1].astype(np.float32) - flat[points - 1]) * np.float32(0.5)
        gy = (flat[points + w].astype(np.float32) - flat[points - w]) * np.float32(0.5)
        row, col = np.divmod(points, w)
        x, y = (col - (w - 1) / 2).astype(np.float32), (row - (h - 1) / 2).astype(np.float32)
        jacobian = np.empty((len(points), POSE + LIGHT), np.float32)
        jacobian[:, 0], jacobian[:, 1], jacobian[:, 2] = -gx, -gy, gx * y - gy * x
        jacobian[:, 3], jacobian[:, 4] = value, 1
        jacobian[:, 5], jacobian[:, 6] = value * x * np.float32(2 / w), value * y * np.float32(2 / h)
        slow, _ = np.linalg.qr(_quadratic(x * np.float32(2 / w), y * np.float32(2 / h)))
        detail = value - slow @ (slow.T @ value)
        return cls((w, h), x, y, value, jacobian, detail, slow, float(np.sqrt(detail @ detail / len(detail))))


def _quadratic(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)


def affine(pose: Float[np.ndarray, "3"], size: tuple[int, int]) -> Float[np.ndarray, "2 3"]:
    """The map from reference pixels to frame pixels."""
    (tx, ty, angle), (w, h) = pose, size
    c, s = np.cos(angle), np.sin(angle)
    cx, cy = (w - 1) / 2, (h - 1) / 2
    return np.array([[c, -s, cx + tx - c * cx + s * cy], [s, c, cy + ty - s * cx - c * cy]])


def compose(pose: Float[np.ndarray, "3"], inner: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The pose that first applies `inner`, then `pose`."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([pose[0] + c * inner[0] - s * inner[1], pose[1] + s * inner[0] + c * inner[1], pose[2] + inner[2]])


def _sample(template: Template, frame: np.ndarray, pose: Float[np.ndarray, "3"]) -> tuple[np.ndarray, np.ndarray]:
    """Values of the frame where the points lie under `pose`, and which of them lie inside."""
    h, w = frame.shape
    m = affine(pose, template.size).astype(np.float32)
    tw, th = template.size
    x, y = template.x + np.float32((tw - 1) / 2), template.y + np.float32((th - 1) / 2)
    u, v = m[0, 0] * x + m[0, 1] * y + m[0, 2], m[1, 0] * x + m[1, 1] * y + m[1, 2]
    inside = (u >= 1) & (u <= w - 2) & (v >= 1) & (v <= h - 2)
    values = cv2.remap(frame, u[None], v[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return values.reshape(-1).astype(np.float32), inside


def _scale(residual: np.ndarray) -> float:
    """Robust standard deviation, never below what eight bits can show."""
    middle = np.partition(np.abs(residual), len(residual) // 2)[len(residual) // 2]
    return max(1.4826 * float(middle), 0.5)


def register(template: Template, frame: np.ndarray, prior: Prior, iterations: int = 6) -> Registered:
    """Inverse compositional alignment with a prior (Baker and Matthews 2004; Bayesian: the prior adds to the normal equations).

    `frame` is a picture made by `smooth`. Directions without texture fall back on the prior; robust weights
    leave out what is not explained. The slopes are the reference's, so the points may be read once a reference.
    """
    pose, light = prior.pose.copy(), prior.light.copy()
    jac, target = template.jacobian, template.value
    precision = np.zeros((POSE + LIGHT, POSE + LIGHT))
    for _ in range(iterations):
        values, inside = _sample(template, frame, pose)
        explained = jac[:, POSE:] @ light.astype(np.float32)
        residual = values - explained
        sigma = _scale(residual[inside] if inside.sum() > 30 else residual)
        weight = inside / np.square(1 + np.square(residual * np.float32(1 / (2.5 * sigma))))
        weighted = jac * weight[:, None]
        # neighbouring points share their noise: count four of them as one
        confidence = 0.25 / sigma**2
        data = (jac.T @ weighted).astype(np.float64) * confidence
        pull = (residual @ weighted).astype(np.float64) * confidence
        gain = max(light[0], 0.2)
        precision = data.copy()
        pull[:POSE] += prior.pose_precision @ (prior.pose - pose) / gain
        pull[POSE:] += prior.light_precision @ (prior.light - light)
        precision[:POSE, :POSE] += prior.pose_precision / gain**2
        precision[POSE:, POSE:] += prior.light_precision
        step = np.linalg.solve(precision, pull)
        pose = compose(pose, step[:POSE] / gain)
        light = light + step[POSE:]
        if np.abs(step[:2]).max() < 0.02:
            break
    values, inside = _sample(template, frame, pose)
    explained = jac[:, POSE:] @ light.astype(np.float32)
    residual = (values - explained)[inside]
    covariance = np.linalg.inv(precision)[:POSE, :POSE] / max(light[0], 0.2) ** 2
    if len(residual) < 30:
        return Registered(pose, light, covariance, np.inf, -1.0, 1.0)
    return Registered(pose, light, covariance, _scale(residual), *_agreement(template, residual, explained, inside))


def _agreement(
    template: Template, residual: np.ndarray, explained: np.ndarray, inside: np.ndarray
) -> tuple[float, float]:
    """Correlation of detail, with what is not explained clipped (a defect is not a wrong place), and its share."""
    b = explained - template.slow @ (template.slow.T @ explained)
    b = b[inside]
    limit = 2.0 * max(float(np.sqrt(b @ b / len(b))), 0.5)
    r = np.clip(residual, -limit, limit)
    r = r - r.mean()
    a = b + r
    correlation = float(a @ b / np.sqrt(max(float(a @ a) * float(b @ b), 1e-9)))
    return correlation, float((np.abs(residual) >= limit).mean())


def scan(
    template: Template,
    frame: np.ndarray,
    poses: Float[np.ndarray, "m 3"],
    light: Float[np.ndarray, "4"] | None,
    points: int = 240,
) -> Float[np.ndarray, "m"]:
    """Agreement of the frame with the reference picture at many poses, on a few points each: about 1 where it fits.

    What is not explained is clipped, so that a defect weighs no more than its points.
    """
    every = max(1, len(template.x) // points)
    x, y = template.x[::every], template.y[::every]
    h, w = frame.shape
    tw, th = template.size
    c, s = np.cos(poses[:, 2:]).astype(np.float32), np.sin(poses[:, 2:]).astype(np.float32)
    u = c * x - s * y + (poses[:, :1] + (tw - 1) / 2).astype(np.float32)
    v = s * x + c * y + (poses[:, 1:2] + (th - 1) / 2).astype(np.float32)
    values = cv2.remap(frame, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)
    inside = ((u >= 1) & (u <= w - 2) & (v >= 1) & (v <= h - 2)).astype(np.float32)
    target = template.value[::every]
    gain = float(values.mean() / max(float(target.mean()), 1.0)) if light is None else light[0]
    explained = (
        target * np.float32(gain) if light is None else template.jacobian[::every, POSE:] @ light.astype(np.float32)
    )
    r = values - explained
    r -= np.median(r[len(r) // 2])
    detail = np.float32(gain) * template.shape[::every]
    spread = max(float(np.sqrt(detail @ detail / len(detail))), 0.5)
    np.clip(r, -2 * spread, 2 * spread, out=r)
    r *= inside
    count = np.maximum(inside.sum(axis=1), 1)
    energy = np.einsum("mn,mn->m", r, r) / count - np.square(r.sum(axis=1) / count)
    return np.where(count > len(x) / 4, 1.0 - energy / spread**2, -3.0)
