"""Ignored pixels: filled from beside them, never a defect and never the absence of one, and no place is lost."""

from functools import lru_cache

import cv2
import numpy as np
import pytest

from models.appearance import Appearance
from models.errors import PictureError
from models.frame import Frame
from models.ignored import Ignored
from models.learning import learn
from models.verdict import FrameState, Judgement, ScoredFrame
from tests.models.parts import FIRST, STEP, View, frame, inspected, places, surface, swept, with_spot

ATS = places(last=35)
STAMP = np.s_[70:100, 20:90]
"""Where the camera writes into the picture."""


def mask() -> np.ndarray:
    made = np.zeros((120, 160), bool)
    made[STAMP] = True
    return made


def stamped(frames: list[Frame], seed: int) -> list[Frame]:
    """The frames with strong figures written into them, others on each."""
    rng, written = np.random.default_rng(seed), list[Frame]()
    for each in frames:
        pixels = each.pixels.copy()
        small = rng.choice(np.array([20, 230], np.uint8), (6, 14))
        pixels[STAMP] = cv2.resize(small, (70, 30), interpolation=cv2.INTER_NEAREST)
        written.append(frame(pixels, each.sequence))
    return written


@lru_cache
def masked() -> Appearance:
    return learn([stamped(swept(surface(), ATS), 1)], ignore=mask())


def shows(scored: tuple[ScoredFrame, ...]) -> list[float]:
    """How far each frame is placed from where it is, in frames."""
    assert all(each.state is FrameState.SCORED for each in scored)
    return [abs(each.s * ATS[-1] - at) for each, at in zip(scored, ATS, strict=True)]


@pytest.mark.parametrize("shape", [(120, 160), (120, 160, 3)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_ignored_pixels_are_filled_with_the_nearest_and_the_others_stay(shape: tuple[int, ...], dtype: type):
    picture = np.broadcast_to(np.arange(120).reshape(120, 1, *(1,) * (len(shape) - 2)), shape).astype(dtype)
    before = picture.copy()
    ignored = Ignored.of(mask())
    filled = ignored.filled(picture)
    np.testing.assert_array_equal(picture, before)
    covered = ignored.mask.astype(bool)
    assert covered[mask()].all()
    assert covered.sum() == 34 * 74
    np.testing.assert_array_equal(filled[~covered], picture[~covered])
    # rows from 68 to 101 are covered: their upper edge is filled from above, their lower one from below
    assert np.ravel(filled[70, 50])[0] == 67
    assert np.ravel(filled[99, 50])[0] == 102


def test_without_a_mask_nothing_is_touched():
    picture = np.zeros((120, 160), np.uint8)
    for none in (Ignored.of(None), Ignored.of(np.zeros((120, 160), bool))):
        assert none.filled(picture) is picture
        assert none.laid(picture, picture, np.zeros(3), 4) == (picture, None)


def test_a_mask_over_nearly_all_is_refused():
    nearly = np.ones((120, 160), bool)
    nearly[0, 0] = False
    with pytest.raises(PictureError, match="leaves nothing of a picture of 160x120"):
        Ignored.of(nearly)


@pytest.mark.parametrize("size", [(160, 120), (157, 118)])
def test_where_either_picture_says_nothing_the_expected_is_taken_and_its_cells_are_unseen(size: tuple[int, int]):
    ignored = Ignored.of(mask()[: size[1], : size[0]])
    expected, seen = np.full(size[::-1], 50, np.uint8), np.full(size[::-1], 90, np.uint8)
    laid, unseen = ignored.laid(expected, seen, np.array([-20.0, 8.0, 0.0]), 4)
    # the frame's mask lies 20 pixels to the right of the reference's, and 8 above it
    either = np.zeros((120, 160), bool)
    either[68:102, 18:92] = True
    either[60:94, 38:112] = True
    np.testing.assert_array_equal(laid == 50, either[: size[1], : size[0]])
    cells = either.reshape(30, 4, 40, 4).any(axis=(1, 3))
    np.testing.assert_array_equal(unseen, cells)
    assert (seen == 90).all()


def test_what_changes_under_the_mask_is_no_defect_and_the_place_is_kept():
    result, scored = inspected(masked(), stamped(swept(surface(), ATS, View(dx=0.6, dy=-1, seed=3)), 7))
    assert (result.verdict, result.coverage) == (Judgement.OK, 1.0)
    assert max(each.score for each in scored) < 0.6
    assert max(shows(scored)) < 1
    open_eyed = learn([stamped(swept(surface(), ATS), 1)])
    assert max(each.score for each in inspected(open_eyed, stamped(swept(surface(), ATS), 7))[1]) > 1


def test_a_defect_beside_the_mask_is_found_and_one_that_passes_under_it_is_found_where_it_is_not():
    middle = int(FIRST + STEP * 18)
    for y in (75, 118):
        part = with_spot(surface(), middle, y + 5)
        result, scored = inspected(masked(), stamped(swept(part, ATS, View(seed=3)), 7))
        assert result.verdict is Judgement.NG
        for each in scored:
            for region in each.regions:
                assert abs(region.x + region.width / 2 - (middle - FIRST - STEP * each.index + 79.5)) < 12


def test_a_defect_that_stays_under_the_mask_is_not_seen():
    everywhere = np.zeros((120, 160), bool)
    everywhere[60:110] = True
    appearance = learn([swept(surface(), ATS)], ignore=everywhere)
    # the camera stands over y = 110: row 90 of the picture is y = 140 of the part
    hidden = with_spot(surface(), int(FIRST + STEP * 18), 136)
    beside = with_spot(surface(), int(FIRST + STEP * 18), 80)
    assert inspected(appearance, swept(hidden, ATS, View(seed=3)))[0].verdict is Judgement.OK
    assert inspected(appearance, swept(beside, ATS, View(seed=3)))[0].verdict is Judgement.NG


def test_a_lamp_that_is_out_is_seen_though_the_camera_writes_on():
    black = [frame(np.zeros((120, 160), np.uint8), i) for i in range(12)]
    result, _ = inspected(masked(), stamped(black, 5))
    assert {each.state for each in result.frames} == {FrameState.BLIND}


@pytest.mark.parametrize("view", [View(colour=True), View(deep=True)], ids=["colour", "sixteen bits"])
def test_the_mask_is_kept_with_what_was_learnt_for_every_kind_of_picture(view: View):
    appearance = learn([swept(surface(), places(last=8), view)], ignore=mask())
    again = Appearance.from_bytes(appearance.to_bytes())
    assert again.id == appearance.id
    np.testing.assert_array_equal(again.ignored.mask, appearance.ignored.mask)
    frames = swept(surface(), places(last=8), View(colour=view.colour, deep=view.deep, seed=3))
    assert inspected(again, frames)[0].verdict is Judgement.OK


def test_a_mask_of_another_size_is_refused():
    with pytest.raises(PictureError, match="the don't-care mask is 80x60, the picture 160x120"):
        learn([swept(surface(), ATS)], ignore=np.zeros((60, 80), bool))
