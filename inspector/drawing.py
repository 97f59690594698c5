"""Ink on pictures: views that map pixels onto tiles, signed differences in colour, text, a chart. OpenCV only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

Picture: TypeAlias = UInt8[np.ndarray, "h w 3"]
Colour = tuple[int, int, int]
"""Blue, green, red."""

PAPER, INK, FAINT, RULE = (250, 250, 250), (40, 40, 40), (100, 100, 100), (205, 205, 205)
BRIGHT, DARK = (30, 50, 225), (225, 90, 20)
"""Brighter than expected: red; darker: blue."""
SILENT = 3.0
"""Grey levels that are not coloured: noise."""


@dataclass(frozen=True)
class View:
    """A piece of a picture, enlarged or reduced onto a tile: tile = scale * (pixel - corner)."""

    size: tuple[int, int]
    """(width, height) of the tile."""
    scale: float
    corner: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def whole(cls, picture: np.ndarray, width: int) -> View:
        """All of the picture on a tile of that width."""
        scale = width / picture.shape[1]
        return cls((width, max(1, round(scale * picture.shape[0]))), scale)

    def about(self, x: float, y: float, extent: float) -> View:
        """Of a view of the whole: what lies about (x, y), as far as `extent`, on the same tile; within the picture."""
        scale = max(self.scale, self.size[1] / extent)
        shown, room = ([side / each for side in self.size] for each in (scale, self.scale))
        left, top = (
            min(max(at - part / 2, 0.0), all_ - part) for at, part, all_ in zip((x, y), shown, room, strict=True)
        )
        return View(self.size, scale, (left, top))

    def picture(self, picture: np.ndarray) -> np.ndarray:
        """The tile, of the same kind of pixels."""
        if self.scale < 1 and self.corner == (0.0, 0.0):
            return cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA)
        # The centre of pixel 0 is at 0.5 of its own width.
        x, y = (self.scale * (0.5 - corner) - 0.5 for corner in self.corner)
        matrix = np.array([[self.scale, 0, x], [0, self.scale, y]])
        return cv2.warpAffine(picture, matrix, self.size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def points(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Where points of the picture come to lie on the tile."""
        return self.scale * (points - np.array(self.corner))


def blank(width: int, height: int) -> Picture:
    """Paper."""
    return np.full((height, width, 3), PAPER, np.uint8)


def coloured(picture: np.ndarray) -> Picture:
    """The picture with three channels, grey or not."""
    return np.repeat(picture[:, :, None], 3, axis=2) if picture.ndim == 2 else picture.copy()


def signed(difference: np.ndarray) -> Float32[np.ndarray, "h w"]:
    """One number per pixel: of several channels the one that differs most."""
    if difference.ndim == 2:
        return difference.astype(np.float32)
    most = np.abs(difference).argmax(axis=2)[:, :, None]
    return np.take_along_axis(difference, most, axis=2)[:, :, 0].astype(np.float32)


def difference_picture(difference: Float32[np.ndarray, "h w"], ground: np.ndarray, full: float) -> Picture:
    """Red where brighter, blue where darker, over a pale grey picture; `full` grey levels are full colour.

    >>> picture = difference_picture(np.float32([[0, 50, -50]]), np.zeros((1, 3), np.uint8), full=40)
    >>> picture[0].tolist()
    [[150, 150, 150], [30, 50, 225], [225, 90, 20]]
    """
    grey = coloured(ground).mean(axis=2, keepdims=True)
    pale = 150 + 0.35 * grey
    strength = np.clip((np.abs(difference) - SILENT) / max(full - SILENT, 1.0), 0, 1)[:, :, None]
    ink = np.where((difference > 0)[:, :, None], np.array(BRIGHT, np.float32), np.array(DARK, np.float32))
    return (pale + strength * (ink - pale)).round().astype(np.uint8)


def heat(beyond: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 4"]:
    """Orange where too bright, blue where too dark, to be laid on a picture; nothing is drawn below half the limit.

    At the limit, 1 and -1, the ink covers 45 %, from three times that on all.

    >>> heat(np.float32([[0.4, 1, -3]]))[0].tolist()
    [[0, 140, 255, 0], [0, 140, 255, 115], [255, 110, 30, 255]]
    """
    cover = np.interp(np.abs(beyond), (0.5, 1.0, 3.0), (0.0, 0.45, 1.0))[:, :, None]
    ink = np.where((beyond >= 0)[:, :, None], (0, 140, 255), (255, 110, 30))
    return np.concatenate([ink, np.rint(255 * cover)], axis=2).astype(np.uint8)


def outline(tile: Picture, corners: Float[np.ndarray, "n 2"], colour: Colour) -> None:
    """A closed line on the tile, with a pale rim so that it is seen on any ground."""
    line = [np.round(corners * 16).astype(np.int32).reshape(-1, 1, 2)]
    cv2.polylines(tile, line, True, PAPER, 3, cv2.LINE_AA, 4)
    cv2.polylines(tile, line, True, colour, 1, cv2.LINE_AA, 4)


def write(picture: Picture, text: str, at: tuple[int, int], colour: Colour = INK, size: float = 0.45) -> None:
    """Text with its lower left corner there; letters that the font does not have become question marks."""
    plain = text.encode("ascii", "replace").decode()
    thick = 2 if size > 0.6 else 1
    cv2.putText(picture, plain, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, thick, cv2.LINE_AA)


def scale_bar(width: int, full: float) -> Picture:
    """What the colours of a difference mean."""
    bar = blank(width, 40)
    levels = np.tile(np.linspace(-full, full, width, dtype=np.float32), (14, 1))
    bar[2:16] = difference_picture(levels, np.full((14, width), 128, np.uint8), full)
    for text, x in ((f"-{full:.0f} darker", 0), (f"brighter +{full:.0f}", width - 102)):
        write(bar, text, (x, 32), FAINT, 0.4)
    return bar


@dataclass(frozen=True)
class Chart:
    """The score along the sweep, on a strip of paper."""

    width: int
    height: int
    top: float
    """Score at the upper rim."""

    def at(self, s: float, score: float) -> tuple[int, int]:
        """Where a score lies on the strip."""
        x = round(s * (self.width - 1))
        return x, round((self.height - 22) * (1 - min(score, self.top) / self.top)) + 4

    def draw(
        self, line: Sequence[tuple[float, float] | None], stretches: Sequence[tuple[float, float]], peak: float
    ) -> Picture:
        """(s, score) in order, None where there is none; stretches out of tolerance; s of the peak shown."""
        paper = blank(self.width, self.height)
        for start, end in stretches:
            cv2.rectangle(paper, self.at(start, self.top), self.at(end, 0), (215, 215, 250), cv2.FILLED)
        for score, colour in ((0.0, RULE), (1.0, FAINT)):
            cv2.line(paper, self.at(0, score), self.at(1, score), colour, 1)
        cv2.line(paper, self.at(peak, self.top), self.at(peak, 0), BRIGHT, 1)
        for before, now in pairwise(line):
            if before is not None and now is not None:
                cv2.line(paper, self.at(*before), self.at(*now), INK, 1, cv2.LINE_AA)
        for tenth in range(11):
            x, y = self.at(tenth / 10, 0)
            cv2.line(paper, (x, y), (x, y + 4), FAINT, 1)
            write(paper, f"{tenth / 10:g}", (min(max(x - 8, 0), self.width - 20), y + 17), FAINT, 0.4)
        return paper
