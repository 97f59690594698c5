"""Learn an appearance: one golden sweep gives the curve and the pictures, further ones what may differ."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from models.appearance import Appearance
from models.eigenspace import Eigenspace, fit_eigenspace
from models.encoder import positions
from models.errors import LearningError, SweepsDiffer
from models.frame import Frame
from models.golden import THUMB, GoldenSweep, check_alike, collect, coordinates, moves, turned
from models.ignored import Ignored
from models.limits import COARSE, FINE, Limits
from models.manifold import Manifold
from models.preparation import Preparation
from models.references import unpack
from models.registration import affine, choose_points, shrink_by, smooth
from models.rivals import rivals
from models.scoring import look, remember
from models.spread import (
    ODD,
    Odd,
    Shown,
    against,
    grown,
    highest,
    leave_one_out,
    odd,
    pack,
    tolerated,
    unpack_cells,
    usual,
)
from models.sweep import SweepFacts
from models.tolerance import levels

K = 32
"""Dimensions: enough to tell places apart; what is wrong with a part is not looked for here."""
K_TURNS, THUMB_TURNS = 64, 40
"""The same, and pixels across the thumbnails, where the picture turns instead of moving."""
_DOUBTFUL = 1.5
"""A frame that leaves this much more unexplained than usual may be misplaced, and shows nothing."""
_MOST = 5.0
"""Times the assumed limits that two golden sweeps may differ by: more would make the appearance blind."""
_SPOILT = 0.34
"""Share of the golden sweeps that may be odd, at the most."""
_SCALES = 3
"""Golden sweeps from which on the coarse scale is used: what is large and differs from part to part takes some."""
_SENSOR = 0.5
"""Noise of a thumbnail pixel in grey levels: what averaging leaves of a usual sensor's."""
_LEFT_OUT = "left_out", "left_out_reached", "left_out_usual"
"""Facts: golden sweeps that were left out, what they reached, and what golden sweeps usually reach."""
ShownBy = tuple[Shown, Float32[np.ndarray, " n"]]
Showing = Callable[[Appearance, Sequence[int]], Sequence[ShownBy]]
"""`shown_by` of the golden sweeps of these numbers, counted from 0, in that order."""
_FITS = 0.5
"""Share of the places in which a further golden sweep must agree with the reference sweep."""


def learn(
    sweeps: Sequence[Iterable[Frame]],
    progress: Callable[[float], None] | None = None,
    frames_expected: int | None = None,
    preparation: Preparation | None = None,
    ignore: Bool[np.ndarray, "h w"] | None = None,
    *,
    showing: Showing | None = None,
) -> Appearance:
    """An appearance from golden sweeps; the first one is the reference.

    `ignore` is a don't-care mask over the picture, True where nothing is said, in place of that of `preparation`.
    `showing` reads the further sweeps elsewhere, several at a time; what is learnt is the same.

    From three sweeps on, one that is unlike the others is left out: `facts["left_out"]` tells which, counted from 0,
    `facts["left_out_reached"]` what it reached of the assumed tolerance, and `facts["left_out_usual"]` what the others
    usually reach; see `left_out`.
    Each sweep is read once, unless the reference itself is the odd one. `progress` is told the share done, in [0, 1],
    where `frames_expected` (over all sweeps) is given. Deterministic. Raises LearningError where nothing can be
    learnt, and PictureError for a picture that does not fit the others.
    """
    if not sweeps:
        raise LearningError("no golden sweep given; at least one is needed")
    appearance = _learnt(sweeps, _ticker(progress, frames_expected), preparation, ignore, showing)
    if progress:
        progress(1.0)
    return appearance


