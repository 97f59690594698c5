"""Bytes <-> pixels, strictly: a damaged picture is refused, never shown as a wrong one.

JPEG goes through libjpeg-turbo with its warnings as errors: OpenCV decodes cut and patched JPEGs into a wrong picture
without a word. What no decoder can see is a flip of a few bits inside a JPEG's compressed data, for the format has no
checksum; recordings carry one for that reason (see `inspector.recording`), and PNG has its own, which is checked here.
"""

from __future__ import annotations

import cv2
import numpy as np
import simplejpeg

from inspector.errors import PictureTooLarge, PictureUnreadable
from inspector.picture_headers import SIZES, kind_of
from models.frame import EncodedPicture

MAX_PIXELS = 1 << 27
"""134 megapixels: above what industrial area cameras deliver, below what exhausts a small computer."""
# Neither the turn that a header asks for nor a scaled depth: the pixels as the sensor had them.
AS_STORED = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION


def decode(picture: EncodedPicture, *, max_pixels: int = MAX_PIXELS) -> np.ndarray:
    """Pixels (h, w) grey or (h, w, 3) blue-green-red, uint8 or uint16; the bytes decide, not the name of the format.

    >>> decode(encode_png(np.array([[1, 2, 3]], np.uint16))).tolist()
    [[1, 2, 3]]
    """
    kind, size = kind_of(picture.data), len(picture.data)
    if kind is None:
        raise PictureUnreadable(picture.format or "nameless", size, f"unknown kind, allowed are {', '.join(SIZES)}")
    try:
        width, height = SIZES[kind](picture.data)
    except ValueError as error:
        raise PictureUnreadable(kind, size, str(error)) from error
    if not 0 < width * height <= max_pixels:
        raise PictureTooLarge(kind, size, width, height, max_pixels)
    pixels = _decode_jpeg(picture.data) if kind == "jpeg" else _decode_other(kind, picture.data)
    if pixels.shape[:2] != (height, width):
        raise PictureUnreadable(kind, size, f"{width}x{height} pixels announced, {pixels.shape[1::-1]} found")
    return pixels


def _decode_jpeg(data: bytes) -> np.ndarray:
    try:
        grey = simplejpeg.decode_jpeg_header(data)[2].lower() == "gray"
        pixels = simplejpeg.decode_jpeg(data, colorspace="GRAY" if grey else "BGR", strict=True)
    except ValueError as error:
        raise PictureUnreadable("jpeg", len(data), str(error)) from error
    return pixels[:, :, 0] if grey else pixels


def _decode_other(kind: str, data: bytes) -> np.ndarray:
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), AS_STORED)
    except cv2.error as error:
        raise PictureUnreadable(kind, len(data), str(error).strip().replace("\n", " ")) from error
    if pixels is None:
        raise PictureUnreadable(kind, len(data), "the decoder refuses it")
    if pixels.dtype.name not in ("uint8", "uint16"):
        raise PictureUnreadable(kind, len(data), f"pixels are {pixels.dtype}, allowed are uint8 and uint16")
    return pixels


def encode_png(pixels: np.ndarray) -> EncodedPicture:
    """The same pixels without loss, 8 or 16 bit, grey or colour."""
    return EncodedPicture("png", _checked(cv2.imencode(".png", pixels)))


def encode_jpeg(pixels: np.ndarray, quality: int = 95) -> EncodedPicture:
    """Nearly the same pixels, small; 8 bit only."""
    if pixels.dtype != np.uint8:
        raise PictureUnreadable("jpeg", pixels.nbytes, f"pixels are {pixels.dtype}, allowed is uint8")
    grey = pixels.ndim == 2
    plane = np.ascontiguousarray(pixels[:, :, None] if grey else pixels)
    space, sampling = ("GRAY", "Gray") if grey else ("BGR", "420")
    return EncodedPicture("jpeg", simplejpeg.encode_jpeg(plane, quality, space, sampling))


def _checked(encoded: tuple[bool, np.ndarray]) -> bytes:
    done, data = encoded
    if not done:
        raise PictureUnreadable("png", 0, "the encoder refuses the pixels")
    return data.tobytes()
