"""The finished surface as the renderer reads it: relief, and the layers that light falls on."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from inspector.cameras.simulated.canvas import Canvas

GREY = np.array([[0.114, 0.587, 0.299]], np.float32)
"""Weights of blue, green and red in a grey camera's eye."""


@dataclass(frozen=True, eq=False)
class Surface:
    """One part, ready to be looked at. Read-only: it is shared by every sweep over this part."""

    scale: float
    """Pixels per unit."""
    height: np.ndarray
    """(h, w) relief in pixels, towards the camera."""
    albedo: np.ndarray
    """(h, w) or (h, w, 3), 0..1."""
    normal: np.ndarray
    """(h, w, 3): slope of the unit normal in x and y, and gloss."""

    @staticmethod
    def of(canvas: Canvas, colour: bool) -> Surface:
        """The canvas, lit from everywhere: corners and pockets are a little darker."""
        height = canvas.height * np.float32(canvas.scale)
        hollow: np.ndarray = cv2.GaussianBlur(canvas.height, (0, 0), 5 * canvas.scale) - canvas.height
        shadow = np.clip(1 - np.float32(0.035) * hollow, 0.55, 1.12)[..., None]
        albedo = np.clip(canvas.colour * shadow, 0, 1)
        albedo = albedo if colour else cv2.transform(albedo, GREY)
        smooth = cv2.GaussianBlur(height, (0, 0), 0.6)
        dx, dy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=0.125), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=0.125)
        length = np.sqrt(1 + dx * dx + dy * dy)
        surface = Surface(canvas.scale, height, albedo, cv2.merge([-dx / length, -dy / length, canvas.gloss]))
        for layer in (surface.height, surface.albedo, surface.normal):
            layer.flags.writeable = False
        return surface

    def differs(self, other: Surface) -> np.ndarray:
        """(h, w) bool: where two surfaces differ by more than the faint rim of a shadow, a grey level or two."""
        apart = np.abs(self.height - other.height) > 0.05 * self.scale
        apart |= np.abs(self.normal - other.normal).max(axis=2) > 0.01
        albedo = np.abs(self.albedo - other.albedo)
        return apart | ((albedo if albedo.ndim == 2 else albedo.max(axis=2)) > 0.006)