def absorb(
    appearance: Appearance,
    frames: Iterable[Frame],
    progress: Callable[[float], None] | None = None,
    frames_expected: int | None = None,
) -> Appearance:
    """A new appearance that tolerates what one more good sweep shows, at the cost of reading that sweep.

    Its peak is what the sweep reaches against all those before; theirs are kept, though they would be lower now. So are
    the scales: an appearance of fewer than three golden sweeps has the fine one only. Raises LearningError for a
    sweep that does not fit the reference, or is unlike the golden sweeps.
    """
    cells = appearance.references.cells
    shown, reached = _shown(appearance, _ticker(progress, frames_expected)(frames), "the sweep")
    before = {key: data for key, data in zip(appearance.keys.tolist(), appearance.tolerance, strict=True) if data}
    peak = _fused(against(before, shown, cells), appearance.limits)
    known = np.array(appearance.peaks, np.float32)
    # two golden sweeps say little of what is usual
    most = ODD * float(usual(known)) if len(known) > 1 else _MOST
    if peak > most:
        raise LearningError(
            f"the sweep reaches {peak:.1f} times the assumed tolerance, where golden sweeps "
            f"{f'usually reach {np.median(known):.1f}' if len(known) > 1 else f'may reach {_MOST}'}: "
            "is this part defective?"
        )
    if progress:
        progress(1.0)
    both = [before, {key: pack(grown(unpack_cells(data, cells))) for key, data in shown.items()}]
    sweeps = int(appearance.facts["sweeps"]) + 1
    return replace(
        appearance,
        tolerance=tuple(highest(both, key, cells) for key in appearance.keys.tolist()),
        peaks=(*appearance.peaks, peak),
        reached=np.minimum(appearance.reached, reached),
        facts={**appearance.facts, "sweeps": str(sweeps), "added_to": appearance.id},
    )


def left_out(appearance: Appearance) -> tuple[Odd, ...]:
    """The golden sweeps that were given and left out, counted from 0; most likely their parts are defective."""
    told = (appearance.facts.get(name, "") for name in _LEFT_OUT)
    listed = zip(*(each.split(", ") if each else [] for each in told), strict=True)
    return tuple(Odd(int(sweep), float(reached), float(common)) for sweep, reached, common in listed)


def _learnt(
    sweeps: Sequence[Iterable[Frame]],
    tick: Callable[[Iterable[Frame]], Iterator[Frame]],
    preparation: Preparation | None,
    ignore: Bool[np.ndarray, "h w"] | None,
    showing: Showing | None,
    *,
    left: tuple[Odd, ...] = (),
) -> Appearance:
    """`left` are the sweeps that were left out already, all before these."""
    before, given = len(left), len(left) + len(sweeps)
    prepared, golden = collect(tick(sweeps[0]), preparation, ignore)
    appearance = _of_one(golden, prepared, preparation, len(sweeps))
    cells = appearance.references.cells
    further = range(before + 1, given)
    if showing is None:
        each = [shown_by(appearance, tick(sweeps[i - before]), i) for i in further]
    else:
        each = showing(appearance, further)
    shown = [maps for maps, _ in each]
    kept = np.ones(len(sweeps), bool)
    peaks = leave_one_out(shown, cells)
    while (worst := odd(peaks, kept)) is not None and kept.sum() - 1 >= given * (1 - _SPOILT):
        left = (*left, replace(worst, sweep=before + worst.sweep))
        if worst.sweep == 0:
            return _learnt(sweeps[1:], tick, preparation, ignore, showing, left=left)
        kept[worst.sweep] = False
        some = [maps for maps, keep in zip(shown, kept[1:], strict=True) if keep]
        peaks[kept] = leave_one_out(some, cells)
    some = [maps for maps, keep in zip(shown, kept[1:], strict=True) if keep]
    if len(some) == 1 and (differ := float(peaks[kept][1].max())) > _MOST:
        raise SweepsDiffer(
            f"two golden sweeps differ by {differ:.1f} times what is assumed of good parts (at the most {_MOST}): "
            "is one of the parts defective, or another product? A third sweep would tell which"
        )
    limits = _weighted(appearance.limits, peaks[kept])
    reached = [appearance.reached, *(lowest for (_, lowest), keep in zip(each, kept[1:], strict=True) if keep)]
    return replace(
        appearance,
        tolerance=tuple(tolerated(some, key, cells) for key in appearance.keys.tolist()),
        limits=limits,
        peaks=tuple(_fused(each, limits) for each in peaks[kept][1:]),
        reached=np.min(reached, axis=0),
        facts={**appearance.facts, "sweeps": str(len(some) + 1), **_told(left)},
    )


def _told(left: tuple[Odd, ...]) -> dict[str, str]:
    """What is kept of sweeps that were left out."""
    said = [(str(odd.sweep), f"{odd.reached:.2f}", f"{odd.usual:.2f}") for odd in sorted(left, key=lambda o: o.sweep)]
    return dict(zip(_LEFT_OUT, map(", ".join, zip(*said, strict=True)), strict=True)) if left else {}


