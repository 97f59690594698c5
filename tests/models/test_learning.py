"""Learning: the same sweeps give the same bytes, and what cannot be learnt from is refused with a sentence."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest

from models.appearance import Appearance
from models.errors import LearningError, PictureError, SweepsDiffer
from models.frame import EncodedPicture, Frame
from models.inspection import begin, conclude, step
from models.learning import absorb, learn, left_out
from models.preparation import Preparation, Window
from models.scoring import look, remember
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
        ([swept(surface(), SHORT), []], "golden sweep 2 fits the reference sweep in 0 of 12 places"),
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
    with pytest.raises(PictureError, match="frame 0 of golden sweep 2"):
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


ATS = places(last=25)
OVER = FIRST + STEP * 12
"""Where the camera is over the middle of a short sweep."""


@lru_cache
def individual(unit: int) -> list[Frame]:
    """A short sweep of a good part of its own: another mark on each."""
    x, y = int(OVER) - 40 + 23 * (unit % 4), 90 + 17 * (unit % 3)
    return swept(with_spot(surface(), x, y, 8, 14), ATS, View(seed=unit))


@lru_cache
def defective(seed: int = 30) -> list[Frame]:
    """A short sweep of a part with something on it that the good ones do not have."""
    return swept(with_spot(surface(), int(OVER), 110, 14, 120), ATS, View(seed=seed))


def without_facts(appearance: Appearance) -> bytes:
    return replace(appearance, facts={}).to_bytes()


def highest(appearance: Appearance, frames: list[Frame]) -> float:
    return max(scored.score for scored in inspected(appearance, frames)[1])


def test_what_a_further_golden_sweep_shows_is_tolerated_from_then_on():
    marked = with_spot(surface(), int(OVER), 110, 10, 30)
    one = learn([swept(surface(), ATS)])
    two = learn([swept(surface(), ATS), swept(marked, ATS, View(seed=1))])
    frames = swept(marked, ATS, View(seed=3))
    # against what is tolerated, a score of q becomes q / (1 + q)
    assert highest(one, frames) > 1
    assert highest(two, frames) < 1
    assert two.peaks[0] == pytest.approx(highest(one, frames), rel=0.2)
    assert (one.peaks, len(one.limits), len(two.limits)) == ((), 1, 1)


@pytest.mark.parametrize("sweeps", [1, 3], ids=["fine", "fine and coarse"])
def test_scores_go_with_one_over_the_factor(sweeps: int):
    appearance = learn([individual(i) for i in range(sweeps)])
    assert len(appearance.limits) == (2 if sweeps > 2 else 1)
    for scored in zip(*(looked(appearance, factor) for factor in (0.8, 1.0)), strict=True):
        strict, loose = (float(each) for each in scored)
        assert 0.8 * strict == pytest.approx(loose, rel=1e-4, abs=1e-6) or loose < 0.5


def looked(appearance: Appearance, factor: float) -> Iterator[float]:
    """The score of each frame of a defective part at a factor of the limits."""
    memory = remember(appearance)
    for each in defective():
        memory, seen = look(appearance, factor, memory, each)
        assert seen is not None
        assert seen.score is not None
        yield seen.score.max()


@pytest.mark.parametrize("at", [1, 3], ids=["second", "last"])
def test_a_defective_sweep_among_golden_ones_is_named_and_leaves_nothing_behind(at: int):
    good = [individual(i) for i in range(4)]
    found = learn([*good[:at], defective(), *good[at:]])
    (odd,) = left_out(found)
    assert (found.facts["left_out"], odd.sweep, found.facts["sweeps"]) == (str(at), at, "4")
    assert odd.reached > 5
    assert odd.usual < 2
    assert without_facts(found) == without_facts(learn(good))
    assert inspected(found, defective())[0].verdict is Judgement.NG
    assert left_out(learn(good)) == ()


def test_where_the_first_sweep_is_the_defective_one_the_second_becomes_the_reference():
    good = [individual(i) for i in range(3)]
    found = learn([defective(), *good])
    assert [each.sweep for each in left_out(found)] == [0]
    assert without_facts(found) == without_facts(learn(good))


def test_no_more_than_a_third_of_the_sweeps_is_left_out():
    one, other = defective(), swept(with_spot(surface(), int(OVER) + 30, 90, 14, -120), ATS, View(seed=31))
    assert [each.sweep for each in left_out(learn([*(individual(i) for i in range(4)), one, other]))] == [4, 5]
    assert [each.sweep for each in left_out(learn([*(individual(i) for i in range(3)), one, other]))] != [3, 4]


def test_two_golden_sweeps_that_differ_by_a_plain_defect_are_refused():
    with pytest.raises(SweepsDiffer, match=r"two golden sweeps differ by \d+\.\d times what is assumed"):
        learn([individual(0), defective()])


def test_what_is_learnt_does_not_depend_on_the_order_of_the_further_sweeps():
    first, *others = (individual(i) for i in range(4))
    one, two = learn([first, *others]), learn([first, *others[::-1]])
    assert one.tolerance == two.tolerance
    assert one.peaks == pytest.approx(two.peaks[::-1])


@pytest.mark.parametrize("before", [1, 3])
def test_a_sweep_absorbed_is_tolerated_as_if_it_had_been_learnt_from(before: int):
    sweeps = [individual(i) for i in range(before + 1)]
    old, whole = learn(sweeps[:-1]), learn(sweeps)
    read = list[Frame]()

    def streamed() -> Iterator[Frame]:
        for each in sweeps[-1]:
            read.append(each)
            yield each

    new = absorb(old, streamed())
    assert new.tolerance == whole.tolerance
    np.testing.assert_array_equal(new.reached, whole.reached)
    assert len(read) == len(sweeps[-1])
    assert (new.peaks[:-1], len(new.peaks)) == (old.peaks, before)
    assert new.id not in (old.id, whole.id)
    assert (new.facts["sweeps"], new.facts["added_to"]) == (str(before + 1), old.id)
    assert Appearance.from_bytes(new.to_bytes()).id == new.id == absorb(old, sweeps[-1]).id
    assert highest(new, sweeps[-1]) <= highest(old, sweeps[-1])


def test_progress_of_absorbing_grows_to_one():
    told = list[float]()
    absorb(learn([individual(0)]), individual(1), told.append, frames_expected=len(ATS))
    assert told == sorted(told)
    assert (told[0], told[-1]) == (pytest.approx(1 / len(ATS)), 1.0)


@pytest.mark.parametrize(("before", "sentence"), [(1, "may reach 5.0"), (4, r"usually reach \d\.\d")])
def test_a_defective_sweep_is_not_absorbed(before: int, sentence: str):
    old = learn([individual(i) for i in range(before)])
    with pytest.raises(LearningError, match=f"the sweep reaches .*, where golden sweeps {sentence}: .*defective"):
        absorb(old, defective())


@pytest.mark.parametrize(
    ("frames", "sentence"),
    [([], "in 0 of 26 places"), (swept(surface(2), ATS), "is it the same product"), (swept(surface(), SHORT), "in 12")],
    ids=["empty", "another part", "short"],
)
def test_a_sweep_that_does_not_fit_is_not_absorbed(frames: list[Frame], sentence: str):
    with pytest.raises(LearningError, match=f"the sweep fits the reference sweep .*{sentence}"):
        absorb(learn([individual(0)]), frames)


def test_pictures_of_another_kind_are_not_absorbed():
    with pytest.raises(PictureError, match="frame 0 of the sweep is 160x120 colour"):
        absorb(learn([individual(0)]), swept(surface(), SHORT, View(colour=True)))


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
