"""The main job, end to end: two golden sweeps in, parts swept as they come, a verdict out, judged by the truth."""

from dataclasses import dataclass
from functools import lru_cache

import pytest

from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.cameras.simulated.truth import FrameTruth
from inspector.demo import DEFECTS, lies_on_defect
from models.appearance import Appearance
from models.inspection import begin, conclude, step
from models.learning import learn
from models.verdict import FrameState, Judgement, Result

LINE = "simulated:?path=line&frames=50"
GOLDEN = ("unit=1&seed=11", "unit=2&seed=12&pace=0.15&place=1.5,-1,0.15&gain=0.96&drift=0.03")


@lru_cache
def learnt(common: str = "") -> Appearance:
    """From two golden sweeps, which are never held in memory."""
    one, other = (f"{LINE}&{golden}{common}" for golden in GOLDEN)
    with open_camera(one) as first, open_camera(other) as second:
        return learn([first.frames(), second.frames()])


@dataclass(frozen=True)
class Swept:
    """One part, inspected, and what the camera knows of it."""

    result: Result
    truth: tuple[FrameTruth, ...]


@lru_cache
def swept(options: str, common: str = "") -> Swept:
    state = begin(learnt(common))
    with open_camera(f"{LINE}&{options}{common}") as camera:
        assert isinstance(camera, SimulatedCamera)
        for frame in camera.frames():
            state, _ = step(state, frame)
        return Swept(conclude(state), camera.truth())


GOOD = (
    "unit=3&seed=13",
    "unit=4&seed=14&pace=0.25&place=3,-2,0.3&late=2&pause=10",
    "unit=5&seed=15&gain=0.85&drift=0.05&shade=0.06&lost=0.05",
    "unit=6&seed=16&vibration=0.3&blur=2&place=-2,2,-0.3",
)


@pytest.mark.parametrize("options", GOOD)
def test_a_good_part_is_ok(options: str):
    part = swept(options)
    assert part.result.verdict is Judgement.OK
    assert part.result.deviations == ()
    assert part.result.coverage > 0.95
    assert part.result.frames_scored >= 0.95 * len(part.truth)


@pytest.mark.parametrize("options", [*GOOD, "unit=7&seed=17&defect=extra,crack&at=0.3,0.7"])
def test_the_sweep_coordinate_is_the_true_one(options: str):
    part = swept(options)
    scored = [(f, t) for f, t in zip(part.result.frames, part.truth, strict=True) if f.state is FrameState.SCORED]
    # an offset along the path looks like travel: three pixels of thirteen a frame
    within = [abs(f.s - t.s) * 49 < 1 for f, t in scored]
    assert sum(within) >= 0.97 * len(part.truth)


def test_a_golden_sweep_of_uneven_pace_with_a_pause_gives_the_true_coordinate_too():
    with open_camera(f"{LINE}&unit=1&seed=11&pace=0.1&pause=10") as camera:
        state = begin(learn([camera.frames()]))
    with open_camera(f"{LINE}&unit=3&seed=13") as camera:
        assert isinstance(camera, SimulatedCamera)
        for frame in camera.frames():
            state, _ = step(state, frame)
        truth = camera.truth()
    off = [abs(f.s - t.s) * 49 for f, t in zip(state.frames, truth, strict=True) if f.s is not None]
    assert len(off) >= 0.95 * len(truth)
    assert max(off) < 1


@pytest.mark.parametrize("kind", DEFECTS)
def test_a_defective_part_is_ng_at_the_defect(kind: str):
    number = DEFECTS.index(kind)
    part = swept(f"unit={20 + number}&seed={30 + number}&defect={kind}&at={0.2 + 0.08 * number:g}")
    assert part.result.verdict is Judgement.NG
    found = [d for d in part.result.deviations if d.kind == "appearance"]
    assert any(lies_on_defect(deviation, part.truth) for deviation in found)
    shown = [frame.s for frame in part.truth if frame.defects]
    for deviation in found:
        assert min(shown) - 0.05 < deviation.s_start < deviation.s_end < max(shown) + 0.07


def test_two_defects_are_two_places():
    part = swept("unit=7&seed=17&defect=extra,spot&at=0.1,0.9")
    found = [d for d in part.result.deviations if lies_on_defect(d, part.truth)]
    assert len(found) >= 2
    assert found[0].s_end < found[-1].s_start


@pytest.mark.parametrize("kind", ["spot", "crack"])
def test_in_colour_good_and_bad_are_told_apart_too(kind: str):
    assert swept("unit=3&seed=13", "&colour=1&size=240x180").result.verdict is Judgement.OK
    assert swept(f"unit=8&seed=18&defect={kind}&at=0.5", "&colour=1&size=240x180").result.verdict is Judgement.NG


@pytest.mark.parametrize("defect", ["", "&defect=extra&at=0.3"])
def test_a_sweep_cut_short_is_incomplete(defect: str):
    result = swept(f"unit=5&seed=19&stop=0.6{defect}").result
    assert result.verdict is Judgement.INCOMPLETE
    assert 0.5 < result.coverage < 0.8
    assert any("not seen between" in reason for reason in result.reasons)


@pytest.mark.parametrize("part", ["board", "casting", "plate2"])
def test_another_product_is_never_ok(part: str):
    assert swept(f"part={part}&seed=20").result.verdict in (Judgement.INVALID, Judgement.NG)


def test_a_part_the_wrong_way_round_is_never_ok():
    assert swept("unit=3&seed=21&place=0,0,180").result.verdict in (Judgement.INVALID, Judgement.NG)


def test_black_frames_are_invalid():
    result = swept("unit=3&seed=22&gain=0").result
    assert result.verdict is Judgement.INVALID
    assert {frame.state for frame in result.frames} == {FrameState.BLIND}
