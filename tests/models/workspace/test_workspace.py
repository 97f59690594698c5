"""Workspace: learnt places between the samples, other objects, other light, and what comes back from its bytes."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import cv2
import numpy as np
import pytest

from models.errors import AppearanceError, LearningError, NumericError, PictureError
from models.workspace import LabelledPicture, Parameter, Workspace, learn_workspace
from tests.models.parts import surface
from tests.models.workspace.drawn import VIEW, pictures, view

X = np.linspace(-12, 12, 9)
"""Three pixels from sample to sample."""
XY = (Parameter("x"), Parameter("y"))


@pytest.fixture(scope="module")
def plates() -> Workspace:
    """Two parts over x and y."""
    return learn_workspace(pictures((X, X), (1, 2)), XY)


def test_places_between_the_samples_are_found(plates: Workspace) -> None:
    rng = np.random.default_rng(0)
    errors: list[np.ndarray] = []
    for _ in range(30):
        part, q = int(rng.integers(1, 3)), rng.uniform(-12, 12, 2)
        noisy = view(surface(part), *q, gain=float(rng.uniform(0.9, 1.1))) + rng.normal(0, 2, VIEW[::-1])
        found = plates.locate(np.clip(noisy, 0, 255).astype(np.uint8))
        assert (found.object, found.state) == (f"part{part}", "known")
        assert found.q is not None
        errors.append(np.array(found.q) - q)
    assert np.abs(errors).mean() < 0.05 * 3


def test_what_was_not_learnt_is_unknown(plates: Workspace) -> None:
    found = plates.locate(view(surface(3), 0, 0))
    assert (found.object, found.q, found.state) == (None, None, "unknown")
    assert found.others[0].distance == found.distance


def test_near_a_place_it_is_found_as_everywhere(plates: Workspace) -> None:
    seen = view(surface(2), 4.2, -7.3)
    everywhere, near = plates.locate(seen), plates.locate_near(seen, "part2", (4.0, -7.0), (2.0, 2.0))
    assert everywhere.q is not None
    assert near.q == pytest.approx(everywhere.q, abs=0.01)
    with pytest.raises(NumericError, match="no object part3 in the workspace; allowed are part1, part2"):
        plates.locate_near(seen, "part3", (0.0, 0.0), (1.0, 1.0))


def test_a_part_that_looks_alike_from_two_sides_is_ambiguous() -> None:
    half = view(surface(1), 0)[:, : VIEW[0] // 2]

    def turned(angle_deg: float) -> np.ndarray:
        shifted = np.roll(np.hstack([half, half]), round(VIEW[0] * angle_deg / 360), axis=1)
        return np.ascontiguousarray(shifted)

    learnt = [LabelledPicture("part", (angle,), turned(angle)) for angle in np.arange(0, 360, 7.5)]
    workspace = learn_workspace(learnt, [Parameter("angle_deg", 360)])
    found = workspace.locate(turned(93.75))
    assert found.state == "ambiguous"
    assert found.uncertainty is not None
    assert found.uncertainty[0] == pytest.approx(180, abs=1)


def test_the_same_bytes_come_back_and_find_the_same(plates: Workspace) -> None:
    again = Workspace.from_bytes(plates.to_bytes())
    assert (again.id, again.objects, again.parameters) == (plates.id, ("part1", "part2"), XY)
    seen = view(surface(1), 1.5, 2.5)
    assert again.locate(seen) == plates.locate(seen)


def test_a_damaged_file_is_refused(plates: Workspace) -> None:
    data = plates.to_bytes()
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 1
    for harm, said in ((bytes(flipped), "checksum"), (data[:-9], "checksum"), (b"x" + data, "not a workspace")):
        with pytest.raises(AppearanceError, match=said):
            Workspace.from_bytes(harm)


def test_what_cannot_be_learnt_is_refused_by_name() -> None:
    flat = np.zeros((20, 30), np.uint8)
    with pytest.raises(LearningError, match="no picture to learn from"):
        learn_workspace([], XY)
    with pytest.raises(LearningError, match="object a: 1 numbers at x 3; needed are x, y"):
        learn_workspace([LabelledPicture("a", (3.0,), flat)], XY)
    two = [LabelledPicture("a", (0.0,), flat), LabelledPicture("a", (1.0,), flat[1:])]
    with pytest.raises(PictureError, match="object a at x 1: picture is 30x19, learnt were pictures of 30x20"):
        learn_workspace(two, XY[:1])
    same = [LabelledPicture("a", (value,), flat + 9) for value in (0.0, 1.0)]
    with pytest.raises(LearningError):
        learn_workspace(same, XY[:1])


@pytest.mark.parametrize(("step", "side"), [(1.0, 128), (3.0, 64)])
def test_fine_texture_is_looked_at_closely_where_steps_are_short(step: float, side: int) -> None:
    ground = cv2.GaussianBlur(np.random.default_rng(5).standard_normal((200, 400)), (0, 0), 2.0)
    part = (128 + 40 * ground / ground.std()).astype(np.float32)
    learnt = [LabelledPicture("part", (x,), _wide(part, x)) for x in step * np.arange(-4, 5)]
    workspace = learn_workspace(learnt, XY[:1])
    assert workspace.look.shape[1] == side


def _wide(part: np.ndarray, x: float) -> np.ndarray:
    moved = np.array([[1.0, 0, 100 + x], [0, 1, 30]])
    seen = cv2.warpAffine(part, moved, (192, 144), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return np.clip(seen, 0, 255).astype(np.uint8)


def test_two_values_on_an_axis_will_do() -> None:
    workspace = learn_workspace(pictures(((-1.0, 1.0), (-1.0, 1.0))), XY)
    found = workspace.locate(view(surface(1), 0.2, -0.4))
    assert found.state == "known"
    assert found.q == pytest.approx((0.2, -0.4), abs=0.25)


def test_four_parameters_one_of_them_a_turn() -> None:
    down, across = np.mgrid[-1 : 1 : VIEW[1] * 1j, -1 : 1 : VIEW[0] * 1j]

    def seen(x: float, y: float, turn: float, lamp: float) -> np.ndarray:
        """The lamp goes round the part."""
        shade = 1 + 0.3 * (np.cos(np.radians(lamp)) * across + np.sin(np.radians(lamp)) * down)
        return np.clip(view(surface(1), x, y, turn) * shade, 0, 255).astype(np.uint8)

    axes = ((-2.0, 0.0, 2.0), (-2.0, 0.0, 2.0), (-3.0, 0.0, 3.0), np.arange(0, 360, 45.0))
    names = (*XY, Parameter("turn"), Parameter("lamp", 360))
    workspace = learn_workspace((LabelledPicture("part", q, seen(*q)) for q in product(*axes)), names)
    for q in ((0.7, -1.1, 1.9, 341.0), (-1.4, 0.3, -0.8, 180.0)):
        found = workspace.locate(seen(*q))
        assert found.q is not None
        assert (np.abs(np.array(found.q) - q) < (0.2, 0.2, 0.3, 5)).all()


def test_what_strays_anyway_does_not_mislead() -> None:
    rng = np.random.default_rng(2)

    def seen(x: float) -> np.ndarray:
        """A part under a lamp that is moved about between pictures."""
        shade = 1 + 0.3 * rng.uniform(-1, 1) * np.linspace(-1, 1, VIEW[1])[:, None]
        return np.clip(view(surface(1), x) * shade, 0, 255).astype(np.uint8)

    learnt = (LabelledPicture("part", (x,), seen(x)) for x in np.linspace(-12, 12, 25))
    weighed = learn_workspace(learnt, XY[:1])
    part = weighed.learnt[0]
    alike = replace(weighed, learnt=(replace(part, noise=np.eye(part.space.k) * np.trace(part.noise)),))
    places = rng.uniform(-11, 11, 40).tolist()
    errors: list[float] = []
    for workspace in (weighed, alike):
        found = [(workspace.locate(seen(x)).q or (np.inf,))[0] for x in places]
        errors.append(float(np.mean(np.abs(np.array(found) - places))))
    assert errors[0] < errors[1] / 2


def test_colour_tells_apart_what_is_alike_in_grey() -> None:
    def tinted(x: float, blue: bool) -> np.ndarray:
        grey = view(surface(1), x).astype(np.float32)
        # blue and red that OpenCV makes the same grey of
        other = np.float32(0.114 / 0.299)
        weights = np.array([0.9, 0.5, 0.3] if blue else [0.3, 0.5, 0.3 + 0.6 * other], np.float32)
        return np.clip(grey[..., None] * weights, 0, 255).astype(np.uint8)

    learnt = [
        LabelledPicture(name, (x,), tinted(x, name == "blue"))
        for name in ("blue", "red")
        for x in np.linspace(-8, 8, 9)
    ]
    workspace = learn_workspace(learnt, XY[:1])
    for name in ("blue", "red"):
        found = workspace.locate(tinted(2.9, name == "blue"))
        assert (found.object, found.state) == (name, "known")
        assert found.q == pytest.approx((2.9,), abs=0.1)


@pytest.mark.parametrize("value", [np.nan, -1.0])
def test_a_file_whose_numbers_cannot_be_is_refused(plates: Workspace, value: float) -> None:
    noise = value * np.eye(plates.learnt[0].space.k)
    wrong = replace(plates, learnt=(replace(plates.learnt[0], noise=noise), *plates.learnt[1:]))
    with pytest.raises(AppearanceError, match="object part1: its numbers cannot be"):
        Workspace.from_bytes(wrong.to_bytes())


def test_samples_that_lie_a_little_off_do_not_tell_apart_what_is_alike() -> None:
    rng = np.random.default_rng(0)
    down, across = np.mgrid[-1 : 1 : VIEW[1] * 1j, -1 : 1 : VIEW[0] * 1j]

    def seen(angle_deg: float) -> np.ndarray:
        """The same from both sides, but for where the part lies and the sensor's noise."""
        wave = np.sin(2 * (np.arctan2(down, across) - np.radians(angle_deg)))
        disc = np.where(np.hypot(across, down) < 0.7, 0.6 + 0.1 * wave, 0)
        moved = np.hstack([np.eye(2), rng.normal(0, 0.5, (2, 1))])
        drawn = cv2.warpAffine((200 * disc).astype(np.float32), moved, VIEW) + rng.normal(0, 1, VIEW[::-1])
        return np.clip(drawn, 0, 255).astype(np.uint8)

    learnt = [LabelledPicture("disc", (angle,), seen(angle)) for angle in np.arange(0, 360, 10.0)]
    workspace = learn_workspace(learnt, [Parameter("angle_deg", 360)])
    found = [workspace.locate(seen(angle)) for angle in np.arange(5, 360, 30.0)]
    assert {each.state for each in found} == {"ambiguous"}
    assert all(each.uncertainty and each.uncertainty[0] > 150 for each in found)
