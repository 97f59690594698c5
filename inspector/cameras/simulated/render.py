"""Looks at a surface through a camera at a finite height: parallax, a lamp that travels with the camera, a lens.

A point at height h is seen where the ray to it meets the ground H/(H - h) times as far from the principal point. So a
pixel at r looks at r (1 - h/H), with h the height there: a fixed point, and with walls of bounded slope a
contraction. Approximations: the lamp and the eye are taken to be as far from a raised point as from the ground (h is
small beside H), and raised things cast no shadow.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from inspector.cameras.simulated.surface import Surface

DISTANCE = 620.0
"""H, the camera's height over the ground, in units: 29 degrees across a 320 wide picture."""
LAMP = (-230.0, -310.0)
"""The lamp beside the lens, at the camera's height, in units: from the upper left, as engineers expect drawings lit."""
ROUNDS = 4
"""Rounds of the fixed point: what is left is below a tenth of a wall's shift in the corners, nothing elsewhere."""


@dataclass(frozen=True)
class Pose:
    """Where the camera is over the part."""

    x: float
    y: float
    """Foot of the camera's axis, in units."""
    angle: float = 0.0
    """Turn of the camera, radians."""


class Renderer:
    """Pictures of one surface in one size; the rays and the light are worked out once per angle."""

    def __init__(self, surface: Surface, size: tuple[int, int], angle: float = 0.0, shade: float = 0.0) -> None:
        self._surface, self._angle = surface, angle
        width, height = size
        x = np.arange(width, dtype=np.float32)[None, :] - np.float32((width - 1) / 2)
        y = np.arange(height, dtype=np.float32)[:, None] - np.float32((height - 1) / 2)
        c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
        self._rays = (c * x - s * y, s * x + c * y)
        self._lens = (1 - 0.25 * ((x / width) ** 2 + (y / height) ** 2)) * (1 + np.float32(shade) * x / width)
        self._light, self._half = self._directions()

    def _directions(self) -> tuple[np.ndarray, np.ndarray]:
        """(3, h, w) unit vectors from each pixel's ground to the lamp, and half-way between lamp and eye."""
        scale, (rx, ry) = self._surface.scale, self._rays
        up = np.full_like(rx, DISTANCE * scale)
        c, s = np.cos(self._angle), np.sin(self._angle)
        lamp = (scale * (c * LAMP[0] - s * LAMP[1]), scale * (s * LAMP[0] + c * LAMP[1]))
        light = _unit(np.stack([np.float32(lamp[0]) - rx, np.float32(lamp[1]) - ry, up]))
        return light, _unit(light + _unit(np.stack([-rx, -ry, up])))

    def picture(self, pose: Pose) -> np.ndarray:
        """(h, w) or (h, w, 3) float32, 0..255 and beyond where light is reflected: without gain, noise and rounding."""
        at = self._meet(pose.x * self._surface.scale, pose.y * self._surface.scale)
        albedo = cv2.remap(self._surface.albedo, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        normal = cv2.remap(self._surface.normal, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
        nx, ny, gloss = cv2.split(normal)
        nz = cv2.sqrt(np.maximum(1 - nx * nx - ny * ny, 0.01))
        diffuse = _dot(self._light, nx, ny, nz)
        mirror = _dot(self._half, nx, ny, nz)
        for _ in range(5):  # to the power of 32
            mirror *= mirror
        diffuse = (np.float32(0.30) + np.float32(0.95) * diffuse) * self._lens
        mirror *= gloss * self._lens * np.float32(95)
        if albedo.ndim == 3:
            diffuse, mirror = diffuse[..., None], mirror[..., None]
        return albedo * (diffuse * np.float32(215)) + mirror

    def _meet(self, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
        """Where on the surface every pixel's ray ends, in pixels of the surface."""
        rx, ry = self._rays
        at_x, at_y = rx + np.float32(x), ry + np.float32(y)
        nearer = np.float32(1 / (DISTANCE * self._surface.scale))
        for _ in range(ROUNDS):
            height = cv2.remap(self._surface.height, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
            height *= nearer
            at_x = rx * (1 - height)
            at_x += np.float32(x)
            at_y = ry * (1 - height)
            at_y += np.float32(y)
        return at_x, at_y


def project(pose: Pose, scale: float, size: tuple[int, int], points: np.ndarray) -> np.ndarray:
    """Frame pixels (n, 2) of points (n, 3): x, y and height in units."""
    c, s = np.cos(pose.angle), np.sin(pose.angle)
    dx, dy = points[:, 0] - pose.x, points[:, 1] - pose.y
    seen = np.stack([c * dx + s * dy, c * dy - s * dx], axis=1)
    seen *= scale * (DISTANCE / (DISTANCE - points[:, 2:]))
    return seen + (np.array(size) - 1) / 2


def _unit(v: np.ndarray) -> np.ndarray:
    return (v / np.linalg.norm(v, axis=0)).astype(np.float32)


def _dot(v: np.ndarray, nx: np.ndarray, ny: np.ndarray, nz: np.ndarray) -> np.ndarray:
    out = v[0] * nx
    out += v[1] * ny
    out += v[2] * nz
    return np.maximum(out, 0, out=out)
