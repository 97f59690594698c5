"""Learning: the same sweeps give the same bytes, and what cannot be learnt from is refused with a sentence."""

from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from models.errors import LearningError, PictureError
from models.frame import EncodedPicture, Frame
from models.inspection import begin, conclude, step
from models.learning import learn
from models.preparation import Preparation, Window
from models.verdict import Judgement
from tests.models.parts import (
    FIRST,
    FRAMES,
    INTERVAL_NS,
    STEP,
    View,
    frame,
    golden,
    inspected,
    places,
    shot,
    surface,
    swept,
    with_spot,
)

SHORT = places(last=11)
GREY = np.full((120, 160), 90, np.uint8)


def grey_frames(count: int) -> list[Frame]:
    return [frame(GREY, i) for i in range(count)]


def test_the_same_sweeps_give_the_same_bytes():
    sweeps = [swept(surface(), SHORT), swept(surface(), SHORT, View(dy=1, seed=1))]
    assert learn(sweeps).to_bytes() == learn(sweeps).to_bytes()


def test_each_sweep_is_read_once_and_may_be_gone_then():
    def streamed(seed: int) -> Iterator[Frame]:
        yield from swept(surface(), SHORT, View(seed=seed))

    kept = learn([swept(surface(), SHORT, View(seed=seed)) for seed in (0, 1)])
    assert learn([streamed(0), streamed(1)]).id == kept.id


def test_every_frame_that_moved_is_a_place_and_the_motion_is_that_of_the_picture():
    appearance = golden()
    assert appearance.places == FRAMES
    np.testing.assert_allclose(appearance.s, np.linspace(0, 1, FRAMES), atol=0.005)
    np.testing.assert_allclose(appearance.motion, np.tile([-STEP, 0], (FRAMES, 1)), atol=0.15)
    assert appearance.interval_ns == INTERVAL_NS
    assert (appearance.facts["sweeps"], appearance.facts["frames"]) == ("2", str(FRAMES))


def test_a_slow_sweep_keeps_fewer_places_and_still_finds_them():
    ats = places(0.1, last=20)
    slow = learn([swept(surface(), ats)])
    assert 20 < slow.places < len(ats) / 2
    travelled = np.cumsum(slow.motion[:-1], axis=0)[-1]
    np.testing.assert_allclose(travelled, [-20 * STEP, 0], atol=2)
    result, _ = inspected(slow, swept(surface(), places(0.2, last=20), View(seed=2)))
    assert result.verdict is Judgement.OK


def test_a_standstill_in_the_sweep_adds_no_place():
    ats = np.concatenate([places(last=10), np.full(20, 10.0), places(first=11, last=20)])
    assert learn([swept(surface(), ats)]).places == 21


def test_frames_that_show_nothing_are_passed_over():
    frames = swept(surface(), SHORT)
    frames[0], frames[11] = frame(GREY, 0), frame(np.zeros_like(GREY), 11)
    assert learn([frames]).places == 10


@pytest.mark.parametrize(
    ("sweeps", "sentence"),
    [
        ([], "no golden sweep given"),
        ([[]], "reference sweep holds no frame"),
        ([swept(surface(), [3.0])], r"1 place\(s\) in 1 frame"),
        ([grey_frames(20)], r"0 place\(s\) in 20 frame.*one grey"),
        ([swept(surface(), np.full(20, 3.0))], r"1 place\(s\) in 20 frame.*standstills"),
        ([swept(surface(), SHORT), []], "further golden sweep fits the reference sweep in 0 of 12 places"),
        ([swept(surface(), SHORT), swept(surface(2), SHORT)], "is it the same product"),
        ([swept(surface(), SHORT), grey_frames(12)], "in 0 of 12 places"),
        ([swept(surface()), swept(surface(), SHORT)], "in 12 of 60 places"),
    ],
    ids=[
        "none",
        "empty",
        "one frame",
        "one grey",
        "standstill",
        "then empty",
        "then another",
        "then grey",
        "then short",
    ],
)
def test_what_teaches_nothing_is_refused_with_a_sentence(sweeps: list[list[Frame]], sentence: str):
    with pytest.raises(LearningError, match=sentence):
        learn(sweeps)


def mixed(view: View, at: int) -> list[Frame]:
    """A short sweep whose pictures change at one frame."""
    frames = swept(surface(), SHORT)
    return frames[:at] + swept(surface(), SHORT, view)[at:]


@pytest.mark.parametrize(
    ("view", "sentence"),
    [
        (View(size=(80, 60)), "frame 6 .* is 80x60 grey 8 bit, .* 160x120 grey 8 bit"),
        (View(colour=True), "frame 6 .* is 160x120 colour 8 bit"),
        (View(deep=True), "frame 6 .* is 160x120 grey 16 bit"),
    ],
    ids=["size", "colour", "depth"],
)
def test_pictures_that_change_within_the_sweep_are_refused_by_frame(view: View, sentence: str):
    with pytest.raises(PictureError, match=sentence):
        learn([mixed(view, 6)])


@pytest.mark.parametrize(
    ("first", "then"),
    [
        (View(), View(size=(80, 60))),
        (View(), View(colour=True)),
        (View(colour=True), View()),
        (View(), View(deep=True)),
        (View(deep=True), View()),
    ],
    ids=["size", "grey then colour", "colour then grey", "8 then 16 bit", "16 then 8 bit"],
)
def test_a_further_sweep_of_other_pictures_is_refused(first: View, then: View):
    with pytest.raises(PictureError, match="frame 0 of a further golden sweep"):
        learn([swept(surface(), SHORT, first), swept(surface(), SHORT, then)])


