"""What a picture's bytes say of themselves before they are decoded: kind, size, and whether they are whole.

Decoders are lenient: many return a grey half, or reserve gigabytes, for bytes that are cut or hostile. What can be
known from the headers is therefore asked first. Each function takes the bytes, raises ValueError with the reason, or
returns (width, height).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator

import simplejpeg

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
STANDARD_HUFFMAN = bytes((0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7D))
"""Code lengths of the luminance table of ITU-T T.81 K.5, which nearly every camera uses."""
ZERO_RUN = bytes(12)
"""Would take 32 coefficients in a row of exactly -1: no picture has that, a hole in the data has."""


def kind_of(data: bytes) -> str | None:
    """The kind of a picture by its first bytes, None for a kind that is not read.

    >>> kind_of(b"\\xff\\xd8\\xff\\xe0"), kind_of(b"GIF89a")
    ('jpeg', None)
    """
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "webp"
    magics = {b"\xff\xd8\xff": "jpeg", PNG_MAGIC: "png", b"BM": "bmp", b"II*\0": "tiff", b"MM\0*": "tiff"}
    return next((kind for magic, kind in magics.items() if data.startswith(magic)), None)


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Size of a JPEG; a hole of zeros in it is found here, the rest by strict decoding."""
    height, width, _, _ = simplejpeg.decode_jpeg_header(data)
    head, mark, scan = data.partition(b"\xff\xda")
    # The standard code has no long run of zeros in a scan of all colours, but decodes one without complaint.
    if mark and STANDARD_HUFFMAN in head and b"\xff\xda" not in scan and ZERO_RUN in scan.rpartition(b"\xff\xd9")[0]:
        raise ValueError("a hole of zeros in the compressed data")
    return int(width), int(height)


def _png_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    offset = len(PNG_MAGIC)
    while offset < len(data):
        if offset + 12 > len(data):
            raise ValueError("cut short")
        (length,) = struct.unpack_from(">I", data, offset)
        body = data[offset + 4 : offset + 8 + length]
        if offset + 12 + length > len(data):
            raise ValueError("cut short")
        if zlib.crc32(body) != int.from_bytes(data[offset + 8 + length : offset + 12 + length], "big"):
            raise ValueError("the checksum of a part does not match")
        yield body[:4], body[4:]
        if body[:4] == b"IEND":
            return
        offset += 12 + length
    raise ValueError("cut short")


def png_size(data: bytes) -> tuple[int, int]:
    """Size of a PNG whose every part is there and has the checksum that belongs to it."""
    parts = _png_chunks(data)
    kind, body = next(parts)
    if kind != b"IHDR" or len(body) != 13:
        raise ValueError("the header is missing")
    width, height = struct.unpack_from(">II", body)
    if all(kind != b"IDAT" for kind, _ in list(parts)):
        raise ValueError("no pixels in it")
    return width, height


def webp_size(data: bytes) -> tuple[int, int]:
    """Size of a WebP; all of its container must be there."""
    if len(data) < 30 or struct.unpack_from("<I", data, 4)[0] + 8 > len(data):
        raise ValueError("cut short")
    kind = data[12:16]
    if kind == b"VP8X":
        return int.from_bytes(data[24:27], "little") + 1, int.from_bytes(data[27:30], "little") + 1
    if kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    width, height = struct.unpack_from("<HH", data, 26)
    return width & 0x3FFF, height & 0x3FFF


def bmp_size(data: bytes) -> tuple[int, int]:
    """Size of a BMP; all of its rows must be there when they are not compressed."""
    if len(data) < 34:
        raise ValueError("cut short")
    start, header, width, height, _, bits, compression = struct.unpack_from("<IIiiHHI", data, 10)
    if header < 40 or width <= 0 or height == 0:
        raise ValueError(f"a header of {header} bytes for {width}x{height} pixels")
    row = (width * bits + 31) // 32 * 4
    if compression == 0 and start + row * abs(height) > len(data):
        raise ValueError("cut short")
    return width, abs(height)


def tiff_size(data: bytes) -> tuple[int, int]:
    """Size of a TIFF's first picture; all of its strips or tiles must be there."""
    order = "<" if data.startswith(b"II") else ">"
    try:
        tags = _tiff_tags(data, order)
        ends = [at + count for at, count in zip(tags[273], tags[279], strict=True)]
        width, height = tags[256][0], tags[257][0]
    except (KeyError, IndexError, ValueError, struct.error) as error:
        raise ValueError("cut short, or no plain picture") from error
    if max(ends) > len(data):
        raise ValueError("cut short")
    return width, height


def _tiff_tags(data: bytes, order: str) -> dict[int, tuple[int, ...]]:
    """Tags of the first directory; those of tiles are given the numbers of the strips'."""
    (start,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, start)
    tags: dict[int, tuple[int, ...]] = {}
    for entry in range(start + 2, start + 2 + 12 * count, 12):
        tag, kind, length = struct.unpack_from(order + "HHI", data, entry)
        if tag in (256, 257, 273, 279, 324, 325) and kind in (3, 4) and 0 < length <= len(data):
            code = f"{order}{length}{'H' if kind == 3 else 'I'}"
            near = struct.calcsize(code) <= 4
            at = entry + 8 if near else struct.unpack_from(order + "I", data, entry + 8)[0]
            tags[{324: 273, 325: 279}.get(tag, tag)] = struct.unpack_from(code, data, at)
    return tags


SIZES: dict[str, Callable[[bytes], tuple[int, int]]] = {
    "jpeg": jpeg_size,
    "png": png_size,
    "webp": webp_size,
    "bmp": bmp_size,
    "tiff": tiff_size,
}
