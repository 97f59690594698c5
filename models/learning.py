"""Learn an appearance: one golden sweep gives the curve and the pictures, further ones what may differ."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from models.appearance import Appearance
from models.eigenspace import Eigenspace, fit_eigenspace
from models.errors import LearningError
from models.frame import Frame
from models.golden import THUMB, GoldenSweep, check_alike, collect, coordinates, moves, turned
from models.limits import Limits
from models.manifold import Manifold
from models.preparation import Preparation
from models.references import unpack
from models.registration import affine, choose_points, shrink_by, smooth
from models.rivals import rivals
from models.scoring import look, remember, spread_beyond
from models.sweep import SweepFacts
from models.tolerance import levels

K = 32
"""Dimensions: enough to tell places apart; what is wrong with a part is not looked for here."""
K_TURNS, THUMB_TURNS = 64, 40
"""The same, and pixels across the thumbnails, where the picture turns instead of moving."""
_NEARLY_ALL = 0.98
"""Share of its frames that a golden sweep is judged by: a glitch or two says nothing of parts."""
_DOUBTFUL = 1.5
"""A frame that leaves this much more unexplained than usual may be misplaced, and widens nothing."""
_MOST = 5.0
"""Golden sweeps that differ by more than this, in units of the limit, would make the appearance blind."""
_MARGIN = 1.25
"""How far above what golden sweeps reached the limit is set."""
_SENSOR = 0.5
"""Noise of a thumbnail pixel in grey levels: what averaging leaves of a usual sensor's."""
_FITS = 0.5
"""Share of the places in which a further golden sweep must agree with the reference sweep."""


def learn(
    sweeps: Sequence[Iterable[Frame]],
    progress: Callable[[float], None] | None = None,
    frames_expected: int | None = None,
    preparation: Preparation | None = None,
) -> Appearance:
    """An appearance from golden sweeps; the first one is the reference, and each is read once.

    `progress` is told the share done, in [0, 1], where `frames_expected` (over all sweeps) is given. Deterministic.
    Raises LearningError where nothing can be learnt, and PictureError for a picture that does not fit the others.
    """
    if not sweeps:
        raise LearningError("no golden sweep given; at least one is needed")
    tick = _ticker(progress, frames_expected)
    prepared, golden = collect(tick(sweeps[0]), preparation)
    appearance = _of_one(golden, prepared, preparation, len(sweeps))
    peaks: list[float] = []
    for sweep in sweeps[1:]:
        peak, appearance = _widen(appearance, tick(sweep))
        peaks.append(peak)
    if peaks:
        # each sweep is scored against what was learnt before it: the last ones tell what is still to be expected
        reached = float(np.median(peaks[-3:]))
        if reached > _MOST:
            raise LearningError(
                f"the further golden sweeps differ from the reference sweep by {reached:.1f} times what is allowed "
                f"(at the most {_MOST}): is one of these parts defective, or another product?"
            )
        limits = Limits(factor=max(1.0, _MARGIN * reached), good_peak=max(peaks))
        appearance = replace(appearance, limits=limits)
    if progress:
        progress(1.0)
    return appearance


def _for_turns(golden: GoldenSweep, preparation: Preparation) -> Preparation:
    """What tells looks apart whose brightness says little: slopes, in colour where there is colour."""
    picture = unpack(golden.pictures[0])
    h, w = picture.shape[:2]
    shrink = max(1.0, max(w, h) / THUMB_TURNS)
    size = (max(1, round(w / shrink)), max(1, round(h / shrink)))
    return replace(preparation, size=size, colour=picture.ndim == 3, content="derivatives", sigma=1.0)


def _of_one(golden: GoldenSweep, preparation: Preparation, wanted: Preparation | None, sweeps: int) -> Appearance:
    facts = SweepFacts.of_stamps(golden.times, golden.sequences)
    width = smooth(levels(unpack(golden.pictures[0]))).shape[1]
    shifts = moves(golden, width)
    if not shifts:
        preparation, golden = wanted or _for_turns(golden, preparation), turned(golden)
        for picture in map(unpack, golden.pictures):
            golden.x.append(preparation.prepare(picture))
            golden.points.append(choose_points(smooth(levels(picture))))
    space = fit_eigenspace(golden.x, k=min(K if shifts else K_TURNS, len(golden.x) - 1))
    z = np.stack([space.project(x) for x in golden.x])
    n = len(golden.frames)
    appearance = Appearance(
        preparation,
        space,
        Manifold.over(coordinates(golden), z),
        _slopes(golden, preparation, space),
        np.array([*golden.motion, golden.motion[-1]], np.float32),
        shifts,
        _spare(golden.x, space),
        np.zeros(n, np.float32),
        np.ones(n, np.float32),
        np.array(golden.keys, np.int32),
        np.stack(golden.points),
        tuple(golden.pictures[key] for key in golden.keys),
        (b"",) * len(golden.keys),
        Limits(),
        _noise(golden, preparation),
        facts.interval_ns,
        {"sweeps": str(sweeps), "frames": str(facts.frames), "numpy": np.__version__, "opencv": cv2.__version__},
    )
    if not shifts:
        return appearance
    wrong = rivals(appearance.guide, lambda place: smooth(levels(unpack(golden.pictures[place]))))
    return replace(appearance, rivals=wrong)


