"""The simulated camera: the same bytes for the same url, faults on request, and a truth that holds in the pictures."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest

from inspector.cameras import Clock, open_camera
from inspector.cameras.base import CameraNotOpened, OptionRefused
from inspector.cameras.simulated import SimulatedCamera
from inspector.cameras.simulated.camera import START_NS
from inspector.cameras.simulated.defects import KINDS
from inspector.cameras.simulated.render import Pose
from tests.contracts.cameras import CameraContract

EXACT = "simulated:?size=160x120&jpeg=0&noise=0&vibration=0&jitter=0&drift=0"
"""Nothing left to chance: small and raw."""


def opened(options: str = "", clock: Clock | None = None) -> SimulatedCamera:
    """An exact camera, but for the options."""
    camera = open_camera(f"{EXACT}&{options}".rstrip("&"), clock)
    assert isinstance(camera, SimulatedCamera)
    return camera


def pixels(options: str = "") -> np.ndarray:
    """All frames of an exact sweep, as numbers that can be subtracted."""
    return np.stack([frame.pixels for frame in opened(options).frames()]).astype(np.int16)


class TestSimulatedContract(CameraContract):
    @pytest.fixture
    def url(self) -> str:
        options = "part=board&colour=1&unit=3&defect=2&pace=0.2&lost=0.1&place=2,-1,0.3&blur=3&encoder=1&frames=40"
        return f"simulated:?size=96x72&seed=5&{options}"


class TestRawSimulatedContract(CameraContract):
    @pytest.fixture
    def url(self) -> str:
        return "simulated:?size=64x48&jpeg=0&path=arc&frames=12"


@pytest.mark.parametrize("part", ["plate", "board", "casting"])
def test_the_default_sweep_is_grey_jpeg_of_two_to_three_hundred_frames(part: str) -> None:
    with open_camera(f"simulated:?part={part}") as camera:
        frame = next(camera.frames())
        assert isinstance(camera, SimulatedCamera)
        assert 200 <= len(camera.truth()) <= 300
    assert (frame.size, frame.pixels.ndim) == ((320, 240), 2)
    assert frame.encoded is not None
    assert frame.encoded.format == "jpeg"
    assert 40 < frame.pixels.mean() < 200
    assert np.mean((frame.pixels == 0) | (frame.pixels == 255)) < 0.03


def test_other_parts_other_designs_and_other_seeds_look_different() -> None:
    urls = [
        "part=plate",
        "part=plate2",
        "part=board",
        "part=casting",
        "part=plate&noise=2",
        "part=plate&noise=2&seed=9",
    ]
    looks = {pixels(f"{url}&frames=8").tobytes() for url in urls}
    assert len(looks) == len(urls)


def test_a_bare_number_counts_through_the_kinds() -> None:
    np.testing.assert_array_equal(pixels("part=2&frames=3"), pixels("part=board1&frames=3"))
    np.testing.assert_array_equal(pixels("part=6&frames=3"), pixels("part=casting2&frames=3"))


@pytest.mark.parametrize("part", ["plate", "board", "casting"])
def test_units_of_a_part_differ_a_little_and_designs_a_lot(part: str) -> None:
    drawing, unit, design = (pixels(f"part={part}{v}&frames=30") for v in ("&unit=0", "&unit=7", "2"))
    between_units, between_designs = np.abs(unit - drawing).mean(), np.abs(design - drawing).mean()
    assert 0 < between_units < 0.35 * between_designs


@pytest.mark.parametrize("part", ["plate", "board", "casting"])
def test_truth_boxes_hold_the_difference_that_defects_make(part: str) -> None:
    sweep = f"part={part}&step=24&place=2,-3,0.4"
    bad = opened(f"{sweep}&defect={','.join(KINDS)}")
    difference = np.abs(np.stack([f.pixels for f in bad.frames()]).astype(np.int16) - pixels(sweep))
    peak = dict.fromkeys(range(len(KINDS)), 0)
    for changed, truth in zip(difference, bad.truth(), strict=True):
        for defect in truth.defects:
            x0, y0, x1, y1 = (max(0, round(v)) for v in defect.box)
            box = (slice(y0, y1 + 1), slice(x0, x1 + 1))
            peak[defect.index] = max(peak[defect.index], int(changed[box].max(initial=0)))
        for defect in truth.defects:
            x0, y0, x1, y1 = (max(0, round(v)) for v in defect.box)
            changed[y0 : y1 + 1, x0 : x1 + 1] = 0
        assert changed.max() <= 4
    assert min(peak.values()) > 20, peak


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("missing", "bent")])
def test_a_defect_is_in_the_middle_of_the_picture_where_it_was_asked_for(kind: str) -> None:
    truth = min(opened(f"defect={kind}&at=0.4&seed=3").truth(), key=lambda t: abs(t.s - 0.4))
    (defect,) = truth.defects
    x0, y0, x1, y1 = defect.box
    assert defect.inside
    assert np.hypot((x0 + x1) / 2 - 79.5, (y0 + y1) / 2 - 59.5) < 16


@pytest.mark.parametrize("part", ["plate", "board", "casting"])
@pytest.mark.parametrize("kind", ["missing", "bent"])
def test_something_is_missing_or_bent_within_the_picture_where_it_was_asked_for(part: str, kind: str) -> None:
    truth = min(opened(f"part={part}&defect={kind}&at=0.4").truth(), key=lambda t: abs(t.s - 0.4))
    assert [defect.kind for defect in truth.defects] == [kind]


def test_stronger_and_larger_defects_change_more() -> None:
    clean = pixels("frames=40")
    change = [
        np.abs(pixels(f"frames=40&defect=spot&at=0.3&{how}") - clean).sum()
        for how in ("strength=0.3", "strength=1", "strength=1&defect_size=30")
    ]
    assert 0 < 2 * change[0] < change[1] < change[2] / 2


def test_a_defect_on_another_unit_leaves_the_rest_of_that_unit_alone() -> None:
    np.testing.assert_array_equal(pixels("unit=4&step=40&defect=none"), pixels("unit=4&step=40"))
    late = pixels("unit=4&step=40&path=line&defect=spot&at=1") - pixels("unit=4&step=40&path=line")
    assert not late[0].any()
    assert late[-1].any()


def test_a_standstill_shows_the_same_picture_again() -> None:
    frames = pixels("pause=9&step=20")
    same = [bool((a == b).all()) for a, b in pairwise(frames)]
    assert sum(same) == 9
    assert "TTTTTTTTT" in "".join("FT"[s] for s in same)
    assert len(frames) == 9 + len(pixels("step=20"))


def test_lost_frames_are_gaps_in_sequence_and_time_goes_on() -> None:
    whole, holed = (list(opened(f"step=16&fps=50&{lost}").frames()) for lost in ("lost=0", "lost=0.25"))
    assert [f.sequence for f in whole] == list(range(len(whole)))
    kept = [f.sequence for f in holed]
    assert 0.6 < len(kept) / len(whole) < 0.9
    assert all(f.t_ns == START_NS + 20_000_000 * f.sequence for f in holed)
    for frame in holed:
        np.testing.assert_array_equal(frame.pixels, whole[frame.sequence].pixels)


def test_s_rises_from_0_to_1_along_the_sweep() -> None:
    s = np.array([t.s for t in opened("pace=0.3&jitter=0.02").truth()])
    assert (np.diff(s) > 0).all()
    assert abs(s[0]) < 1e-6
    assert 1 - 1.3 / 265 * 1.1 < s[-1] <= 1


def test_without_faults_the_camera_is_where_the_robot_believes() -> None:
    truths = opened("step=20").truth()
    np.testing.assert_allclose([t.s for t in truths], [t.commanded for t in truths], atol=1e-6)
    np.testing.assert_allclose([t.s for t in truths], np.linspace(0, 1, len(truths)), atol=1e-6)


def test_a_shifted_part_shifts_s_by_the_travel() -> None:
    truths = opened("path=line&step=10&place=20,0,0").truth()
    assert len(truths) == 63
    shift = [t.s - t.commanded for t in truths[:58]]
    np.testing.assert_allclose(shift, 2 / 62, atol=1e-6)


def test_a_turned_part_turns_the_picture() -> None:
    straight = pixels("path=line&frames=3")[1].astype(np.float32)
    turned = pixels("path=line&frames=3&place=0,0,3")[1].astype(np.float32)
    # The middle frame of a line looks at the middle of the part, about which it turns. Light and relief turn
    # with the camera, so equal up to shading.
    back = cv2.warpAffine(turned, cv2.getRotationMatrix2D((79.5, 59.5), -3, 1), (160, 120))
    inner = (slice(20, -20), slice(20, -20))
    likeness = [np.corrcoef(straight[inner].ravel(), image[inner].ravel())[0, 1] for image in (turned, back)]
    assert likeness[1] > 0.97
    assert likeness[1] > likeness[0] + 0.05


def test_a_hand_sees_from_where_it_is_put_what_a_sweep_sees_there() -> None:
    camera = opened("frames=5&noise=0&jpeg=0&vibration=0&place=3,-2,5")
    unmoved = opened("frames=5&noise=0&jpeg=0&vibration=0")
    swept, straight = list(camera.frames()), unmoved.truth()
    for frame, truth in zip(swept, straight, strict=True):
        looked = camera.look(truth.pose, frame.sequence)
        np.testing.assert_array_equal(looked.pixels, frame.pixels)
        assert (looked.t_ns, looked.sequence) == (frame.t_ns, frame.sequence)


def test_a_hand_that_turns_turns_the_picture() -> None:
    camera = opened("noise=0&jpeg=0&vibration=0&size=160x120")
    straight = camera.look(Pose(480, 260)).pixels.astype(float)
    turned = camera.look(Pose(480, 260, np.pi)).pixels.astype(float)
    likeness = [np.corrcoef(straight.ravel(), image.ravel())[0, 1] for image in (turned, turned[::-1, ::-1])]
    # not alike: the lamp turns with the camera, and relief is lit from the other side
    assert likeness[1] > likeness[0] + 0.3


def test_what_is_covered_shows_nothing_of_the_part() -> None:
    camera = opened("noise=0&size=160x120")
    seen, covered = (camera.look(Pose(480, 260), covered=each).pixels.astype(float) for each in (False, True))
    edges = [np.abs(np.diff(picture)).mean() for picture in (seen, covered)]
    assert edges[1] < edges[0] / 10


def test_late_early_and_cut_short_move_the_ends() -> None:
    n = len(opened().truth())
    assert n == 266
    late, early, short = (opened(o).truth() for o in ("late=12", "early=5", "stop=0.7"))
    assert late[0].s == pytest.approx(12 / (n - 1))
    assert early[0].s == pytest.approx(-5 / (n - 1))
    assert short[-1].s <= 0.7 < short[-1].s + 1 / (n - 1)


def test_reversing_goes_back_so_many_frames() -> None:
    steps = np.diff([t.commanded for t in opened("reverse=6").truth()])
    assert (steps < 0).sum() == 6
    assert len(steps) == 265 + 12


def test_frames_sets_the_length_of_the_nominal_sweep() -> None:
    assert [len(opened(f"frames={n}&path={p}").truth()) for n, p in ((50, "serpentine"), (20, "arc"))] == [50, 20]


def test_pace_changes_the_travel_within_its_amplitude() -> None:
    travel = np.diff([t.commanded for t in opened("pace=0.3").truth()]) * 265
    assert 0.69 < travel.min() < 0.75
    assert 1.25 < travel.max() < 1.31


def test_vibration_shakes_the_camera_by_its_standard_deviation() -> None:
    truths = opened("vibration=2&path=line&frames=2000").truth()
    assert np.std([t.pose.y for t in truths]) == pytest.approx(2, rel=0.1)


def test_gain_multiplies_light() -> None:
    bright, dim = pixels("frames=3"), pixels("frames=3&gain=0.5")
    np.testing.assert_allclose(dim[bright < 255], bright[bright < 255] / 2, atol=1)
    assert (dim[bright == 255] >= 127).all()


def test_drift_stays_within_its_amplitude_and_goes_both_ways() -> None:
    ratio = pixels("step=20&drift=0.2").mean(axis=(1, 2)) / pixels("step=20").mean(axis=(1, 2))
    assert 0.79 < ratio.min() < 0.85
    assert 1.15 < ratio.max() < 1.21


def test_shade_tilts_the_light_across_the_field() -> None:
    ratio = pixels("frames=3&shade=0.4&gain=0.7") / np.maximum(pixels("frames=3&gain=0.7"), 1)
    assert np.median(ratio[..., :4]) == pytest.approx(0.8, abs=0.03)
    assert np.median(ratio[..., -4:]) == pytest.approx(1.2, abs=0.03)


def test_noise_has_its_standard_deviation_and_no_pattern_from_frame_to_frame() -> None:
    noise = pixels("frames=12&noise=5&part=plate") - pixels("frames=12&part=plate")
    assert noise.std() == pytest.approx(5, rel=0.05)
    assert abs(np.corrcoef(noise[3].ravel(), noise[4].ravel())[0, 1]) < 0.05


def test_blur_softens_along_the_motion_only() -> None:
    sharp, soft = pixels("path=line&frames=3"), pixels("path=line&frames=3&blur=7")
    along, across = (np.abs(np.diff(soft, axis=a)).mean() / np.abs(np.diff(sharp, axis=a)).mean() for a in (2, 1))
    assert along < 0.6
    assert across > 0.7


def test_the_encoder_reports_travel_with_its_error() -> None:
    right, wrong = (
        [frame.encoder for frame in opened(f"path=line&step=10&{o}").frames()]
        for o in ("encoder=1", "encoder=1&encoder_error=0.1")
    )
    np.testing.assert_allclose(np.array(right, float), 10 * np.arange(63), atol=1e-3)
    np.testing.assert_allclose(np.array(wrong, float), 11 * np.arange(63), atol=1e-3)
    assert next(opened("path=line").frames()).encoder is None


def test_a_larger_picture_shows_the_same_field_finer() -> None:
    coarse = pixels("frames=3&path=line").astype(np.float32)
    fine = pixels("frames=3&path=line&size=640x480").astype(np.float32)
    for small, large in zip(coarse, fine, strict=True):
        shrunk = cv2.resize(large, (160, 120), interpolation=cv2.INTER_AREA)
        assert np.corrcoef(small.ravel(), shrunk.ravel())[0, 1] > 0.95


def test_realtime_waits_for_each_frame_by_the_clock_handed_in() -> None:
    now, waits = [0], list[float]()

    def sleep(seconds: float) -> None:
        waits.append(seconds)
        now[0] += round(seconds * 1e9)

    frames = list(opened("realtime=1&fps=20&frames=10", Clock(lambda: now[0], sleep)).frames())
    assert frames[0].t_ns == START_NS
    np.testing.assert_allclose(waits, [0.05] * 9)


def test_the_description_does_not_tell_what_is_wrong() -> None:
    assert opened("defect=crack&at=0.5").describe() == opened().describe()


@pytest.mark.parametrize(
    ("option", "allowed"),
    [
        ("part=engine", "plate, board or casting"),
        ("part=plate0", "plate, board or casting"),
        ("part=", "plate, board or casting"),
        ("size=320", "width x height like 320x240"),
        ("size=100x200", "at most 1.5 as high"),
        ("defect=dent", "some of scratch, spot, missing"),
        ("defect=21", "up to 20 of any kind"),
        ("defect=spot&at=1.5", "sweep coordinates from 0 to 1"),
        ("defect=spot&at=0.1,0.2", "one sweep coordinate per defect: 1"),
        ("place=1,2", "dx,dy,degrees"),
        ("place=1,2,999", "each from -180 to 180"),
        ("lost=1", "a number from 0 to 0.9"),
    ],
)
def test_a_wrong_option_is_refused_with_what_is_allowed(option: str, allowed: str) -> None:
    with pytest.raises(OptionRefused, match=allowed):
        open_camera(f"simulated:?{option}")


def test_a_sweep_without_frames_and_a_place_are_refused() -> None:
    with pytest.raises(CameraNotOpened, match="late=300, stop=1 and lost=0 leave no frame"):
        open_camera("simulated:?late=300")
    with pytest.raises(CameraNotOpened, match="has no place, only options"):
        open_camera("simulated:plate")
