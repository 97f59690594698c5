"""From pictures whose object and task parameters are known to a workspace."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import version

import numpy as np
from jaxtyping import Float

from models.eigenspace import Eigenspace, fit_eigenspace
from models.errors import LearningError
from models.manifold import Manifold
from models.workspace.grid import Grid, LabelledPicture, Parameter, check_parameters
from models.workspace.learnt import LearntObject, left_out, shrunk
from models.workspace.seen import Eye, seen
from models.workspace.workspace import Workspace

UNIVERSAL, OWN, ENERGY = 32, 96, 0.9999
"""Dimensions at most: of the eigenspace of all objects, and of each; the share of the variance that this one holds."""
TRIED, BETTER = 8, 0.85
"""Objects by which it is told how to look at pictures; a finer look must lower the expected error to this share."""


def learn_workspace(
    pictures: Iterable[LabelledPicture],
    parameters: Sequence[Parameter],
    progress: Callable[[float], None] | None = None,
) -> Workspace:
    """What can be located among these objects. The pictures are read once; each is prepared, and kept so.

    The q of each object's pictures make a grid: the product of one to four axes, each of two values or more, evenly
    spaced or not; objects may differ in their axes. `progress` is called with the share done, once all are read.

    Raises LearningError where there is no picture, a parameter cannot be used, a place of a grid has no picture or
    two; PictureError that names object and place where pictures differ in size or type.
    """
    parameters = tuple(parameters)
    check_parameters(parameters)
    qs, eyes = seen(pictures, parameters)
    grids = {name: Grid.of(name, each, parameters) for name, each in qs.items()}
    periods = tuple(each.period for each in parameters)
    eye = _sharpest(eyes, grids, periods)
    everything = np.concatenate([eye.of(name) for name in grids])
    universal = fit_eigenspace(everything, energy=0.95, k_max=UNIVERSAL)
    learnt: list[LearntObject] = []
    for name, grid in grids.items():
        learnt.append(_learnt(name, grid, eye, periods))
        if progress:
            progress(len(learnt) / len(grids))
    facts = {"pictures": str(len(everything)), "objects": str(len(learnt))}
    facts |= {name: version(name) for name in ("numpy", "scipy", "opencv-python-headless")}
    return Workspace(parameters, eye.look, universal, tuple(learnt), facts)


def _sharpest(eyes: list[Eye], grids: Mapping[str, Grid], periods: tuple[float | None, ...]) -> Eye:
    """The coarsest look, unless a finer one is expected to place objects clearly better.

    Leaving samples out is the judge: fine texture helps as long as splines can follow it from sample to sample.
    """
    names = list(grids)[:: -(-len(grids) // TRIED)]
    best, least = eyes[0], np.inf
    for eye in eyes if len(eyes) > 1 else []:
        expected = float(np.median([_learnt(name, grids[name], eye, periods).expected for name in names]))
        if expected < BETTER * least:
            best, least = eye, expected
    return best


def _learnt(name: str, grid: Grid, eye: Eye, periods: tuple[float | None, ...]) -> LearntObject:
    xs = eye.of(name)
    try:
        space: Eigenspace = fit_eigenspace(xs, energy=ENERGY, k_max=OWN)
    except LearningError as error:
        raise LearningError(f"object {name}: {error}") from error
    z = space.project_many(xs)
    off = float(np.median([space.distance(x, at) ** 2 for x, at in zip(xs, z, strict=True)]))
    samples = z[grid.order]
    strays = left_out(samples, grid.axes, periods)
    noise = shrunk(strays, eye.noise)
    squares = np.square(strays).sum(axis=1) if len(strays) else _halfway(samples)
    limit = float(squares.max() + 4 * off) ** 0.5
    return LearntObject(name, space, Manifold(grid.axes, samples, periods), noise, off, limit)


def _halfway(samples: Float[np.ndarray, "*r k"]) -> Float[np.ndarray, " n"]:
    """Squared, from each sample to halfway to the next one: all that is known where two values make an axis."""
    steps = [np.diff(samples, axis=axis).reshape(-1, samples.shape[-1]) for axis in range(samples.ndim - 1)]
    return np.square(np.concatenate(steps)).sum(axis=1) / 4
