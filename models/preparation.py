"""Preparation: from a picture to the vector x that everything else is learnt from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, cast, get_args

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt

from models import filters
from models.errors import AppearanceError, PictureError

Content = Literal["raw", "smooth", "gradient", "derivatives", "power", "log_power"]
Size = tuple[int, int]
_FULL: dict[np.dtype[Any], int] = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}
"""Full scale of the types that pictures have."""
_HEADER = ("size", "colour", "content", "sigma", "taper", "unit_energy", "picture")


def _read_only(mask: Bool[np.ndarray, "h w"] | None) -> Bool[np.ndarray, "h w"] | None:
    if mask is None:
        return None
    if mask.dtype != np.bool_ or mask.ndim != 2:
        raise PictureError(f"mask is {mask.dtype} of shape {mask.shape}, allowed is bool of shape (h, w)")
    mask = mask.copy()
    mask.flags.writeable = False
    return mask


@dataclass(frozen=True, eq=False)
class Window:
    """A part of the picture that is looked at: a rectangle, or any shape inside it.

    >>> Window(10, 20, 4, 2).label
    '4x2 at (10, 20)'
    """

    x: int
    """Left edge in pixels of the picture as recorded."""
    y: int
    """Upper edge."""
    width: int
    height: int
    mask: Bool[np.ndarray, "height width"] | None = None
    """True where the picture is looked at; None for all of the rectangle."""

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1 or self.x < 0 or self.y < 0:
            raise PictureError(f"window {self.label}: at least 1x1 pixels, from (0, 0) on, are allowed")
        object.__setattr__(self, "mask", _read_only(self.mask))
        if self.mask is not None and self.mask.shape != (self.height, self.width):
            raise PictureError(f"window {self.label}: its mask has shape {self.mask.shape}, allowed is (height, width)")

    @property
    def label(self) -> str:
        """How messages call it."""
        return f"{self.width}x{self.height} at ({self.x}, {self.y})"


@dataclass(frozen=True, eq=False)
class Preparation:
    """From a picture to the visual input x (p,) float32: windows, grey or colour, scale, filter, unit energy.

    The paper's "visual input" (Nayar, Nene, Murase 1996, section II): one window, or several of fixed place, size and
    shape, each read in raster order and concatenated; x / ||x|| takes lamp strength and aperture out. Values are 0..1
    of the pixel type before that. A black picture stays the zero vector.

    Decisions. Windows and masks are given in pixels of the picture as recorded; all windows are scaled by the one
    factor that takes the whole picture to `size`, each to its nearest whole size. Scaling averages areas in the
    picture's own integers, halving first where it can, and rounds (about half a grey level; a fifth of the time). A
    scaled pixel is left out where a don't-care pixel touches it or comes within reach of the filter, so that what lies
    under a mask changes nothing; power spectra, which see all of a window at once, take those pixels as black. A
    window knows nothing of what lies outside it.

    >>> picture = np.array([[10, 20, 30, 40], [50, 60, 70, 80]], np.uint8)
    >>> Preparation(unit_energy=False, windows=(Window(2, 0, 2, 1), Window(0, 1, 1, 1))).prepare(picture) * 255
    array([30., 40., 50.], dtype=float32)
    >>> Preparation(windows=(Window(2, 0, 2, 1),)).prepare(picture).round(4)
    array([0.6, 0.8], dtype=float32)
    """

    size: Size | None = None
    """(width, height) to which the whole picture is scaled; None leaves it as it is."""
    windows: tuple[Window, ...] = ()
    """What is looked at, in this order; empty for the whole picture."""
    ignore: Bool[np.ndarray, "h w"] | None = None
    """Don't-care mask over the whole picture: True is never looked at."""
    colour: bool = False
    """Three channels blue-green-red, interleaved; otherwise grey. Grey pictures are repeated, colour ones made grey."""
    content: Content = "raw"
    """`raw`, `smooth` (Gaussian), `gradient` (its magnitude), `derivatives` (the pair along x and y), `power`
    (spectrum), `log_power` (log(1 + spectrum), in units of its mean where `unit_energy`)."""
    sigma: float = 1.0
    """Of the Gaussian before `smooth`, `gradient` and `derivatives`, in pixels after scaling; 0 for none."""
    taper: bool = True
    """Power spectra: a Hann window against the jump at the edges. Without it, they do not change by circular shifts."""
    unit_energy: bool = True
    """Divide x by its length. Off where a bright defect must not darken the rest of its frame."""
    picture: Size | None = None
    """(width, height) of the only pictures allowed: set by `bind` when learning; None allows any."""

    def __post_init__(self) -> None:
        if self.content not in get_args(Content):
            raise PictureError(f"content {self.content!r}, allowed are {', '.join(get_args(Content))}")
        if self.size is not None and min(self.size) < 1:
            raise PictureError(f"pictures scaled to {self.size[0]}x{self.size[1]}, allowed is at least 1x1")
        if not 0 <= self.sigma < np.inf:
            raise PictureError(f"sigma is {self.sigma}, allowed is 0 and above")
        object.__setattr__(self, "ignore", _read_only(self.ignore))

    def bind(self, picture: Size) -> Preparation:
        """The same preparation for pictures of this (width, height) only; checks that windows and masks fit.

        Raises PictureError that names the window or mask that does not fit, or that leaves nothing to look at.
        """
        bound = replace(self, picture=picture)
        if not sum(view.length for view in bound._views):
            raise PictureError(f"the masks leave nothing of a picture of {picture[0]}x{picture[1]} to look at")
        return bound

    def length(self, picture: Size | None = None) -> int:
        """p, the length of x, for pictures of this (width, height), or of the size bound to."""
        if picture is None and self.picture is None:
            raise PictureError("the length of x depends on the size of the picture, and none was given")
        bound = self if self.picture == (picture or self.picture) else self.bind(cast(Size, picture))
        return sum(view.length for view in bound._views)

    def prepare(self, pixels: UInt[np.ndarray, "h w *c"]) -> Float[np.ndarray, " p"]:
        """x (p,) float32 of a picture (h, w) or (h, w, 3), uint8 or uint16. The picture is not changed.

        Raises PictureError where the picture is of another size than bound to, or of another type.
        """
        if pixels.dtype not in _FULL:
            raise PictureError(f"pixels are {pixels.dtype}, allowed are uint8 and uint16")
        size = (pixels.shape[1], pixels.shape[0])
        if self.picture is None and (self.windows or self.ignore is not None or self.content != "raw"):
            return self.bind(size).prepare(pixels)
        if self.picture is not None and size != self.picture:
            raise PictureError(f"picture is {size[0]}x{size[1]}, learnt were pictures of {_by(self.picture)}")
        if not self.windows and self.ignore is None and self.content == "raw":
            return self._energy(self._coloured(filters.scaled(self._greyed(pixels), self.size)))
        parts = [view.read(self._coloured(view.cut(self._greyed(pixels)))) for view in self._views]
        return self._energy(parts[0] if len(parts) == 1 else np.concatenate(parts))

    def _greyed(self, pixels: np.ndarray) -> np.ndarray:
        return cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 and not self.colour else pixels

    def _coloured(self, pixels: np.ndarray) -> np.ndarray:
        return cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR) if pixels.ndim == 2 and self.colour else pixels

    def _energy(self, values: np.ndarray) -> Float[np.ndarray, " p"]:
        """Integers are taken as shares of their type's full scale; the norm is summed in float64, integers exactly."""
        scale = 1.0 / _FULL.get(values.dtype, 1)
        if self.unit_energy:
            norm = cv2.norm(values.reshape(1, -1))
            scale = 1.0 / norm if norm > 0 else 0.0
        return np.multiply(values.reshape(-1), np.float32(scale), dtype=np.float32)

    @cached_property
    def _views(self) -> tuple[_View, ...]:
        picture = cast(Size, self.picture)
        if self.ignore is not None and self.ignore.shape != picture[::-1]:
            raise PictureError(f"the don't-care mask is {_by(self.ignore.shape[::-1])}, the picture {_by(picture)}")
        return tuple(self._view(window, picture) for window in self.windows or (Window(0, 0, *picture),))

    def _view(self, window: Window, picture: Size) -> _View:
        right, lower = window.x + window.width, window.y + window.height
        if right > picture[0] or lower > picture[1]:
            raise PictureError(f"window {window.label} does not fit in a picture of {_by(picture)}")
        size = self.size or picture
        factors = [wanted / given for wanted, given in zip(size, picture, strict=True)]
        scaled = (max(1, round(window.width * factors[0])), max(1, round(window.height * factors[1])))
        keep = np.ones((window.height, window.width), np.bool_) if window.mask is None else window.mask.copy()
        if self.ignore is not None:
            keep &= ~self.ignore[window.y : lower, window.x : right]
        # OpenCV weighs in float32: a whole cell sums to 1 within a few 1e-7.
        keep = filters.scaled(keep.astype(np.float64), scaled) > 1 - 2e-6
        return _View(window, scaled, keep, self)

    def to_header(self) -> dict[str, Any]:
        """Everything but the masks, as JSON holds it."""
        header: dict[str, Any] = {name: getattr(self, name) for name in _HEADER}
        header |= {name: list(header[name]) for name in ("size", "picture") if header[name]}
        return header | {"windows": [[w.x, w.y, w.width, w.height] for w in self.windows]}

    def arrays(self) -> dict[str, UInt[np.ndarray, "h w"]]:
        """The masks, as 0 and 1 of uint8: `ignore`, and `window3` for the mask of the fourth window."""
        masks = {"ignore": self.ignore} | {f"window{i}": window.mask for i, window in enumerate(self.windows)}
        return {name: mask.astype(np.uint8) for name, mask in masks.items() if mask is not None}

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], arrays: Mapping[str, UInt[np.ndarray, "h w"]]) -> Preparation:
        """What `to_header` and `arrays` gave. Raises AppearanceError where they do not make a preparation."""
        try:
            masks = {name: array.astype(np.bool_) for name, array in arrays.items()}
            given: dict[str, Any] = {name: header[name] for name in _HEADER}
            given |= {name: tuple(map(int, given[name])) for name in ("size", "picture") if given[name]}
            places = [tuple(map(int, place)) for place in header["windows"]]
            windows = tuple(Window(x, y, w, h, masks.get(f"window{i}")) for i, (x, y, w, h) in enumerate(places))
            made = cls(windows=windows, ignore=masks.get("ignore"), **given)
            return made.bind(made.picture) if made.picture else made
        except (KeyError, TypeError, ValueError, PictureError) as error:
            raise AppearanceError(f"the preparation in the file cannot be used: {error}") from error