def _ticker(
    progress: Callable[[float], None] | None, expected: int | None
) -> Callable[[Iterable[Frame]], Iterator[Frame]]:
    done = 0

    def tick(frames: Iterable[Frame]) -> Iterator[Frame]:
        nonlocal done
        for frame in frames:
            yield frame
            done += 1
            if progress and expected:
                progress(min(done / expected, 1.0))

    return tick


def _spare(x: Sequence[np.ndarray], space: Eigenspace) -> float:
    """Squared distance of a golden frame from the eigenspace, as a rule."""
    return float(np.median([space.distance(each, space.project(each)) ** 2 for each in x]))


def _noise(golden: GoldenSweep, preparation: Preparation) -> float:
    """What sensor noise does to a coordinate of z: unit energy divides it by the length of the thumbnail."""
    if not preparation.unit_energy:
        return _SENSOR / 255
    thumbnail = replace(preparation, unit_energy=False).prepare(unpack(golden.pictures[0]))
    return _SENSOR / max(255 * float(np.linalg.norm(thumbnail)), 1.0)


def _slopes(golden: GoldenSweep, preparation: Preparation, space: Eigenspace) -> np.ndarray:
    """Central differences of z over shift, rotation and shading of each reference picture: (n, 5, k)."""
    slopes = np.empty((len(golden.pictures), 5, space.k), np.float32)
    for i, data in enumerate(golden.pictures):
        picture = unpack(data)
        for j, (more, less, step) in enumerate(_varied(picture)):
            slopes[i, j] = space.basis @ (preparation.prepare(more) - preparation.prepare(less)) / np.float32(2 * step)
    return slopes


def _varied(picture: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    h, w = picture.shape[:2]
    by = shrink_by((w, h))
    pixel = max(w / THUMB, 1.0)
    for j, step in enumerate((pixel, pixel, 2 * pixel / w)):
        pose = np.zeros(3)
        pose[j] = step
        pair = [
            cv2.warpAffine(picture, affine(p, (w, h)), (w, h), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for p in (pose, -pose)
        ]
        yield pair[0], pair[1], step / (by if j < 2 else 1)
    top = np.iinfo(picture.dtype).max
    for axis in (1, 0):
        ramp = np.linspace(-0.1, 0.1, picture.shape[axis], dtype=np.float32)
        ramp = np.expand_dims(ramp, tuple(a for a in range(picture.ndim) if a != axis))
        pair = [np.clip(picture * (1 + sign * ramp), 0, top).astype(picture.dtype) for sign in (1, -1)]
        yield pair[0], pair[1], 0.1


def _widen(appearance: Appearance, frames: Iterable[Frame]) -> tuple[float, Appearance]:
    """Add what a further golden sweep shows beyond the band; and how high its frames scored before that."""
    excess = dict(zip(appearance.keys.tolist(), appearance.excess, strict=True))
    kind = appearance.references.kind
    memory, scores, reached = remember(appearance), list[float](), appearance.reached.copy()
    for frame in frames:
        check_alike(kind, frame, "a further golden sweep")
        usual = memory.trail.residual
        memory, shown = look(appearance, appearance.limits, memory, frame)
        if shown is None or shown.score is None:
            continue
        scores.append(shown.peak)
        located = shown.located
        reached[located.reference] = min(reached[located.reference], max(located.agreement, 0.0))
        if usual is not None and located.registered.residual > _DOUBTFUL * usual:
            continue
        for place, picture in spread_beyond(appearance, levels(frame.pixels), shown).items():
            excess[place] = _merged(excess[place], picture)
    if len(scores) < _FITS * appearance.places:
        raise LearningError(
            f"a further golden sweep fits the reference sweep in {len(scores)} of {appearance.places} places; "
            "is it the same product, swept the same way?"
        )
    return float(np.quantile(scores, _NEARLY_ALL)), replace(
        appearance, reached=reached, excess=tuple(excess[key] for key in appearance.keys.tolist())
    )


def _merged(old: bytes, picture: np.ndarray) -> bytes:
    if old:
        picture = np.maximum(picture, unpack(old))
    return cv2.imencode(".png", picture)[1].tobytes()
