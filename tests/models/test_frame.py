"""Frame: what kinds of picture there are, and that no other passes."""

import numpy as np
import pytest

from models.errors import PictureError
from models.frame import Frame


@pytest.mark.parametrize(
    ("shape", "of", "kind"),
    [
        ((3, 4), np.uint8, "4x3 grey 8 bit"),
        ((3, 4), np.uint16, "4x3 grey 16 bit"),
        ((3, 4, 3), np.uint8, "4x3 colour 8 bit"),
        ((1, 1, 3), np.uint16, "1x1 colour 16 bit"),
    ],
)
def test_size_colour_and_depth_make_the_kind(shape: tuple[int, ...], of: type, kind: str):
    frame = Frame(np.zeros(shape, of), t_ns=0, sequence=0)
    assert (frame.kind, frame.size) == (kind, (shape[1], shape[0]))


@pytest.mark.parametrize(
    ("pixels", "sentence"),
    [
        (np.zeros((3, 4), np.float32), "frame 7: pixels are float32, allowed are uint8 and uint16"),
        (np.zeros((3, 4), bool), "frame 7: pixels are bool"),
        (np.zeros((3, 4, 4), np.uint8), r"frame 7: shape \(3, 4, 4\), allowed are"),
        (np.zeros((3,), np.uint8), r"frame 7: shape \(3,\)"),
        (np.zeros((0, 4), np.uint8), r"frame 7: shape \(0, 4\)"),
    ],
)
def test_pixels_of_another_type_or_shape_are_refused_by_frame(pixels: np.ndarray, sentence: str):
    with pytest.raises(PictureError, match=sentence):
        Frame(pixels, t_ns=0, sequence=7)


def test_pixels_cannot_be_written_to_through_the_frame_and_the_callers_stay_his():
    pixels = np.zeros((3, 4), np.uint8)
    frame = Frame(pixels, t_ns=0, sequence=0)
    with pytest.raises(ValueError, match="read-only"):
        frame.pixels[0, 0] = 1
    assert pixels.flags.writeable