def _weighted(limits: tuple[Limits, ...], peaks: Float32[np.ndarray, "sweeps scales"]) -> tuple[Limits, ...]:
    """Scales at which golden sweeps usually go beyond what is assumed weigh less than the scale of which this is least
    so: individuals of assembled products differ in detail more than at large."""
    if len(peaks) < 2:
        return limits
    usual = np.maximum(np.median(peaks[1:], axis=0), 1.0)
    weights = usual / usual.min()
    return tuple(replace(each, weight=float(weight)) for each, weight in zip(limits, weights, strict=True))


def _fused(peaks: Float32[np.ndarray, " scales"], limits: tuple[Limits, ...]) -> float:
    """The highest of what a sweep reached at each scale, in units of their limits."""
    return max(float(peak) / each.weight for peak, each in zip(peaks, limits, strict=True))


def _for_turns(golden: GoldenSweep, preparation: Preparation) -> Preparation:
    """What tells looks apart whose brightness says little: slopes, in colour where there is colour."""
    picture = unpack(golden.pictures[0])
    h, w = picture.shape[:2]
    shrink = max(1.0, max(w, h) / THUMB_TURNS)
    size = (max(1, round(w / shrink)), max(1, round(h / shrink)))
    return replace(preparation, size=size, colour=picture.ndim == 3, content="derivatives", sigma=1.0)


def _of_one(golden: GoldenSweep, preparation: Preparation, wanted: Preparation | None, sweeps: int) -> Appearance:
    facts = SweepFacts.of_stamps(golden.times, golden.sequences)
    ignored, width = Ignored.of(preparation.ignore), smooth(levels(unpack(golden.pictures[0]))).shape[1]
    shifts = moves(golden, width)
    if not shifts:
        preparation, golden = wanted or _for_turns(golden, preparation), turned(golden)
        for picture in map(unpack, golden.pictures):
            golden.x.append(preparation.prepare(picture))
            golden.points.append(choose_points(smooth(ignored.filled(levels(picture)))))
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
        (FINE, COARSE) if sweeps >= _SCALES else (FINE,),
        (),
        _noise(golden, preparation),
        facts.interval_ns,
        positions([golden.encoders[index] for index in golden.frames]),
        {"sweeps": str(sweeps), "frames": str(facts.frames), "numpy": np.__version__, "opencv": cv2.__version__},
    )
    if not shifts:
        return appearance
    wrong = rivals(appearance.guide, lambda place: smooth(ignored.filled(levels(unpack(golden.pictures[place])))))
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
    ignored = Ignored.of(preparation.ignore)
    for i, data in enumerate(golden.pictures):
        picture = ignored.filled(unpack(data))
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


def shown_by(appearance: Appearance, frames: Iterable[Frame], number: int) -> ShownBy:
    """What a further golden sweep shows, `number` counted from 0 among all; `showing` has to make it of each.

    Raises LearningError for a sweep that does not fit the reference, PictureError for a picture that does not.
    """
    return _shown(appearance, frames, f"golden sweep {number + 1}")


def _shown(appearance: Appearance, frames: Iterable[Frame], name: str) -> ShownBy:
    """What a sweep shows at each key place: scores in units of the assumed limits, the highest.

    And the lowest agreement with the reference picture that it reached at each place, 1 where it was not seen. Neither
    depends on what other sweeps showed.
    """
    plain = tuple(replace(limits, weight=1.0) for limits in appearance.limits)
    appearance = replace(appearance, limits=plain, reached=np.ones_like(appearance.reached))
    found: dict[int, np.ndarray] = {}
    kind = appearance.references.kind
    memory, scored, reached = remember(appearance), 0, np.ones(appearance.places, np.float32)
    for frame in frames:
        check_alike(kind, frame, name)
        usual = memory.trail.residual
        memory, seen = look(appearance, 1.0, memory, frame)
        if seen is None or seen.agreed is None:
            continue
        scored += 1
        key = seen.located.reference
        reached[key] = min(reached[key], max(seen.located.agreement, 0.0))
        if usual is not None and seen.located.registered.residual > _DOUBTFUL * usual:
            continue
        found[key] = np.maximum(found[key], seen.agreed) if key in found else seen.agreed
    if scored < _FITS * appearance.places:
        raise LearningError(
            f"{name} fits the reference sweep in {scored} of {appearance.places} places; "
            "is it the same product, swept the same way?"
        )
    return {key: pack(agreed) for key, agreed in found.items()}, reached
