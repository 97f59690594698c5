"""From pictures whose object and task parameters are known to a workspace."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import version

import numpy as np
from jaxtyping import Float32

from models.eigenspace import Eigenspace, fit_eigenspace
from models.errors import LearningError, PictureError
from models.manifold import Manifold
from models.workspace.grid import Grid, LabelledPicture, Parameter, check_parameters
from models.workspace.learnt import LearntObject, left_out, shrunk
from models.workspace.look import Look
from models.workspace.workspace import Workspace

SENSOR = 2.0
"""Noise that is assumed of every pixel, in grey levels of 255."""
ENERGY = 0.9999
UNIVERSAL, OWN = 32, 96
"""Dimensions at most: of the eigenspace of all objects, and of each."""


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
    look, seen, noise = _seen(pictures, parameters)
    everything = np.concatenate([np.stack(xs) for _, xs in seen.values()])
    universal = fit_eigenspace(everything, energy=0.95, k_max=UNIVERSAL)
    learnt: list[LearntObject] = []
    for name, (qs, xs) in seen.items():
        grid = Grid.of(name, np.array(qs, np.float64), parameters)
        learnt.append(_learnt(name, grid, np.stack(xs), tuple(each.period for each in parameters), floor=noise))
        if progress:
            progress(len(learnt) / len(seen))
    facts = {"pictures": str(len(everything)), "objects": str(len(seen))}
    facts |= {name: version(name) for name in ("numpy", "scipy", "opencv-python-headless")}
    return Workspace(parameters, look, universal, tuple(learnt), facts)


Seen = dict[str, tuple[list[tuple[float, ...]], list[Float32[np.ndarray, " p"]]]]
"""Of each object: q and x of its pictures."""


def _seen(pictures: Iterable[LabelledPicture], parameters: tuple[Parameter, ...]) -> tuple[Look, Seen, float]:
    """How pictures are looked at, all of them so, and the variance that the sensor's noise gives each coordinate."""
    look, seen, lengths = None, Seen(), list[float]()
    for picture in pictures:
        place = ", ".join(f"{each.name} {value:g}" for each, value in zip(parameters, picture.q, strict=False))
        if len(picture.q) != len(parameters):
            allowed = ", ".join(parameter.name for parameter in parameters)
            raise LearningError(f"object {picture.object}: {len(picture.q)} numbers at {place}; needed are {allowed}")
        if look is None:
            height, width = picture.pixels.shape[:2]
            look = Look.at((width, height), colour=picture.pixels.ndim == 3)
        try:
            x, length = look.seen(picture.pixels)
        except PictureError as error:
            raise PictureError(f"object {picture.object} at {place}: {error}") from error
        qs, xs = seen.setdefault(picture.object, ([], []))
        qs.append(picture.q)
        xs.append(x)
        lengths.append(max(length, 1e-9))
    if look is None:
        raise LearningError("no picture to learn from")
    return look, seen, (SENSOR / 255 * look.shrinks / float(np.median(lengths))) ** 2


def _learnt(
    name: str, grid: Grid, xs: Float32[np.ndarray, "n p"], periods: tuple[float | None, ...], *, floor: float
) -> LearntObject:
    try:
        space: Eigenspace = fit_eigenspace(xs, energy=ENERGY, k_max=OWN)
    except LearningError as error:
        raise LearningError(f"object {name}: {error}") from error
    z = space.project_many(xs)
    off = float(np.median([space.distance(x, at) ** 2 for x, at in zip(xs, z, strict=True)]))
    samples = z[grid.order]
    strays = left_out(samples, grid.axes, periods)
    noise = shrunk(strays, floor)
    farthest = float(np.square(strays).sum(axis=1).max()) if len(strays) else 4 * off
    return LearntObject(name, space, Manifold(grid.axes, samples, periods), noise, off, (farthest + 4 * off) ** 0.5)
