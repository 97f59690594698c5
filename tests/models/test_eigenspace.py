"""Eigenspace: against full singular value decompositions, closed forms, and itself read in another way."""

import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models import principal
from models.eigenspace import Eigenspace, fit_eigenspace
from models.errors import AppearanceError, LearningError

STREAMED = 2**16
"""A budget that no set of frames here fits in."""


def frames_of(count: int, p: int, decay: float = 0.7, noise: float = 1e-3, seed: int = 0) -> np.ndarray:
    """Frames whose spectrum decays, about a mean that is larger than all of it, as pictures are."""
    rng = np.random.default_rng(seed)
    strength = decay ** np.arange(min(count, p, 30))
    signal = (rng.standard_normal((count, strength.size)) * strength) @ rng.standard_normal((strength.size, p))
    return (signal + noise * rng.standard_normal((count, p)) + 20 * rng.random(p)).astype(np.float32)


def svd_of(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and rows by full SVD in float64."""
    xs = frames.astype(np.float64)
    _, singular, rows = np.linalg.svd(xs - xs.mean(axis=0), full_matrices=False)
    return singular**2 / len(xs), rows


def angle(one: np.ndarray, other: np.ndarray) -> float:
    """Largest principal angle between the spaces of two sets of rows, in radians."""
    one, other = (np.linalg.qr(rows.T.astype(np.float64))[0] for rows in (one, other))
    return float(np.linalg.norm(one - other @ (other.T @ one), 2))


@given(count=st.integers(3, 25), p=st.integers(2, 40), k=st.integers(1, 30), seed=st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_the_basis_is_orthonormal_and_projecting_twice_changes_nothing(count: int, p: int, k: int, seed: int):
    frames = frames_of(count, p, seed=seed)
    space = fit_eigenspace(frames, k=k)
    assert 1 <= space.k <= min(k, p, count - 1)
    np.testing.assert_allclose(space.basis @ space.basis.T, np.eye(space.k), atol=2e-6)
    x = frames[0] + np.random.default_rng(seed).standard_normal(p).astype(np.float32)
    z = space.project(x)
    on_space = space.reconstruct(z)
    np.testing.assert_allclose(space.project(on_space), z, atol=1e-3)
    # What is left of x is perpendicular to the space.
    np.testing.assert_allclose(space.basis @ (x - on_space), 0, atol=1e-3)
    assert space.distance(x, z) == pytest.approx(np.linalg.norm(x - on_space), abs=0.05)


@pytest.mark.parametrize(("count", "p"), [(40, 300), (300, 40), (60, 60)])
def test_the_gram_matrix_gives_the_singular_vectors_up_to_sign(count: int, p: int):
    frames = frames_of(count, p, decay=0.8)
    space = fit_eigenspace(frames, k=10)
    values, rows = svd_of(frames)
    np.testing.assert_allclose(space.eigenvalues, values[:10], rtol=1e-6)
    np.testing.assert_allclose(np.abs(np.sum(space.basis * rows[:10], axis=1)), 1, atol=1e-6)
    assert space.total_variance == pytest.approx(values.sum(), rel=1e-5)
    np.testing.assert_allclose(space.mean, frames.mean(axis=0, dtype=np.float64), rtol=1e-5)


def test_frames_read_again_and_again_give_the_exact_space():
    frames = frames_of(900, 700, decay=0.8)
    streamed = fit_eigenspace(lambda: iter(frames), k=12, memory=STREAMED)
    values, rows = svd_of(frames)
    np.testing.assert_allclose(streamed.eigenvalues, values[:12], rtol=1e-3)
    assert angle(streamed.basis, rows[:12]) < 0.02
    np.testing.assert_allclose(streamed.basis @ streamed.basis.T, np.eye(12), atol=2e-6)


def test_a_flat_spectrum_is_held_nearly_as_well_as_can_be():
    frames = frames_of(800, 500, decay=0.5, noise=0.3)
    streamed = fit_eigenspace(frames, k=25, memory=STREAMED)
    values, _ = svd_of(frames)
    centred = frames - frames.mean(axis=0)
    held = float(np.mean(np.sum((centred @ streamed.basis.T) ** 2, axis=1)))
    assert held > 0.995 * values[:25].sum()


def test_the_frames_are_read_a_few_times_and_never_held():
    frames = frames_of(600, 400)
    readings = 0

    def read() -> Iterator[np.ndarray]:
        nonlocal readings
        readings += 1
        buffer = np.empty(400, np.float32)
        for frame in frames:
            buffer[:] = frame
            yield buffer

    space = fit_eigenspace(read, k=5, memory=STREAMED)
    assert 2 <= readings <= principal.PASSES
    assert angle(space.basis, svd_of(frames)[1][:5]) < 0.02


def test_directions_beyond_the_budget_are_carried_on_in_a_restart():
    frames = frames_of(500, 6000, decay=0.97, noise=0.0)
    space = fit_eigenspace(frames, energy=0.999, k_max=30, memory=STREAMED)
    values, _ = svd_of(frames)
    assert space.k == int(np.searchsorted(np.cumsum(values), 0.999 * values.sum())) + 1
    np.testing.assert_allclose(space.eigenvalues, values[: space.k], rtol=5e-3)


@pytest.mark.parametrize("memory", [2**28, STREAMED])
@pytest.mark.parametrize("energy", [0.3, 0.9, 0.99, 0.9999])
def test_the_fewest_dimensions_that_hold_the_share_are_kept(memory: int, energy: float):
    frames = frames_of(700, 300, decay=0.85, noise=0.0)
    space = fit_eigenspace(frames, energy=energy, memory=memory)
    shares = np.cumsum(svd_of(frames)[0]) / svd_of(frames)[0].sum()
    assert space.k == int(np.searchsorted(shares, energy)) + 1
    assert space.energy >= energy - 1e-6


@pytest.mark.parametrize("memory", [2**28, STREAMED])
def test_a_share_that_needs_more_dimensions_than_allowed_gets_those_allowed(memory: int):
    frames = frames_of(700, 300, decay=0.99, noise=0.2)
    space = fit_eigenspace(frames, energy=0.999, k_max=45, memory=memory)
    assert space.k == 45
    assert space.energy < 0.999


@pytest.mark.parametrize("memory", [2**28, STREAMED])
def test_learning_twice_gives_equal_bytes_and_signs_are_fixed(memory: int):
    frames = frames_of(600, 300)
    one, two = (fit_eigenspace(frames, k=6, memory=memory) for _ in range(2))
    assert one.basis.tobytes() == two.basis.tobytes()
    assert one.eigenvalues.tobytes() == two.eigenvalues.tobytes()
    assert all(row[np.abs(row).argmax()] > 0 for row in one.basis)


@pytest.mark.parametrize("memory", [2**28, 2**10])
def test_fewer_dimensions_come_where_the_frames_span_fewer(memory: int):
    rng = np.random.default_rng(0)
    plane = (rng.standard_normal((3000, 2)) @ rng.standard_normal((2, 50)) + 3).astype(np.float32)
    space = fit_eigenspace(plane, k=9, memory=memory)
    assert space.k == 2
    assert space.energy == pytest.approx(1, abs=1e-5)


def test_coordinates_of_the_frames_have_the_eigenvalues_as_mean_squares():
    frames = frames_of(50, 200)
    space = fit_eigenspace(frames, k=4)
    z = space.project_many(frames)
    np.testing.assert_allclose(np.mean(z.astype(np.float64) ** 2, axis=0), space.eigenvalues, rtol=1e-3)
    np.testing.assert_allclose(z, [space.project(x) for x in frames], atol=1e-3)


PROJECTION = """
import sys
import numpy as np
from models.eigenspace import Eigenspace
rng = np.random.default_rng(0)
basis, x = rng.standard_normal((25, 19200)), rng.random(19200).astype(np.float32)
space = Eigenspace(np.full(19200, 0.5), basis, np.ones(25), 30.0)
z = space.project(x)
print(z.tobytes().hex(), space.distance(x * 9, z))
"""


def test_a_projection_has_equal_bytes_by_any_number_of_blas_threads():
    said = {
        subprocess.run(
            [sys.executable, "-c", PROJECTION],
            env={**os.environ, "OPENBLAS_NUM_THREADS": threads},
            check=True,
            capture_output=True,
        ).stdout
        for threads in ("1", "2", "3")
    }
    assert len(said) == 1
    assert len(said.pop().split()[0]) == 25 * 8


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        ([], "no frame"),
        ([np.ones(4, np.float32)], "one frame"),
        ([np.full(4, 0.3, np.float32)] * 9, "9 frames, all alike"),
        ([np.ones(4, np.float32), np.full(4, np.nan, np.float32)], "not numbers"),
        ([np.ones(4, np.float32), np.ones(5, np.float32)], r"frame 1 has shape \(5,\), the first one \(4,\)"),
    ],
)
def test_frames_that_span_nothing_are_refused_with_a_sentence(frames: list[np.ndarray], said: str):
    with pytest.raises(LearningError, match=said):
        fit_eigenspace(frames)


def test_frames_that_can_be_read_only_once_will_do_where_they_fit_in_memory():
    frames = frames_of(100, 50)
    once, again = fit_eigenspace(iter(frames), k=3), fit_eigenspace(frames, k=3)
    assert once.basis.tobytes() == again.basis.tobytes()


def test_frames_that_are_others_when_read_again_are_refused():
    frames = frames_of(100, 50)
    once = iter(frames)
    with pytest.raises(LearningError, match=r"0 frames when read again, 100 when read first"):
        fit_eigenspace(lambda: once, memory=2**10)


@pytest.mark.parametrize(("wrong", "said"), [({"k": 0}, "of 0 dimensions"), ({"energy": 1.5}, "hold is 1.5")])
def test_a_choice_that_makes_no_sense_is_refused(wrong: dict[str, float], said: str):
    with pytest.raises(LearningError, match=said):
        fit_eigenspace(frames_of(9, 9), **wrong)


def test_what_was_saved_projects_the_same():
    frames = frames_of(20, 30)
    space = fit_eigenspace(frames, k=3)
    read = Eigenspace.from_arrays(space.arrays())
    assert read.project(frames[0]).tobytes() == space.project(frames[0]).tobytes()
    assert read.energy == space.energy
    assert not read.basis.flags.writeable


@pytest.mark.parametrize("harm", [{"mean": np.zeros(5)}, {"total_variance": np.zeros(0)}, {"basis": np.zeros(4)}])
def test_damaged_arrays_are_refused(harm: dict[str, np.ndarray]):
    arrays = fit_eigenspace(frames_of(20, 30), k=3).arrays() | harm
    with pytest.raises(AppearanceError, match="eigenspace"):
        Eigenspace.from_arrays(arrays)