@pytest.mark.parametrize("size", [(5, 5), (8, 6), (12, 10), (16, 12), (400, 4), (4, 100)])
def test_tiny_pictures_are_refused_with_what_is_needed(size: tuple[int, int]):
    with pytest.raises(LearningError, match=f"{size[0]}x{size[1]} grey 8 bit are too small; at least some 24x18"):
        learn([swept(surface(), SHORT, View(size=size))])


@pytest.mark.parametrize("size", [(24, 18), (40, 30)])
def test_small_pictures_are_learnt_and_inspected(size: tuple[int, int]):
    learnt = learn([swept(surface(), SHORT, View(size=size))])
    assert (learnt.size, learnt.places) == (size, len(SHORT))
    assert inspected(learnt, swept(surface(), SHORT, View(size=size, seed=3)))[0].verdict is Judgement.OK


@pytest.mark.parametrize("view", [View(), View(colour=True), View(deep=True)], ids=["grey", "colour", "deep"])
def test_every_kind_of_picture_is_learnt_and_good_and_bad_parts_told_apart(view: View):
    appearance = learn([swept(surface(), places(last=25), view)])
    good = swept(surface(), places(last=25), View(colour=view.colour, deep=view.deep, seed=4))
    bad = swept(with_spot(surface(), 160, 110), places(last=25), view)
    assert inspected(appearance, good)[0].verdict is Judgement.OK
    assert inspected(appearance, bad)[0].verdict is Judgement.NG


def test_what_a_further_golden_sweep_shows_is_allowed_from_then_on():
    ats = places(last=25)
    marked = with_spot(surface(), 160, 110, 10, 30)
    one = learn([swept(surface(), ats)])
    two = learn([swept(surface(), ats), swept(marked, ats, View(seed=1)), swept(surface(), ats, View(seed=2))])
    frames = swept(marked, ats, View(seed=3))
    peaks = [max(scored.score for scored in inspected(learnt, frames)[1]) for learnt in (one, two)]
    assert peaks[0] > 1
    assert peaks[1] < 0.3 * peaks[0]
    assert two.limits.good_peak > 1


def test_golden_sweeps_that_differ_by_a_plain_defect_are_refused():
    ats = places(last=25)
    marked = with_spot(surface(), 160, 110, 14, 120)
    with pytest.raises(LearningError, match=r"differ from the reference sweep by \d+\.\d times what is allowed"):
        learn([swept(surface(), ats), swept(marked, ats, View(seed=1))])


def test_pictures_are_kept_as_they_came():
    frames = list[Frame]()
    for i, at in enumerate(SHORT):
        data = cv2.imencode(".jpg", shot(surface(), FIRST + STEP * at), [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
        pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
        frames.append(Frame(pixels, i * INTERVAL_NS, i, encoded=EncodedPicture("jpeg", data.tobytes())))
    appearance = learn([frames])
    assert list(appearance.pictures) == [frames[key].encoded.data for key in appearance.keys]
    np.testing.assert_array_equal(appearance.references.get(4).picture, frames[4].pixels)


def test_pictures_are_kept_where_the_camera_has_moved_on_by_a_twentieth():
    appearance = learn([swept(surface(), places(0.4, last=20))])
    # four pixels a place, at 0.4 of the pace, in pictures 160 wide: five places make eight pixels
    assert appearance.keys.tolist() == [*range(0, 50, 5), 50]
    assert len(appearance.pictures) == len(appearance.points) == 11


def test_where_pictures_change_without_moving_all_are_kept():
    turning = [shot(surface(), FIRST + STEP * (FRAMES - 1) / 2, View(turn=0.03 * i), i) for i in range(12)]
    strangers = [shot(surface(10 + i), FIRST) for i in range(12)]
    for pictures in (turning, strangers):
        appearance = learn([[frame(picture, i) for i, picture in enumerate(pictures)]])
        assert appearance.keys.tolist() == list(range(12))


def test_a_preparation_of_ones_own_is_kept():
    own = Preparation(windows=(Window(20, 20, 60, 40),), content="smooth", unit_energy=False)
    appearance = learn([swept(surface(), SHORT)], preparation=own)
    assert appearance.preparation.windows == own.windows
    assert (appearance.preparation.content, appearance.eigenspace.mean.size) == ("smooth", 60 * 40)


def test_progress_grows_to_one_and_needs_the_number_of_frames():
    told = list[float]()
    learn([swept(surface(), SHORT), swept(surface(), SHORT, View(seed=1))], told.append, frames_expected=24)
    assert told == sorted(told)
    assert (told[0], told[-1], len(told) >= 12) == (pytest.approx(1 / 24), 1.0, True)


def test_a_preparation_for_other_pictures_is_refused():
    with pytest.raises(PictureError, match="window 60x40 at"):
        learn([swept(surface(), SHORT)], preparation=Preparation(windows=(Window(150, 20, 60, 40),)))


def test_times_that_stand_still_are_borne():
    frames = [Frame(each.pixels, 5, each.sequence) for each in swept(surface(), SHORT)]
    appearance = learn([frames])
    assert appearance.interval_ns == 0
    state = begin(appearance)
    for each in frames:
        state, _ = step(state, each)
    assert conclude(state).verdict is Judgement.OK
