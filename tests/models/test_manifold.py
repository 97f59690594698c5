"""Manifold: splines against what they must pass through, polynomials, and finite differences."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from models.errors import AppearanceError, LearningError
from models.manifold import Manifold

PERIODS = st.sampled_from(((None,), (2.0,), (None, None), (2.0, None), (None, 2.0), (2.0, 2.0), (None, 2.0, None)))


def manifold_of(counts: tuple[int, ...], periods: tuple[float | None, ...], seed: int, k: int = 3) -> Manifold:
    """Random samples on unevenly spaced axes in [0, 1.5]."""
    rng = np.random.default_rng(seed)
    axes = tuple(1.5 * np.cumsum(rng.uniform(0.2, 1, r)) / r for r in counts)
    return Manifold(axes, rng.standard_normal((*counts, k)).astype(np.float32), periods)


@given(periods=PERIODS, counts=st.lists(st.integers(2, 7), min_size=3, max_size=3), seed=st.integers(0, 2**31))
@settings(max_examples=60, deadline=None)
def test_it_passes_through_its_samples(periods: tuple[float | None, ...], counts: list[int], seed: int):
    g = manifold_of(tuple(counts[: len(periods)]), periods, seed)
    q = np.stack(np.meshgrid(*g.axes, indexing="ij"), axis=-1)
    np.testing.assert_allclose(g.at(q.reshape(-1, g.m)).reshape(g.samples.shape), g.samples, atol=1e-9)


@given(periods=PERIODS, seed=st.integers(0, 2**31), where=st.lists(st.floats(0.05, 0.95), min_size=3, max_size=3))
@settings(max_examples=60, deadline=None)
def test_the_derivative_is_what_differences_tend_to(periods: tuple[float | None, ...], seed: int, where: list[float]):
    g = manifold_of((6,) * len(periods), periods, seed)
    q = np.array([line[0] + share * (line[-1] - line[0]) for line, share in zip(g.axes, where, strict=False)])
    for axis in range(g.m):
        step = 1e-6 * np.eye(g.m)[axis]
        difference = (g.at(q + step) - g.at(q - step)) / 2e-6
        slope = g.derivative(q, axis)
        np.testing.assert_allclose(slope, difference, atol=1e-4 * (1 + np.abs(slope).max()))


def test_second_and_mixed_derivatives_of_a_polynomial_are_exact():
    u, v = np.linspace(0, 1, 6), np.linspace(0, 1, 5) ** 1.5
    surface = Manifold((u, v), (u[:, None] ** 3 * v**2)[..., None], (None, None))
    q = np.array([0.3, 0.7])
    assert surface.at(q) == pytest.approx(0.3**3 * 0.7**2)
    assert surface.differentiate(q, (2, 0)) == pytest.approx(6 * 0.3 * 0.7**2)
    assert surface.differentiate(q, (1, 1)) == pytest.approx(6 * 0.3**2 * 0.7)
    assert surface.derivative(q, 1) == pytest.approx(2 * 0.3**3 * 0.7)


@pytest.mark.parametrize("period", [None, 1.7])
def test_one_parameter_gives_the_cubic_spline_of_scipy(period: float | None):
    g = manifold_of((9,), (period,), 1)
    axis, samples = g.axes[0], g.samples.astype(np.float64)
    if period is not None:
        axis, samples = np.append(axis, axis[0] + period), np.vstack([samples, samples[:1]])
    spline = CubicSpline(axis, samples, bc_type="not-a-knot" if period is None else "periodic")
    s = np.linspace(axis[0], axis[-1], 101, endpoint=period is None)
    for order in (0, 1, 2, 3):
        np.testing.assert_allclose(g.differentiate(s[:, None], (order,)), spline(s, order), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_few_samples_give_the_polynomial_through_them(count: int):
    s = np.linspace(0, 1, count)
    g = Manifold.over(s, (s ** (count - 1))[:, None])
    assert g.at(0.37) == pytest.approx(0.37 ** (count - 1))
    surface = Manifold((s, s), (s[:, None] ** (count - 1) + s)[..., None], (None, None))
    assert surface.at(np.array([0.37, 0.2])) == pytest.approx(0.37 ** (count - 1) + 0.2)


@pytest.mark.parametrize("periods", [(2.0,), (2.0, None), (None, 2.0)])
def test_a_period_wraps_smoothly(periods: tuple[float | None, ...]):
    g = manifold_of((6,) * len(periods), periods, 2)
    turning = periods.index(2.0)
    q = np.full(g.m, 0.6)
    turn = 2.0 * np.eye(g.m)[turning]
    for turns in (-3, 1, 4):
        np.testing.assert_allclose(g.at(q + turns * turn), g.at(q), atol=1e-9)
    seam = np.where(np.arange(g.m) == turning, g.axes[turning][0], 0.6)
    for derive in (g.at, lambda at: g.derivative(at, turning)):
        np.testing.assert_allclose(derive(seam - 1e-9 * turn), derive(seam), atol=1e-5)


def test_without_a_period_it_ends_where_its_axis_ends():
    g = manifold_of((6,), (None,), 3)
    np.testing.assert_array_equal(g.at(99.0), g.at(float(g.axes[0][-1])))
    np.testing.assert_array_equal(g.at(-99.0), g.at(float(g.axes[0][0])))


def test_many_points_equal_each_by_itself():
    for periods in ((None,), (2.0, None)):
        g = manifold_of((6,) * len(periods), periods, 4)
        q = np.random.default_rng(0).uniform(0, 1.5, (20, g.m))
        assert g.at(q).shape == (20, 3)
        np.testing.assert_allclose(g.at(q), [g.at(one) for one in q], atol=1e-12)


def test_resampling_includes_both_ends_but_a_period_once():
    g = manifold_of((5, 6), (None, 2.0), 5)
    q, z = g.resample((3, 4))
    u, v = g.axes
    np.testing.assert_allclose(q[:, 0].reshape(3, 4)[:, 0], [u[0], (u[0] + u[-1]) / 2, u[-1]])
    np.testing.assert_allclose(q[:4, 1], v[0] + np.array([0, 0.5, 1, 1.5]))
    np.testing.assert_array_equal(z, g.at(q))
    q, z = manifold_of((5,), (None,), 5).resample(7)
    assert (q.shape, z.shape) == ((7, 1), (7, 3))


@pytest.mark.parametrize(
    ("axis", "period", "said"),
    [
        ([0, 0.5, 0.5, 1], None, "axis 0 is 0.5 and then 0.5 at index 2"),
        ([0, 0.5, 0.2, 1], None, "axis 0 is 0.5 and then 0.2 at index 2"),
        ([0, 0.5, np.nan, 1], None, "finite"),
        ([0, 0.5, 0.7, 1], 1.0, "spans 1.0, its period is 1.0"),
        ([0, 0.5, 0.7], None, r"samples of shape \(4, 2\)"),
    ],
)
def test_axes_that_make_no_curve_are_refused(axis: list[float], period: float | None, said: str):
    with pytest.raises(LearningError, match=said):
        Manifold.over(np.array(axis), np.zeros((4, 2)), period)


def test_one_sample_is_no_curve():
    with pytest.raises(LearningError, match="two or more"):
        Manifold.over(np.zeros(1), np.zeros((1, 2)))


def test_parameters_of_another_number_are_refused():
    with pytest.raises(LearningError, match=r"shape \(2,\), allowed are \(1,\) and \(n, 1\)"):
        manifold_of((5,), (None,), 0).at(np.zeros(2))


@pytest.mark.parametrize("periods", [(None,), (2.0, None)])
def test_what_was_saved_is_the_same_curve(periods: tuple[float | None, ...]):
    g = manifold_of((5,) * len(periods), periods, 6)
    read = Manifold.from_parts(json.loads(json.dumps(g.to_header())), g.arrays())
    q = np.full(g.m, 0.4)
    assert read.at(q).tobytes() == g.at(q).tobytes()
    assert read.samples.dtype == np.float32
    assert not read.samples.flags.writeable


@pytest.mark.parametrize("harm", [{"axis0": np.zeros(5)}, {"samples": np.zeros((4, 3))}, {"samples": np.zeros(())}])
def test_damaged_arrays_are_refused(harm: dict[str, np.ndarray]):
    g = manifold_of((5,), (None,), 6)
    with pytest.raises(AppearanceError, match="manifold in the file"):
        Manifold.from_parts(g.to_header(), g.arrays() | harm)


@given(periods=PERIODS, counts=st.lists(st.integers(2, 7), min_size=3, max_size=3), seed=st.integers(0, 2**31))
@settings(max_examples=60, deadline=None)
def test_a_jet_is_all_derivatives_at_once(periods: tuple[float | None, ...], counts: list[int], seed: int):
    g = manifold_of(tuple(counts[: len(periods)]), periods, seed)
    q = np.random.default_rng(seed).uniform(-0.2, 1.7, g.m)
    jet, unit = g.jet(q), np.eye(g.m, dtype=int)
    np.testing.assert_allclose(jet.value, g.at(q), atol=1e-9)
    for i in range(g.m):
        np.testing.assert_allclose(jet.slopes[i], g.derivative(q, i), atol=1e-7)
        for j in range(g.m):
            bend = g.differentiate(q, tuple((unit[i] + unit[j]).tolist()))
            np.testing.assert_allclose(jet.bends[i, j], bend, atol=1e-5 * (1 + np.abs(bend).max()))
