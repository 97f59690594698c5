"""What does locating one picture cost, which search is the fastest, and how far off are the places found?

Run by hand, on one thread:

    python -m tests.benchmarks.locating                      # the simulated camera: searches, cost, places
    python -m tests.benchmarks.locating --coil FOLDER        # turntables: pictures NAME__NUMBER.png, 5 degrees apart
    python -m tests.benchmarks.locating --surface SCAN...    # a camera over scanned surfaces, 320x240 pixels of each

Searches: the closest of 15,625 resampled points of a manifold over x, y and turn, in 15 dimensions. Nene and Nayar's
sorted projections (IEEE PAMI 19(9), 1997) in NumPy, SciPy's k-d tree, a flat scan by one matrix-vector product, faiss
(flat and HNSW) where it is installed. Times are of the thread's own clock, the best of several rounds per picture.
"""

from __future__ import annotations

import argparse
import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import importlib
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from time import thread_time
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

import models.workspace.learning
from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.cameras.simulated.render import Pose
from inspector.labels import read_picture
from models.workspace import LabelledPicture, Located, Parameter, Workspace, learn_workspace

Camera = Callable[[Sequence[float], int], np.ndarray]
"""The picture from a place (x, y in pixels of the picture, turn in degrees), with the noise of this number."""
VIEW = (320, 240)
NOISE, LIGHT = 2.0, 0.1
"""Of the pictures located: standard deviation in grey levels, and by how much the lamp is weaker or stronger."""


def simulated() -> Camera:
    """A plate under the simulated camera, drawn anew for every place."""
    camera = open_camera("simulated:?jpeg=0&vibration=0")
    assert isinstance(camera, SimulatedCamera)

    def look(q: Sequence[float], number: int) -> np.ndarray:
        x, y, turn = (*q, 0.0)[:3]
        return camera.look(Pose(480 + x, 260 + y, float(np.deg2rad(turn))), number).pixels

    return look


def over(scan: np.ndarray) -> Camera:
    """Over the middle of a scanned surface, contrast softened as a lens does."""
    surface = 45 + 140 / 255 * cv2.GaussianBlur(scan.astype(np.float32), (0, 0), 1.0)

    def look(q: Sequence[float], number: int) -> np.ndarray:
        x, y, turn = (*q, 0.0)[:3]
        width, height = VIEW
        lens = cv2.getRotationMatrix2D((width / 2, height / 2), turn, 1.0)
        lens[:, 2] += np.array([scan.shape[1] / 2 + x, scan.shape[0] / 2 + y]) - np.array([width, height]) / 2
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpAffine(surface, lens, VIEW, flags=flags, borderMode=cv2.BORDER_REFLECT)
        noise = np.random.default_rng(number).normal(0, NOISE, seen.shape)
        return np.clip(seen + noise, 0, 255).astype(np.uint8)

    return look


def grid(look: Camera, axes: Sequence[np.ndarray]) -> Iterator[LabelledPicture]:
    """Turn by turn, as the simulated camera draws quickest."""
    for number, q in enumerate(product(*reversed(axes))):
        yield LabelledPicture("part", q[::-1], look(q[::-1], number))


