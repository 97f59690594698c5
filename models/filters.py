"""What a window of a picture may be turned into before it is read: scaled, smoothed, derived, its power spectrum."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float32


def scaled(pixels: np.ndarray, size: tuple[int, int] | None) -> np.ndarray:
    """The picture at another (width, height), averaged over areas; itself where `size` is None or its own.

    >>> scaled(np.array([[10, 20, 30, 60], [30, 40, 50, 40]], np.uint8), (2, 1))
    array([[25, 45]], dtype=uint8)
    """
    if size is None:
        return pixels
    # Halving has fast code of its own in OpenCV, a factor of sixteen has not.
    while _halves(pixels.shape[1], size[0]) and _halves(pixels.shape[0], size[1]):
        half = (pixels.shape[1] // 2, pixels.shape[0] // 2)
        pixels = cv2.resize(pixels, half, interpolation=cv2.INTER_AREA)
    if size == (pixels.shape[1], pixels.shape[0]):
        return pixels
    return cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)


def _halves(given: int, wanted: int) -> bool:
    """Whether halving first gives the same areas, or, from a factor of eight on, nearly so."""
    return given % 2 == 0 and ((given // 2) % wanted == 0 or given >= 8 * wanted)


def radius(sigma: float) -> int:
    """Reach of `smooth` in pixels: three sigma, beyond which lie 0.3 % of a Gaussian; 0 where sigma is 0."""
    return int(np.ceil(3 * sigma))


def smooth(values: Float32[np.ndarray, "h w *c"], sigma: float) -> Float32[np.ndarray, "h w *c"]:
    """Blurred by a Gaussian; itself where sigma is 0."""
    side = 2 * radius(sigma) + 1
    return cv2.GaussianBlur(values, (side, side), sigma) if sigma else values


def derivatives(values: Float32[np.ndarray, "h w *c"]) -> Float32[np.ndarray, "h w *c 2"]:
    """Change per pixel along x and along y, by Scharr's filter; reaches one pixel."""
    # Scharr's weights sum to 16 and span two pixels.
    along = [cv2.Scharr(values, cv2.CV_32F, dx, 1 - dx, scale=1 / 32) for dx in (1, 0)]
    return np.stack(along, axis=-1)


def gradient(values: Float32[np.ndarray, "h w *c"]) -> Float32[np.ndarray, "h w *c"]:
    """Length of the derivatives. Not by cv2.magnitude, whose last bit depends on where in memory its arrays lie."""
    along = derivatives(values)
    return np.sqrt(np.square(along[..., 0]) + np.square(along[..., 1]))


def power_spectrum(
    values: Float32[np.ndarray, "h w *c"], keep: Bool[np.ndarray, "h w"], *, taper: bool
) -> Float32[np.ndarray, "h v c"]:
    """|F|^2 / n over the half plane by which a real picture's spectrum is known; v = w // 2 + 1.

    What is not kept counts as black. `taper` multiplies by a Hann window, against the jump at the edges.
    """
    weights = keep.astype(np.float32)
    if taper:
        weights = weights * np.outer(*(np.hanning(n + 2)[1:-1] for n in keep.shape)).astype(np.float32)
    channels = values.reshape(*values.shape[:2], -1)
    spectrum = np.fft.rfft2(channels * weights[..., None], axes=(0, 1))
    return (np.abs(spectrum) ** 2 / weights.size).astype(np.float32)
