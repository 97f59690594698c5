"""Does learning 10,000 frames stay under 1 GiB, and is it no slower than scikit-learn's randomized PCA?

Run by hand, on one thread: python -m tests.benchmarks.learning [--frames 10000] [--k 20]

A synthetic sweep (a window of 160 x 120 panned over a textured part, with sensor noise) lies on disk as uint8. Ours
reads and prepares the frames from there at each pass; scikit-learn gets them prepared, as one float32 matrix in memory,
and its time does not include preparing. Peak memory is that of a process of its own for each (Linux only).
"""

from __future__ import annotations

import argparse
import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from models.eigenspace import Eigenspace, fit_eigenspace
from models.preparation import Preparation

WIDTH, HEIGHT = 160, 120
LENGTH = WIDTH * HEIGHT


def draw_sweep(path: Path, frames: int) -> None:
    """A window panned along a winding path over texture of many scales, with noise of 2 grey levels."""
    rng = np.random.default_rng(1)
    part = np.zeros((900, 2200), np.float32)
    for sigma in (2, 5, 12, 30, 80):
        layer = cv2.GaussianBlur(rng.standard_normal(part.shape).astype(np.float32), (0, 0), sigma)
        part += layer / layer.std() * np.float32(4 * sigma**0.5)
    part += np.float32(128)
    noise = (2 * rng.standard_normal((64, HEIGHT, WIDTH))).astype(np.float32)
    sweep = np.memmap(path, np.uint8, "w+", shape=(frames, HEIGHT, WIDTH))
    for i, s in enumerate(np.linspace(0, 1, frames)):
        centre = (100 + 2000 * s, 450 + 300 * np.sin(6 * np.pi * s))
        picture = cv2.getRectSubPix(part, (WIDTH, HEIGHT), centre) + noise[rng.integers(64)]
        sweep[i] = np.clip(np.rint(picture), 0, 255)


def prepared(path: Path) -> Callable[[], Iterator[np.ndarray]]:
    """Opens the sweep anew and prepares frame by frame."""
    preparation = Preparation().bind((WIDTH, HEIGHT))

    def read() -> Iterator[np.ndarray]:
        sweep = np.asarray(np.memmap(path, np.uint8, "r")).reshape(-1, HEIGHT, WIDTH)
        return (preparation.prepare(frame) for frame in sweep)

    return read


def ours(path: Path, k: int) -> Eigenspace:
    return fit_eigenspace(prepared(path), k=k)


def matrix(path: Path) -> np.ndarray:
    count = path.stat().st_size // LENGTH
    return np.stack(list(prepared(path)())) if count else np.empty((0, LENGTH))


def sklearns(xs: np.ndarray, k: int) -> np.ndarray:
    from sklearn.decomposition import PCA

    return PCA(k, svd_solver="randomized", random_state=0).fit(xs).components_


def exact(xs: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean, p x p eigenvectors (leading last) and total variance, by brute force: for judging only."""
    from scipy.linalg import eigh

    mean = xs.mean(axis=0, dtype=np.float64)
    gram = np.zeros((len(xs), len(xs)))
    for start in range(0, LENGTH, 1024):
        part = xs[:, start : start + 1024] - mean[start : start + 1024]
        gram += part @ part.T
    values, vectors = eigh(gram, subset_by_index=[len(xs) - 40, len(xs) - 1])
    rows = (vectors / np.sqrt(values)).T @ (xs - mean.astype(np.float32))
    return rows[::-1], values[::-1] / len(xs), float(np.trace(gram)) / len(xs)


def judge(rows: np.ndarray, xs: np.ndarray, true: tuple[np.ndarray, np.ndarray, float]) -> dict[str, float]:
    """Share of the best possible variance that is held, and the largest principal angle to the exact space."""
    reference, values, _ = true
    k = len(rows)
    held = 0.0
    mean = xs.mean(axis=0, dtype=np.float64).astype(np.float32)
    for start in range(0, len(xs), 500):
        held += float(np.sum(((xs[start : start + 500] - mean) @ rows.T.astype(np.float32)) ** 2, dtype=np.float64))
    cosines = np.linalg.svd(rows.astype(np.float64) @ reference[:k].T, compute_uv=False)
    leading = np.linalg.svd(rows.astype(np.float64) @ reference[: k // 2].T, compute_uv=False)
    return {
        "held": held / len(xs) / float(values[:k].sum()),
        "angle": float(np.degrees(np.arccos(min(1.0, cosines.min())))),
        "angle_half": float(np.degrees(np.arccos(min(1.0, leading.min())))),
    }


def peak() -> float:
    """Peak memory of this process in MiB. Not by getrusage, which counts the parent's memory at the fork as ours."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def peak_of(who: str, path: Path, k: int) -> float:
    """Peak memory in MiB of a process that does nothing but learn."""
    command = [sys.executable, "-m", "tests.benchmarks.learning", "--only", who, "--data", str(path), "--k", str(k)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)["peak"]


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def compare(path: Path, k: int, rounds: int, angles: bool) -> None:
    xs = matrix(path)
    ours(path, 1), sklearns(xs[:50], 1)  # imports
    times = [(seconds(lambda: ours(path, k)), seconds(lambda: sklearns(xs, k))) for _ in range(rounds)]
    own, other = (min(column) for column in zip(*times, strict=True))
    own_peak, other_peak = peak_of("ours", path, k), peak_of("sklearn", path, k)
    print(f"{len(xs)} frames of {WIDTH} x {HEIGHT}, k = {k}, one thread, best of {rounds} in turn")
    print(f"{'':24}{'ours':>12}{'scikit-learn':>14}{'ratio':>8}")
    print(f"{'seconds':24}{own:12.2f}{other:14.2f}{own / other:8.2f}")
    print(f"{'peak memory, MiB':24}{own_peak:12.0f}{other_peak:14.0f}{own_peak / other_peak:8.2f}")
    if angles:
        true = exact(xs)
        mine, theirs = judge(ours(path, k).basis, xs, true), judge(sklearns(xs, k), xs, true)
        print(f"{'variance held / best':24}{mine['held']:12.6f}{theirs['held']:14.6f}")
        print(f"{'largest angle, degrees':24}{mine['angle']:12.3f}{theirs['angle']:14.3f}")
        print(f"{'  of the leading half':24}{mine['angle_half']:12.3f}{theirs['angle_half']:14.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--k", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--angles", action="store_true", help="compare with the exact space too: minutes and gigabytes")
    parser.add_argument("--data", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--only", choices=("ours", "sklearn"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.only:
        ours(given.data, given.k) if given.only == "ours" else sklearns(matrix(given.data), given.k)
        print(json.dumps({"peak": peak()}))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sweep.u8"
        draw_sweep(path, given.frames)
        compare(path, given.k, given.rounds, given.angles)


if __name__ == "__main__":
    main()
