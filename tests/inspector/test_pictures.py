"""Pictures come out as they went in, or not at all."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inspector.errors import PictureTooLarge, PictureUnreadable
from inspector.pictures import decode, encode_jpeg, encode_png
from models.frame import EncodedPicture


def scene(shape: tuple[int, ...], kind: type = np.uint8) -> np.ndarray:
    noise = np.random.default_rng(5).integers(0, 256, shape, dtype=np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 1.5).astype(kind) * (kind(257) if kind is np.uint16 else kind(1))


def encoded(extension: str, picture: np.ndarray) -> bytes:
    return cv2.imencode(extension, picture)[1].tobytes()


KINDS = {
    "jpeg": encode_jpeg(scene((40, 57, 3)), 90).data,
    "png": encode_png(scene((40, 57, 3))).data,
    "webp": encoded(".webp", scene((40, 57, 3))),
    "bmp": encoded(".bmp", scene((40, 57, 3))),
    "tiff": encoded(".tiff", scene((40, 57, 3))),
}


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(1, 1), (7, 13), (7, 13, 3)])
def test_png_keeps_every_pixel(shape, kind):
    picture = scene(shape, kind)
    back = decode(encode_png(picture))
    assert back.dtype == kind
    assert np.array_equal(back, picture)


@pytest.mark.parametrize("shape", [(32, 48), (32, 48, 3)])
def test_jpeg_stays_grey_or_coloured_and_close(shape):
    picture = cv2.GaussianBlur(scene(shape), (0, 0), 4)
    back = decode(encode_jpeg(picture, 95))
    assert back.shape == picture.shape
    assert np.abs(back.astype(int) - picture).mean() < 3


def test_colours_are_blue_green_red():
    blue = np.zeros((16, 16, 3), np.uint8)
    blue[:, :, 0] = 250
    for picture in (encode_jpeg(blue), encode_png(blue), EncodedPicture("bmp", encoded(".bmp", blue))):
        assert decode(picture)[8, 8].argmax() == 0


def test_the_bytes_decide_and_not_the_name():
    assert decode(EncodedPicture("jpeg", KINDS["png"])).shape == (40, 57, 3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_picture_cut_anywhere_is_refused(kind):
    data = KINDS[kind]
    whole = decode(EncodedPicture(kind, data))
    for length in range(len(data)):
        try:
            assert np.array_equal(decode(EncodedPicture(kind, data[:length])), whole), length
        except PictureUnreadable:
            continue
        assert length >= len(data) - 2  # padding at the very end


def test_a_hole_of_zeros_in_a_jpeg_is_refused():
    data = encode_jpeg(scene((96, 128, 3)), 90).data
    start = data.index(b"\xff\xda") + 14
    for size in (64, 512):
        for at in range(start, len(data) - size - 2, 97):
            with pytest.raises(PictureUnreadable):
                decode(EncodedPicture("jpeg", data[:at] + bytes(size) + data[at + size :]))


def test_a_piece_missing_from_a_jpeg_is_refused():
    data = encode_jpeg(scene((96, 128, 3)), 90).data
    middle = (data.index(b"\xff\xda") + len(data)) // 2
    for size in (50, 500):
        with pytest.raises(PictureUnreadable):
            decode(EncodedPicture("jpeg", data[:middle] + data[middle + size :]))


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_a_flat_jpeg_is_not_taken_for_a_hole(grey):
    for shape in ((240, 320), (240, 320, 3)):
        assert np.ptp(decode(encode_jpeg(np.full(shape, grey, np.uint8)))) == 0


@given(st.integers(0, 8 * len(KINDS["png"]) - 1))
def test_a_bit_flipped_in_a_png_never_gives_another_picture(bit):
    data = bytearray(KINDS["png"])
    data[bit // 8] ^= 1 << bit % 8
    with pytest.raises(PictureUnreadable):
        decode(EncodedPicture("png", bytes(data)))


def test_a_png_bomb_is_refused_from_its_header():
    def part(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + part(b"IHDR", header) + part(b"IDAT", zlib.compress(bytes(1000))) + part(b"IEND", b"")
    with pytest.raises(PictureTooLarge, match="60000x60000 pixels announced, allowed are"):
        decode(EncodedPicture("png", bomb))


@pytest.mark.parametrize("kind", KINDS)
def test_the_limit_of_pixels_holds_for_every_kind(kind):
    picture = EncodedPicture(kind, KINDS[kind])
    assert decode(picture, max_pixels=40 * 57).shape == (40, 57, 3)
    with pytest.raises(PictureTooLarge, match="57x40"):
        decode(picture, max_pixels=40 * 57 - 1)


@pytest.mark.parametrize("data", [b"", b"GIF89a", b"hello", bytes(100)])
def test_an_unknown_kind_is_refused_with_what_is_allowed(data):
    with pytest.raises(PictureUnreadable, match="allowed are jpeg, png, webp, bmp, tiff"):
        decode(EncodedPicture("gif", data))


@given(st.binary(max_size=200), st.sampled_from([data[:30] for data in KINDS.values()]))
def test_rubbish_is_refused_with_one_sentence(rubbish, head):
    with pytest.raises(PictureUnreadable) as caught:
        decode(EncodedPicture("", head + rubbish))
    assert "\n" not in str(caught.value)


def test_jpeg_of_16_bits_is_refused():
    with pytest.raises(PictureUnreadable, match="uint16, allowed is uint8"):
        encode_jpeg(scene((8, 8), np.uint16))