@dataclass(frozen=True, eq=False)
class _View:
    """A window of a preparation that is bound to a picture size."""

    window: Window
    scaled: Size
    keep: Bool[np.ndarray, "h w"]
    how: Preparation

    def cut(self, pixels: np.ndarray) -> np.ndarray:
        w = self.window
        return filters.scaled(pixels[w.y : w.y + w.height, w.x : w.x + w.width], self.scaled)

    def read(self, pixels: np.ndarray) -> Float[np.ndarray, " n"]:
        """Filtered and masked, in raster order."""
        values = self._filter(pixels.astype(np.float32) / np.float32(_FULL[pixels.dtype]))
        return values[self._seen].reshape(-1) if self._masked else values.reshape(-1)

    @property
    def _spectral(self) -> bool:
        return self.how.content in ("power", "log_power")

    @property
    def _masked(self) -> bool:
        return not self._spectral and not self._seen.all()

    @cached_property
    def _seen(self) -> Bool[np.ndarray, "h w"]:
        """What is kept once the filter has carried don't-care pixels to their neighbours."""
        content, sigma = self.how.content, self.how.sigma
        reach = 0 if content == "raw" else filters.radius(sigma) + (content != "smooth")
        box = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
        # Outside the window is neither kept nor left out: the border of the erosion counts as kept.
        kept = cv2.erode(self.keep.astype(np.uint8), box, borderType=cv2.BORDER_CONSTANT, borderValue=1)
        return kept.astype(np.bool_)

    @property
    def length(self) -> int:
        channels = 3 if self.how.colour else 1
        width, height = self.scaled
        if self._spectral:
            return height * (width // 2 + 1) * channels * bool(self.keep.any())
        return int(np.count_nonzero(self._seen)) * channels * (1 + (self.how.content == "derivatives"))

    def _filter(self, values: np.ndarray) -> np.ndarray:
        content = self.how.content
        if content == "raw":
            return values
        if self._spectral:
            return self._power(values)
        values = filters.smooth(values, self.how.sigma)
        if content == "smooth":
            return values
        return filters.gradient(values) if content == "gradient" else filters.derivatives(values)

    def _power(self, values: np.ndarray) -> np.ndarray:
        power = filters.power_spectrum(values, self.keep, taper=self.how.taper)
        if self.how.content == "power":
            return power
        # Without the mean as unit the logarithm would let lamp strength back in.
        unit = float(power.mean()) if self.how.unit_energy else 1.0
        return np.log1p(power / np.float32(unit)) if unit > 0 else power


def _by(size: tuple[int, ...]) -> str:
    return f"{size[0]}x{size[1]}"
