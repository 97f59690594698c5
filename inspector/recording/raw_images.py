"""Uncompressed pictures of recordings -> pixels: the common encodings of ROS and Foxglove."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from inspector.errors import PictureTooLarge, PictureUnreadable
from inspector.pictures import MAX_PIXELS


@dataclass(frozen=True)
class RawImage:
    """The fields that Image and RawImage have in common."""

    width: int
    height: int
    encoding: str
    step: int
    """Bytes from row to row."""
    data: bytes
    big_endian: bool = False


@dataclass(frozen=True)
class Encoding:
    """How the samples of one pixel lie in memory, and what makes grey or blue-green-red of them."""

    samples: int
    bits: int = 8
    convert: int | None = None
    """A colour conversion of OpenCV."""


def _encodings() -> dict[str, Encoding]:
    table = {"8UC1": Encoding(1), "16UC1": Encoding(1, 16), "8UC3": Encoding(3), "16UC3": Encoding(3, 16)}
    for bits in (8, 16):
        table[f"mono{bits}"] = Encoding(1, bits)
        table[f"bgr{bits}"] = Encoding(3, bits)
        table[f"rgb{bits}"] = Encoding(3, bits, cv2.COLOR_RGB2BGR)
        table[f"bgra{bits}"] = Encoding(4, bits, cv2.COLOR_BGRA2BGR)
        table[f"rgba{bits}"] = Encoding(4, bits, cv2.COLOR_RGBA2BGR)
        # Named by the first two pixels of the first two rows; OpenCV's older names say the opposite corner.
        table[f"bayer_rggb{bits}"] = Encoding(1, bits, cv2.COLOR_BayerRGGB2BGR)
        table[f"bayer_bggr{bits}"] = Encoding(1, bits, cv2.COLOR_BayerBGGR2BGR)
        table[f"bayer_gbrg{bits}"] = Encoding(1, bits, cv2.COLOR_BayerGBRG2BGR)
        table[f"bayer_grbg{bits}"] = Encoding(1, bits, cv2.COLOR_BayerGRBG2BGR)
    for name in ("uyvy", "yuv422"):
        table[name] = Encoding(2, 8, cv2.COLOR_YUV2BGR_UYVY)
    for name in ("yuyv", "yuv422_yuy2"):
        table[name] = Encoding(2, 8, cv2.COLOR_YUV2BGR_YUY2)
    return table


ENCODINGS = _encodings()


def to_pixels(image: RawImage, *, max_pixels: int = MAX_PIXELS) -> np.ndarray:
    """(h, w) grey or (h, w, 3) blue-green-red, uint8 or uint16; PictureUnreadable when the sizes do not fit.

    >>> to_pixels(RawImage(2, 1, "rgb8", 6, bytes((1, 2, 3, 4, 5, 6)))).tolist()
    [[[3, 2, 1], [6, 5, 4]]]
    """
    encoding = ENCODINGS.get(image.encoding)
    if encoding is None:
        raise _refused(image, f"allowed encodings are {', '.join(sorted(ENCODINGS))}")
    if not 0 < image.width * image.height <= max_pixels:
        raise PictureTooLarge(image.encoding, len(image.data), image.width, image.height, max_pixels)
    planes = _rows(image, encoding)
    if encoding.convert is None:
        return planes
    try:
        return cv2.cvtColor(planes, encoding.convert)
    except cv2.error as error:
        raise _refused(image, f"{image.width}x{image.height} pixels are not allowed for it") from error


def _rows(image: RawImage, encoding: Encoding) -> np.ndarray:
    """The samples of every pixel, without the padding at the ends of the rows, in the computer's byte order."""
    row = image.width * encoding.samples * encoding.bits // 8
    step = image.step or row
    # Some writers leave out the padding behind the last row.
    if step < row or len(image.data) not in (step * image.height, step * (image.height - 1) + row):
        raise _refused(image, f"{image.width}x{image.height} pixels in rows of {step} bytes do not fill it")
    padded = image.data.ljust(step * image.height, b"\0")
    rows = np.frombuffer(padded, np.uint8).reshape(image.height, step)[:, :row]
    kind = np.dtype(f"{'>' if image.big_endian else '<'}u{encoding.bits // 8}")
    samples = np.ascontiguousarray(rows).view(kind).astype(kind.newbyteorder("="), copy=False)
    shape = (image.height, image.width, encoding.samples)
    return samples.reshape(shape[:2] if encoding.samples == 1 else shape)


def _refused(image: RawImage, why: str) -> PictureUnreadable:
    return PictureUnreadable(image.encoding or "nameless", len(image.data), why)