def between(look: Camera, axes: Sequence[np.ndarray], count: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Random places, and pictures from there in other light."""
    rng = np.random.default_rng(1)
    for number in range(count):
        q = np.array([rng.uniform(axis[0], axis[-1]) for axis in axes])
        seen = look(q.tolist(), 100_000 + number) * rng.uniform(1 - LIGHT, 1 + LIGHT)
        yield q, np.clip(seen, 0, 255).astype(np.uint8)


def best_ms(work: Callable[[], object], rounds: int = 5) -> float:
    """Of the thread's own time."""
    times: list[float] = []
    for _ in range(rounds):
        begun = thread_time()
        work()
        times.append(thread_time() - begun)
    return 1e3 * min(times)


def sorted_projections(points: np.ndarray) -> Callable[[np.ndarray], int]:
    """Nene and Nayar's search: a cube about z is trimmed coordinate by coordinate, from a list sorted by the first.

    The cube begins with the usual distance of neighbours and is doubled while it is empty; once it holds a point, it is
    as wide as that point is far, which makes the answer exact.
    """
    order = np.argsort(points[:, 0])
    first = points[order, 0]
    usual = float(np.median(cKDTree(points).query(points[::50], k=2)[0][:, 1]))

    def inside(z: np.ndarray, half: float) -> np.ndarray:
        low, high = np.searchsorted(first, (z[0] - half, z[0] + half))
        found = order[low:high]
        for i in range(1, len(z)):
            found = found[np.abs(points[found, i] - z[i]) <= half]
        return found

    def search(z: np.ndarray) -> int:
        half = usual
        while not len(found := inside(z, half)):
            half *= 2
        away = np.square(points[found] - z).sum(axis=1)
        if away.min() > half**2:
            found = inside(z, float(away.min()) ** 0.5)
            away = np.square(points[found] - z).sum(axis=1)
        return int(found[away.argmin()])

    return search


def searches(points: np.ndarray) -> Iterator[tuple[str, Callable[[np.ndarray], int]]]:
    """Each finds the closest of the points (n, k), float32."""
    halves, tree = np.einsum("ij,ij->i", points, points) / 2, cKDTree(points)
    yield "flat scan, one product", lambda z: int((halves - points @ z).argmin())
    yield "k-d tree (SciPy)", lambda z: int(tree.query(z)[1])
    yield "sorted projections (Nene, Nayar)", sorted_projections(points)
    try:
        faiss: Any = importlib.import_module("faiss")
    except ImportError:
        print("  faiss is not installed here")
        return
    faiss.omp_set_num_threads(1)
    for name, index in (
        ("faiss, flat", faiss.IndexFlatL2(points.shape[1])),
        ("faiss, HNSW", faiss.IndexHNSWFlat(points.shape[1], 32)),
    ):
        index.add(points)
        yield name, lambda z, index=index: int(index.search(z[None], 1)[1][0, 0])


def compare_searches(workspace: Workspace, seen: Sequence[np.ndarray]) -> None:
    """On the points that locating scans."""
    (learnt,) = workspace.learnt
    _, points = learnt.white.resample(25)
    points = np.ascontiguousarray(points[:, :15], np.float32)
    zs = [(learnt.seen(workspace.look.x(pixels))[0] @ learnt.whiten)[:15].astype(np.float32) for pixels in seen]
    right = [int(np.square(points.astype(float) - z).sum(axis=1).argmin()) for z in zs]
    print(f"closest of {len(points)} points in {points.shape[1]} dimensions, {len(zs)} pictures")
    for name, search in searches(points):
        search(zs[0])
        cost = float(np.mean([best_ms(lambda z=z, search=search: search(z)) for z in zs]))
        same = np.mean([search(z) == index for z, index in zip(zs, right, strict=True)])
        print(f"  {name:34s} {1e3 * cost:8.0f} us   {same:7.2%} the closest")


def told(found: Sequence[tuple[np.ndarray, Located]], spacing: np.ndarray) -> None:
    """Errors in shares of the spacing."""
    known = [(q, each) for q, each in found if each.q is not None]
    errors = np.abs([np.array(each.q) - q for q, each in known]) / spacing
    doubts = np.array([each.uncertainty for _, each in known]) / spacing
    states = [each.state for _, each in found]
    counts = ", ".join(f"{states.count(state)} {state}" for state in ("known", "ambiguous", "unknown"))
    high = np.quantile(errors, 0.95, axis=0).round(3)
    print(f"  of the spacing: mean {errors.mean(axis=0).round(4)}, 95 % below {high}")
    print(f"  error in stated uncertainties: 68 % below {np.quantile(errors / doubts, 0.68):.2f}; {counts}")


def position(
    name: str, look: Camera, counts: Sequence[int], spacing: Sequence[float], places: int
) -> tuple[Workspace, list[np.ndarray]]:
    """Learn a grid about the middle, and locate places between."""
    axes = [step * (np.arange(count) - (count - 1) / 2) for count, step in zip(counts, spacing, strict=True)]
    parameters = [Parameter(each) for each in ("x", "y", "turn")[: len(counts)]]
    begun = thread_time()
    workspace = learn_workspace(grid(look, axes), parameters)
    by = ", ".join(f"{count} at {step:g}" for count, step in zip(counts, spacing, strict=True))
    print(f"{name}: {by}; k = {workspace.learnt[0].space.k}, learnt in {thread_time() - begun:.1f} s, drawing included")
    tried = list(between(look, axes, places))
    found = [(q, workspace.locate(pixels)) for q, pixels in tried]
    told(found, np.array(spacing))
    seen = [pixels for _, pixels in tried[:100]]
    cost = [best_ms(lambda pixels=pixels: workspace.locate(pixels), 3) for pixels in seen]
    print(f"  {np.mean(cost):.2f} ms per picture beyond decoding, 95 % below {np.quantile(cost, 0.95):.2f}")
    return workspace, seen


def turntables(folder: Path, parity: int) -> None:
    """Every second view is learnt, the others are located; objects of this parity, or all (2)."""
    names = sorted({path.name.split("__")[0] for path in folder.glob("*__*.png")}, key=lambda name: (len(name), name))
    names = names if parity == 2 else names[parity::2]
    views = {name: [read_picture(folder / f"{name}__{number}.png") for number in range(72)] for name in names}
    learnt = (LabelledPicture(name, (5.0 * i,), views[name][i]) for name in names for i in range(0, 72, 2))
    workspace = learn_workspace(learnt, [Parameter("angle_deg", 360)])
    found = [(name, 5.0 * i, workspace.locate(views[name][i])) for name in names for i in range(1, 72, 2)]
    right = [(angle, each) for name, angle, each in found if each.object == name and each.q is not None]
    errors = np.abs([((each.q or (0,))[0] - angle + 180) % 360 - 180 for angle, each in right])
    doubts = np.array([(each.uncertainty or (0,))[0] for _, each in right])
    known = np.array([each.state == "known" for _, each in right])
    states = [each.state for *_, each in found]
    print(f"{len(names)} objects, {len(workspace.to_bytes()) / 1e6:.1f} MB: {len(right) / len(found):.2%} recognised")
    print(f"  degrees: mean {errors.mean():.3f}, median {np.median(errors):.3f}, most {errors.max():.1f}")
    print(
        f"  of those not flagged: mean {errors[known].mean():.3f}; {states.count('ambiguous')} of {len(found)} flagged"
    )
    print(f"  error in stated uncertainties: 68 % below {np.quantile(errors / doubts, 0.68):.2f}")


def _grey(pixels: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--coil", type=Path, help="folder of turntable pictures")
    parser.add_argument("--surface", type=Path, nargs="+", help="pictures of surfaces, larger than 480x400")
    parser.add_argument("--spacing", type=float, default=5.0, help="of x and y, in pixels")
    parser.add_argument("--turn", type=float, default=1.0, help="of the turn, in degrees")
    parser.add_argument("--places", type=int, default=1000)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if options.coil:
        for parity in (0, 1, 2):
            turntables(options.coil, parity)
        return
    cameras = {path.name: over(_grey(read_picture(path))) for path in options.surface or ()}
    cameras = cameras or {"simulated": simulated()}
    for name, look in cameras.items():
        position(name, look, (21, 21), (options.spacing,) * 2, options.places)
        position(name, look, (11, 11, 11), (options.spacing, options.spacing, options.turn), options.places)
    if not options.surface:
        models.workspace.learning.OWN = 15
        print("as the figures ask for it, k = 15:")
        workspace, seen = position("simulated", simulated(), (11, 11, 11), (5.0, 5.0, 1.0), 200)
        compare_searches(workspace, seen)


if __name__ == "__main__":
    main()
