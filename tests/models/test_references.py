"""References: pictures come back as they were kept, in bounded memory, and damaged ones are refused."""

import cv2
import numpy as np
import pytest

from models.errors import AppearanceError
from models.frame import kind_of
from models.references import Reference, References
from models.registration import choose_points, smooth
from models.tolerance import levels
from tests.models.parts import View, golden, shot, surface


def png(picture: np.ndarray) -> bytes:
    return cv2.imencode(".png", picture)[1].tobytes()


def made(pictures: list[np.ndarray], excess: tuple[bytes, ...] = ()) -> References:
    points = np.stack([choose_points(smooth(levels(p))) for p in pictures])
    return References(tuple(map(png, pictures)), points, excess or (b"",) * len(pictures))


@pytest.mark.parametrize("view", [View(), View(colour=True), View(deep=True)])
def test_a_picture_comes_back_in_grey_levels(view: View):
    pictures = [shot(surface(), 150.0 + 20 * i, view) for i in range(3)]
    references = made(pictures)
    assert (references.size, references.kind) == ((160, 120), kind_of(pictures[0]))
    for i, picture in enumerate(pictures):
        found = references.get(i).picture
        np.testing.assert_allclose(found, picture / (257 if view.deep else 1), atol=1e-3)


def test_the_template_is_that_of_the_picture_at_the_points_kept():
    picture = shot(surface(), 150.0)
    reference = made([picture]).get(0)
    row, col = np.divmod(choose_points(smooth(picture)), 160)
    np.testing.assert_array_equal(reference.template.points[:2], np.stack([col - 79.5, row - 59.5]).astype(np.float32))
    np.testing.assert_array_equal(reference.template.jacobian[3], smooth(picture)[row, col])


def test_what_good_parts_showed_is_allowed_beside_it_too_and_bright_lies_above_dark():
    excess = np.zeros((120, 80), np.uint8)
    excess[30, 40], excess[60 + 10, 20] = 25, 15
    references = made([np.full((60, 80), 100, np.uint8)], (png(excess),))
    np.testing.assert_array_equal(references.excess(0), excess.reshape(2, 60, 80))
    bright, dark = references.get(0).band.more
    assert [tuple(np.argwhere(part).min(axis=0)) for part in (bright, dark)] == [(29, 39), (9, 19)]
    assert (bright.sum(), dark.sum()) == (9 * 25, 9 * 15)


def test_where_good_parts_showed_nothing_nothing_more_is_allowed():
    references = made([np.full((60, 80, 3), 100, np.uint8)])
    assert references.get(0).band.more is None
    assert references.excess(0).shape == (2, 60, 80, 3)
    assert not references.excess(0).any()


def test_asking_again_gives_the_same_reference():
    references = golden().references
    assert references.get(3) is references.get(3)


def test_more_pictures_than_are_held_are_read_again():
    plain = np.full((1500, 2000), 90, np.uint8)
    plain[400:900, 300:700] = 200
    count = 30
    references = References((png(plain),) * count, np.tile(choose_points(smooth(plain)), (count, 1)), (b"",) * count)
    first = references.get(0).picture.copy()
    for i in range(count):
        references.get(i)
    assert references.get.cache_info().currsize < count
    np.testing.assert_array_equal(references.get(0).picture, first)


def held(reference: Reference) -> int:
    """Bytes of all that is kept of one reference picture."""
    kept = [value for part in (reference, reference.band, reference.template) for value in vars(part).values()]
    arrays = [each for value in kept for each in (value if isinstance(value, list | tuple) else [value])]
    # the band holds the reference picture itself
    return sum({id(array): array.nbytes for array in arrays if isinstance(array, np.ndarray)}.values())


@pytest.mark.parametrize("widened", [False, True], ids=["one sweep", "more sweeps"])
@pytest.mark.parametrize("size", [(640, 480), (1280, 960)])
@pytest.mark.parametrize("view", [View(), View(colour=True), View(deep=True)], ids=["grey", "colour", "deep"])
def test_what_is_held_at_most_fits_in_its_bound(view: View, size: tuple[int, int], widened: bool):
    picture = cv2.resize(shot(surface(), 150.0, view), size)
    excess = png(np.zeros((2 * size[1], *picture.shape[1:]), np.uint8)) if widened else b""
    references = made([picture], (excess,))
    most = references.get.cache_info().maxsize
    # 192 MiB of pictures; what else is held of them is a tenth at most
    assert most * held(references.get(0)) <= 1.1 * 192 * 2**20


@pytest.mark.parametrize(
    "bad",
    [
        b"",
        b"no picture at all",
        png(np.zeros((60, 80), np.uint8))[:40],
    ],
)
def test_a_picture_that_cannot_be_decoded_is_refused(bad: bytes):
    good = np.random.default_rng(1).integers(0, 256, (60, 80), np.uint8)
    points = np.stack([choose_points(good)] * 2)
    references = References((png(good), bad), points, (b"", b""))
    with pytest.raises(AppearanceError, match=r"picture .*cannot be decoded"):
        references.get(1)
