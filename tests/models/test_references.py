"""References: pictures come back as they were kept, in bounded memory, and damaged ones are refused."""

import zlib

import cv2
import numpy as np
import pytest

from models.errors import AppearanceError
from models.frame import kind_of
from models.limits import COARSE, FINE, Limits
from models.references import Reference, References, unpack
from models.registration import Grid, choose_points, smooth
from models.spread import pack
from models.tolerance import cell_size, levels
from tests.models.parts import View, golden, shot, surface


def png(picture: np.ndarray) -> bytes:
    return cv2.imencode(".png", picture)[1].tobytes()


def made(
    pictures: list[np.ndarray], tolerance: tuple[bytes, ...] = (), limits: tuple[Limits, ...] = (FINE,)
) -> References:
    points = np.stack([choose_points(smooth(levels(p))) for p in pictures])
    return References(tuple(map(png, pictures)), points, limits, tolerance or (b"",) * len(pictures))


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
    row, col = np.divmod(Grid.over((160, 120)).points(choose_points(smooth(picture))), 160)
    np.testing.assert_array_equal(reference.template.points[:2], np.stack([col - 79.5, row - 59.5]).astype(np.float32))
    np.testing.assert_array_equal(reference.template.jacobian[3], smooth(picture)[row, col])


@pytest.mark.parametrize("limits", [(FINE,), (FINE, COARSE)], ids=["fine", "fine and coarse"])
def test_what_golden_sweeps_showed_lies_above_the_assumed_limits(limits: tuple[Limits, ...]):
    shown = np.zeros((15, 20, 2 * len(limits)), np.float32)
    shown[7, 10, 0], shown[3, 4, -1] = 1.5, 0.25
    reference = made([np.full((60, 80), 100, np.uint8)], (pack(shown),), limits).get(0)
    np.testing.assert_array_equal(reference.allowed, 1 + shown)
    assert len(reference.thresholds) == len(limits)
    assert (reference.coarse is not None) == (len(limits) == 2)


def test_where_no_golden_sweep_came_by_the_assumed_limits_stand():
    reference = made([np.full((60, 80, 3), 100, np.uint8)], limits=(Limits(5.0, 0.1, 2.0),)).get(0)
    assert reference.allowed is None
    np.testing.assert_array_equal(reference.thresholds[0], np.full((15, 20), 10.0))


def test_asking_again_gives_the_same_reference():
    references = golden().references
    key = golden().keys[3]
    assert references.get(key) is references.get(key)


def test_more_pictures_than_are_held_are_read_again():
    plain = np.full((1500, 2000), 90, np.uint8)
    plain[400:900, 300:700] = 200
    count = 30
    points = np.tile(choose_points(smooth(plain)), (count, 1))
    references = References((png(plain),) * count, points, (FINE,), (b"",) * count)
    first = references.get(0).picture.copy()
    for i in range(count):
        references.get(i)
    assert references.get.cache_info().currsize < count
    np.testing.assert_array_equal(references.get(0).picture, first)


def held(reference: Reference) -> int:
    """Bytes of all that is kept of one reference picture."""
    parts = (reference, reference.band, reference.template, reference.coarse)
    kept = [value for part in parts if part is not None for value in vars(part).values()]
    arrays = [each for value in kept for each in (value if isinstance(value, list | tuple) else [value])]
    # the band holds the reference picture itself
    return sum({id(array): array.nbytes for array in arrays if isinstance(array, np.ndarray)}.values())


@pytest.mark.parametrize("limits", [(FINE,), (FINE, COARSE)], ids=["one sweep", "more sweeps"])
@pytest.mark.parametrize("size", [(640, 480), (1280, 960)])
@pytest.mark.parametrize("view", [View(), View(colour=True), View(deep=True)], ids=["grey", "colour", "deep"])
def test_what_is_held_at_most_fits_in_its_bound(view: View, size: tuple[int, int], limits: tuple[Limits, ...]):
    picture = cv2.resize(shot(surface(), 150.0, view), size)
    cell = cell_size(size)
    showed = pack(np.zeros((size[1] // cell, size[0] // cell, 2 * len(limits)), np.float32))
    references = made([picture], (showed if len(limits) > 1 else b"",), limits)
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
    references = References((png(good), bad), points, (FINE,), (b"", b""))
    with pytest.raises(AppearanceError, match=r"picture .*cannot be decoded"):
        references.get(1)


GOOD = shot(surface(), 150.0)


def beside_a_good_one(picture: np.ndarray = GOOD, tolerance: bytes = b"") -> References:
    """Two references, of which the second one is this."""
    points = np.stack([choose_points(smooth(GOOD))] * 2)
    return References((png(GOOD), png(picture)), points, (FINE,), (b"", tolerance))


@pytest.mark.parametrize(
    "picture",
    [GOOD[:, :100], cv2.merge([GOOD] * 3), GOOD.astype(np.uint16) * 257],
    ids=["another size", "colour", "sixteen bits"],
)
def test_a_later_picture_of_another_kind_is_refused_when_it_is_needed_and_the_others_still_serve(picture: np.ndarray):
    references = beside_a_good_one(picture)
    np.testing.assert_array_equal(references.get(0).picture, GOOD)
    with pytest.raises(
        AppearanceError, match=f"reference picture of place 1 is {kind_of(picture)}, .* 160x120 grey 8 bit"
    ):
        references.get(1)


@pytest.mark.parametrize(
    "tolerance",
    [
        b"no picture",
        png(np.zeros((30, 40), np.uint8)),
        png(np.zeros((60, 30), np.uint8)),
        png(np.zeros((60, 40, 3), np.uint8)),
        png(np.zeros((60, 40), np.uint16)),
    ],
    ids=["none", "half of it", "another size", "colour", "sixteen bits"],
)
def test_a_tolerance_that_is_no_map_of_the_cells_is_refused(tolerance: bytes):
    with pytest.raises(AppearanceError, match=r"tolerance of place 1 cannot be read: .* no map of 30 x 40 cells"):
        beside_a_good_one(tolerance=tolerance).get(1)


@pytest.mark.parametrize(
    ("kind", "picture"),
    [(".png", np.zeros((60, 80, 4), np.uint8)), (".tiff", np.zeros((60, 80), np.float32))],
    ids=["with transparency", "of fractions"],
)
def test_a_picture_that_no_camera_gives_is_refused(kind: str, picture: np.ndarray):
    with pytest.raises(AppearanceError, match="cannot be decoded"):
        unpack(cv2.imencode(kind, picture)[1].tobytes())


def test_a_picture_that_claims_to_be_enormous_is_refused():
    data = bytearray(png(np.zeros((60, 80), np.uint8)))
    data[16:24] = (2**20).to_bytes(4, "big") * 2
    data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    with pytest.raises(AppearanceError, match="cannot be decoded"):
        unpack(bytes(data))


def test_points_that_all_lie_in_one_row_are_refused():
    low = GOOD[:10, :80]
    points = np.zeros((1, len(choose_points(smooth(low)))), np.uint8)
    references = References((png(low),), points, (FINE,), (b"",))
    with pytest.raises(AppearanceError, match="points of place 0"):
        references.get(0)
