"""The leading eigenvectors of the covariance C of frames that need not fit in memory; never p x p.

Few frames: the Gram matrix (Murakami and Kumar, IEEE PAMI 4(5), 1982), exact. Many frames: block Krylov iteration,
where each reading of the frames multiplies C with a block of directions, and Rayleigh-Ritz over all directions
multiplied so far needs no further reading (Musco and Musco, NeurIPS 2015); its residual C v - theta v comes free and
tells when to stop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
from jaxtyping import Float, Float32, Float64

from models.errors import LearningError

GRAM_FRAMES = 2048
"""Up to as many frames the Gram matrix is used, if its multiplications stay below GRAM_WORK (about a second)."""
GRAM_WORK = 3e10
PASSES = 8
"""Readings of the frames at most. Where the spectrum is flat about k, directions cannot be told apart, nor need be."""
TOLERANCE = 0.02
"""Largest residual ||C v - theta v|| / theta of a wanted direction; theta is then right to about its square."""
EXTRA = 12
"""Directions iterated beyond the wanted ones."""
BLOCK = 256
"""Frames multiplied at once."""


@dataclass(frozen=True)
class Choice:
    """How many directions: `k` of them, or the fewest that hold `energy` of the variance, `k_max` at most."""

    k: int | None
    energy: float
    k_max: int

    def count(self, values: Float64[np.ndarray, " n"], total: float) -> int:
        """How many of these eigenvalues (descending) to keep."""
        if self.k is not None:
            return min(self.k, len(values))
        return min(self._enough(values, total), self.k_max, len(values))

    def reached(self, values: Float64[np.ndarray, " n"], total: float) -> bool:
        """Whether as many as wanted are among these eigenvalues."""
        return len(values) >= (self.k or min(self.k_max, self._enough(values, total)))

    def _enough(self, values: Float64[np.ndarray, " n"], total: float) -> int:
        # A share of 1 is never reached exactly in floating point.
        return int(np.searchsorted(np.cumsum(values), self.energy * total * (1 - 1e-9))) + 1


@dataclass(frozen=True, eq=False)
class Directions:
    """Mean (p,), orthonormal rows (k, p), their eigenvalues descending, and the sum of all p eigenvalues."""

    mean: Float64[np.ndarray, " p"]
    rows: Float64[np.ndarray, "k p"]
    values: Float64[np.ndarray, " k"]
    total: float


def principal_directions(
    read: Callable[[], Iterable[Float32[np.ndarray, " p"]]], choice: Choice, memory: int
) -> Directions:
    """Leading directions of the frames that `read` opens anew at each call; at most `memory` bytes of them are held.

    Raises LearningError where the frames span nothing, change their length, or are others when read again.
    """
    frames = _Frames(read, memory)
    block = min(frames.p, EXTRA + (choice.k or min(choice.k_max, 20)))
    start = _orthonormal(np.random.default_rng(0).standard_normal((frames.p, block)))
    product = frames.multiply(start)
    if frames.kept is not None and frames.count <= GRAM_FRAMES and frames.count**2 * frames.p <= GRAM_WORK:
        values, rows = _gram(frames, choice)
    else:
        values, rows = _krylov(frames, choice, start, product)
    return Directions(frames.mean, _signed(rows), values, frames.total)


class _Frames:
    """The frames in blocks of rows: kept from the first reading on where they fit, else read again each time."""

    def __init__(self, read: Callable[[], Iterable[Float32[np.ndarray, " p"]]], memory: int) -> None:
        opened = iter(read())
        first = next(opened, None)
        if first is None:
            raise LearningError("no frame to learn from, at least two different ones are needed")
        self.read = read
        self.opened = chain([first], opened)
        """The first reading, one frame of which had to be seen to know p."""
        self.memory = memory
        self.origin = np.array(first, np.float32)
        """A point near the frames. Products and squares about zero would cancel: the mean holds most of the energy."""
        self.p = self.origin.size
        self.rows = max(1, min(BLOCK, memory // (8 * self.origin.nbytes)))
        self.kept: list[Float32[np.ndarray, "n p"]] | None = None
        self.count = 0
        self.mean: Float64[np.ndarray, " p"] = self.origin.astype(np.float64)
        self.total = 0.0

    def multiply(self, directions: Float32[np.ndarray, "p n"]) -> Float32[np.ndarray, "p n"]:
        """C @ directions, in one reading of the frames; the first one also finds count, mean and total variance."""
        shift = self.mean.astype(np.float32) @ directions
        product = np.zeros(directions.shape)
        sums = np.zeros(directions.shape[1])
        for block in self._blocks() if self.count else self._first():
            along = block @ directions
            along -= shift
            product += block.T @ along
            sums += along.sum(axis=0, dtype=np.float64)
        # (A - 1 m')' B = A' B - m (1' B), whatever B was shifted by.
        product -= np.outer(self.mean, sums)
        return (product / self.count).astype(np.float32)

    def _blocks(self) -> Iterator[Float32[np.ndarray, "n p"]]:
        if self.kept is not None:
            yield from self.kept
            return
        seen = 0
        for block in self._stacked(self.read(), np.empty((self.rows, self.p), np.float32)):
            seen += len(block)
            yield block
        if seen != self.count:
            raise LearningError(f"{seen} frames when read again, {self.count} when read first; both must be the same")

    def _first(self) -> Iterator[Float32[np.ndarray, "n p"]]:
        kept: list[Float32[np.ndarray, "n p"]] | None = []
        sums, squares, count = np.zeros(self.p), 0.0, 0
        for block in self._stacked(self.opened, None):
            yield block
            count += len(block)
            # float32 over the few hundred rows of a block, float64 over blocks: a third of the time, 1e-6 of a pixel.
            sums += block.sum(axis=0)
            squares += sum(_squares(block[i : i + 32] - self.origin) for i in range(0, len(block), 32))
            kept = [*kept, block] if kept is not None and count * self.origin.nbytes <= self.memory else None
        mean = sums / count
        total = squares / count - float(np.sum((mean - self.origin) ** 2))
        self.count, self.mean, self.total, self.kept = count, mean, total, kept
        # float32 pixels that differ by rounding alone have a relative variance of 1e-14.
        if count < 2 or not total > 1e-12 * float(mean @ mean):
            alike = "all alike" if np.isfinite(total) else "not numbers"
            said = "one frame" if count == 1 else f"{count} frames, {alike}"
            raise LearningError(f"{said}: nothing to learn from, at least two different ones are needed")

    def _stacked(
        self, xs: Iterable[Float32[np.ndarray, " p"]], buffer: Float32[np.ndarray, "r p"] | None
    ) -> Iterator[Float32[np.ndarray, "n p"]]:
        """Blocks of frames, in the one buffer or each in an array of its own."""
        block, filled = np.empty(0), 0
        for index, x in enumerate(xs):
            if not filled:
                block = np.empty((self.rows, self.p), np.float32) if buffer is None else buffer
            if x.shape != (self.p,):
                raise LearningError(f"frame {index} has shape {x.shape}, the first one ({self.p},): must be the same")
            block[filled] = x
            filled += 1
            if filled == self.rows:
                yield block
                filled = 0
        if filled:
            yield block[:filled]


def _gram(frames: _Frames, choice: Choice) -> tuple[Float64[np.ndarray, " k"], Float64[np.ndarray, "k p"]]:
    """By the eigenvectors of the frames' M x M matrix of inner products, in float64 over chunks of pixels."""
    from scipy.linalg import eigh  # noqa: PLC0415 (half a second that scoring does not need)

    m, starts = frames.count, range(0, frames.p, 2048)
    kept = frames.kept or []

    def chunk(start: int) -> Float64[np.ndarray, "m n"]:
        part = slice(start, start + 2048)
        return np.concatenate([block[:, part] for block in kept]).astype(np.float64) - frames.mean[part]

    gram = np.zeros((m, m))
    for start in starts:
        pixels = chunk(start)
        gram += pixels @ pixels.T
    most = min(choice.k or choice.k_max, m)
    values, vectors = eigh(gram, subset_by_index=[m - most, m - 1], overwrite_a=True)
    values, vectors = values[::-1] / m, vectors[:, ::-1]
    # Below, the inner products of float32 pixels hold nothing but rounding.
    values = values[values > 1e-10 * values[0]]
    values = values[: choice.count(values, frames.total)]
    rows = np.concatenate([vectors[:, : len(values)].T @ chunk(start) for start in starts], axis=1)
    return values, rows


