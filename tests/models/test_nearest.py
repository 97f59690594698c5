"""NearestPoint: brute force, closed forms on circles and spheres, and nothing worse than the coarse point."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.manifold import Manifold
from models.nearest import SCAN, NearestPoint

TURN = 2 * np.pi


def circle_of(samples: int = 72, radius: float = 1.0) -> Manifold:
    angle = np.arange(samples) * TURN / samples
    return Manifold.over(angle, radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), period=TURN)


def tangle(r: int, k: int, seed: int) -> Manifold:
    rng = np.random.default_rng(seed)
    return Manifold.over(np.linspace(0, 1, r), rng.standard_normal((r, k)).astype(np.float32))


def brute_force(closest: NearestPoint, z: np.ndarray) -> np.ndarray:
    return np.linalg.norm(closest.z.astype(np.float64) - z, axis=1)


@given(k=st.integers(1, 30), seed=st.integers(0, 2**31), far=st.floats(0, 300), count=st.sampled_from((2, 50, 700)))
@settings(max_examples=80, deadline=None)
def test_the_coarse_point_is_that_of_brute_force(k: int, seed: int, far: float, count: int):
    closest = NearestPoint.of(tangle(12, k, seed), count)
    rng = np.random.default_rng(seed)
    # Far points are where float32 cannot tell the candidates apart.
    z = (closest.z[rng.integers(count)] + far * rng.standard_normal(k)).astype(np.float32)
    found = closest.find(z)
    distances = brute_force(closest, z)
    assert found is not None
    assert found.index == distances.argmin()
    assert found.distance <= distances.min() * (1 + 1e-6) + 1e-6


def test_the_tree_finds_what_brute_force_finds():
    closest = NearestPoint.of(tangle(40, 6, 1), SCAN + 1)
    rng = np.random.default_rng(2)
    for z in rng.standard_normal((20, 6)):
        found = closest.find(z)
        assert found is not None
        assert found.index == brute_force(closest, z).argmin()


@given(angle=st.floats(0, TURN, exclude_max=True), radius=st.floats(0.05, 5))
@settings(max_examples=80, deadline=None)
def test_on_a_circle_the_angle_is_found(angle: float, radius: float):
    closest = NearestPoint.of(circle_of(), 90)
    found = closest.find(radius * np.array([np.cos(angle), np.sin(angle)]))
    assert found is not None
    # The spline through 72 points turns its normal by some 3e-6; near the centre that swings the foot by 1 / radius.
    assert abs(np.sin(found.q[0] - angle)) < 1e-5 / min(1, radius)
    assert np.cos(found.q[0] - angle) > 0
    assert found.distance == pytest.approx(abs(radius - 1), abs=1e-6)
    assert 0 <= found.q[0] < TURN


def test_on_a_line_the_foot_of_the_perpendicular_is_found():
    s = np.linspace(0, 1, 5)
    closest = NearestPoint.of(Manifold.over(s, np.stack([4 * s, 3 * s], axis=1)), 11)
    found = closest.find(np.array([4 * 0.37 - 3, 3 * 0.37 + 4]))
    assert found is not None
    assert found.q == pytest.approx([0.37])
    assert found.distance == pytest.approx(5)


@pytest.mark.parametrize(("beyond", "s", "index"), [(-2.0, 0, 0), (2.0, 1, 10)])
def test_beyond_an_end_the_end_is_found(beyond: float, s: float, index: int):
    axis = np.linspace(0, 1, 5)
    found = NearestPoint.of(Manifold.over(axis, np.stack([axis, axis**2], axis=1)), 11).find(np.full(2, beyond))
    assert found is not None
    assert (found.q.tolist(), found.index) == ([s], index)


def test_on_a_torus_both_angles_are_found():
    angle = np.arange(24) * TURN / 24
    u, v = np.meshgrid(angle, angle, indexing="ij")
    ring = 3 + np.cos(v)
    torus = Manifold((angle, angle), np.stack([ring * np.cos(u), ring * np.sin(u), np.sin(v)], axis=-1), (TURN, TURN))
    closest = NearestPoint.of(torus, (30, 20))
    for at in np.random.default_rng(0).uniform(0, TURN, (30, 2)):
        ring_at = 3 + 1.4 * np.cos(at[1])
        found = closest.find(np.array([ring_at * np.cos(at[0]), ring_at * np.sin(at[0]), 1.4 * np.sin(at[1])]))
        assert found is not None
        np.testing.assert_allclose(np.cos(found.q - at), 1, atol=1e-6)
        assert found.distance == pytest.approx(0.4, abs=2e-3)


def test_where_one_parameter_is_held_at_its_end_the_other_is_still_found():
    u, v = np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 7), indexing="ij")
    sheared = np.stack([u + 0.9 * v, v + 0.9 * u], axis=-1)
    closest = NearestPoint.of(Manifold((u[:, 0], v[0]), sheared, (None, None)), (6, 7))
    z = np.array([3.0, 1.3])
    found = closest.find(z)
    assert found is not None
    # With u = 1 the distance to (1 + 0.9 v, v + 0.9) is least where (0.9, 1) is perpendicular to what is left.
    v_best = (0.9 * (z[0] - 1) + (z[1] - 0.9)) / (0.9**2 + 1)
    assert found.q == pytest.approx([1, min(1, v_best)], abs=1e-6)


def test_none_within_epsilon_is_an_answer():
    closest = NearestPoint.of(circle_of(), 36)
    z = np.array([1.5, 0.1])
    assert closest.find(z, within=0.4) is None
    found = closest.find(z, within=0.51)
    assert found is not None
    assert found.distance == pytest.approx(np.hypot(*z) - 1, abs=1e-6)
    # Between the resampled points nothing is within, on the spline something is.
    between = np.array([np.cos(TURN / 72), np.sin(TURN / 72)])
    assert closest.find(between, within=1e-4) is not None
    assert brute_force(closest, between).min() > 1e-2


@given(start=st.integers(-5, 60), length=st.integers(-2, 40), seed=st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_a_window_is_a_stretch_of_the_points(start: int, length: int, seed: int):
    closest = NearestPoint.of(tangle(8, 4, seed), 50)
    z = np.random.default_rng(seed).standard_normal(4)
    found = closest.find(z, window=(start, start + length))
    inside = [i for i in range(50) if start <= i < start + length]
    if not inside:
        assert found is None
    else:
        assert found is not None
        assert found.index == min(inside, key=lambda i: brute_force(closest, z)[i])


def test_looking_changes_nothing_that_was_given():
    closest = NearestPoint.of(circle_of(), 36)
    z = np.array([1.5, 0.1])
    z.flags.writeable = False
    before = closest.z.copy(), closest.q.copy()
    closest.find(z)
    np.testing.assert_array_equal(closest.z, before[0])
    np.testing.assert_array_equal(closest.q, before[1])