def _krylov(
    frames: _Frames, choice: Choice, block: Float32[np.ndarray, "p n"], product: Float32[np.ndarray, "p n"]
) -> tuple[Float64[np.ndarray, " k"], Float64[np.ndarray, "k p"]]:
    """By Rayleigh-Ritz in the space of all blocks multiplied so far; the residuals of the best make the next block."""
    basis, image, size = block, product, block.shape[1]
    # Two arrays of p x n float32 are held; beyond `most` columns only the best directions are carried on.
    most = max(3 * size + choice.k_max, frames.memory // (8 * frames.p))
    for reading in range(1, PASSES + choice.k_max // size + 1):
        theta, ritz = _ritz(basis, image)
        count = choice.count(theta, frames.total)
        wanted = ritz[:, : max(size, count)]
        residuals = image @ wanted - basis @ (wanted * theta[: wanted.shape[1]].astype(np.float32))
        errors = np.linalg.norm(residuals, axis=0)
        reached = choice.reached(theta, frames.total)
        if reached and (reading >= PASSES or bool(np.all(errors[:count] <= TOLERANCE * theta[:count]))):
            break
        # Residuals of rounding size say that the frames span no more.
        block = _orthonormal(residuals[:, errors > 1e-6 * theta[0]][:, :size], basis)
        if not block.size:
            break
        if basis.shape[1] + block.shape[1] > most:
            carried = ritz[:, : count + EXTRA]
            basis, image = basis @ carried, image @ carried
        basis, image = np.hstack([basis, block]), np.hstack([image, frames.multiply(block)])
    theta, ritz = _ritz(basis, image)
    count = choice.count(theta, frames.total)
    return theta[:count], (basis @ ritz[:, :count]).T.astype(np.float64)


def _ritz(
    basis: Float32[np.ndarray, "p n"], image: Float32[np.ndarray, "p n"]
) -> tuple[Float64[np.ndarray, " r"], Float32[np.ndarray, "n r"]]:
    """Eigenvalues of C in the space of the basis, descending, and their vectors in its coordinates."""
    inner = (basis.T @ image).astype(np.float64)
    theta, ritz = np.linalg.eigh((inner + inner.T) / 2)
    # The products are float32: below a millionth of the first they are rounding.
    kept = int(np.count_nonzero(theta > 1e-6 * theta[-1]))
    return theta[::-1][:kept], ritz[:, ::-1][:, :kept].astype(np.float32)


def _orthonormal(
    block: Float[np.ndarray, "p n"], against: Float32[np.ndarray, "p m"] | None = None
) -> Float32[np.ndarray, "p r"]:
    """Orthonormal columns that span the block, less what `against` spans; dependent columns are left out."""
    block = block / np.linalg.norm(block, axis=0)
    for _ in range(0 if against is None else 2):
        block = block - against @ (against.T @ block)  # pyright: ignore[reportOptionalMemberAccess, reportOperatorIssue]
    q, r = np.linalg.qr(block.astype(np.float64))
    return q[:, np.abs(np.diag(r)) > 1e-4].astype(np.float32)


def _signed(rows: Float64[np.ndarray, "k p"]) -> Float64[np.ndarray, "k p"]:
    """Orthonormal to float64, with the component of largest magnitude of each row positive: signs must not wander."""
    q, _ = np.linalg.qr(rows.T)
    largest = q[np.abs(q).argmax(axis=0), np.arange(q.shape[1])]
    return (q * np.sign(largest)).T


def _squares(block: Float32[np.ndarray, "n p"]) -> float:
    return float(np.einsum("ij,ij->i", block, block).sum(dtype=np.float64))
