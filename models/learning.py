"""Learn an appearance: one golden sweep gives the curve and the pictures, further ones what may differ."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from models.appearance import Appearance
from models.eigenspace import Eigenspace, fit_eigenspace
from models.errors import LearningError, PictureError
from models.frame import Frame
from models.limits import Limits
from models.manifold import Manifold
from models.preparation import Preparation
from models.registration import NO_LIGHT, Prior, Registered, Template, affine, choose_points, register, scan, shrink_by, smooth
from models.scoring import is_blind, look, remember, spread_beyond
from models.sweep import SweepFacts
from models.tolerance import levels

K = 32
"""Dimensions: enough to tell places apart; what is wrong with a part is not looked for here."""
_THUMB = 80
_STILL = 0.005
"""Share of the width by which a frame must have moved to be a place of its own."""
_SAME, _FOLLOWS = 0.9, 0.3
"""Agreement from which on a frame shows the place before it again; and at least continues it."""
_STEADY = 0.02
"""How much of its pace a steady camera gains or loses from frame to frame."""
_MARGIN = 1.25
_UNEVEN = 0.25
"""Median deviation of the travel per frame, as a share of it, up to which travel measures the way."""
_SENSOR = 0.5
"""Noise of a thumbnail pixel in grey levels: what averaging leaves of a usual sensor's."""


@dataclass
class _Collected:
    """What the first pass over the reference sweep keeps of it."""

    frames: list[int] = field(default_factory=list[int])
    x: list[np.ndarray] = field(default_factory=list[np.ndarray])
    pictures: list[bytes] = field(default_factory=list[bytes])
    points: list[np.ndarray] = field(default_factory=list[np.ndarray])
    motion: list[np.ndarray] = field(default_factory=list[np.ndarray])
    unsure: list[float] = field(default_factory=list[float])
    """Standard deviation of the length of each motion, in pixels."""
    times: list[int] = field(default_factory=list[int])
    sequences: list[int] = field(default_factory=list[int])


def learn(
    sweeps: Sequence[Iterable[Frame]],
    progress: Callable[[float], None] | None = None,
    frames_expected: int | None = None,
    preparation: Preparation | None = None,
) -> Appearance:
    """An appearance from golden sweeps; the first one is the reference, and each is read once.

    `progress` is told the share done, in [0, 1], where `frames_expected` (over all sweeps) is given. Raises
    LearningError where nothing can be learnt, and PictureError for a picture that does not fit the others.
    """
    if not sweeps:
        raise LearningError("no golden sweep given; at least one is needed")
    tick = _ticker(progress, frames_expected)
    preparation, collected = _collect(tick(sweeps[0]), preparation)
    facts = SweepFacts.of_stamps(collected.times, collected.sequences)
    space = fit_eigenspace(collected.x, k=min(K, len(collected.x) - 1))
    z = np.stack([space.project(x) for x in collected.x])
    s = _coordinates(collected)
    first = float(np.linalg.norm(cv2.imdecode(np.frombuffer(collected.pictures[0], np.uint8), cv2.IMREAD_GRAYSCALE)))
    pixels = collected.x[0].size
    appearance = Appearance(
        preparation,
        space,
        Manifold.over(s, z),
        _slopes(collected, preparation, space),
        np.array([*collected.motion, collected.motion[-1]], np.float32),
        np.stack(collected.points),
        tuple(collected.pictures),
        tuple(b"" for _ in collected.pictures),
        Limits(),
        _noise(collected, preparation, pixels, first),
        facts.interval_ns,
        {"sweeps": str(len(sweeps)), "frames": str(facts.frames), "numpy": np.__version__, "opencv": cv2.__version__},
    )
    peaks: list[float] = []
    for sweep in sweeps[1:]:
        peak, appearance = _widen(appearance, tick(sweep))
        peaks.append(peak)
    if peaks:
        reached = float(np.median(peaks[-3:]))
        limits = Limits(factor=max(1.0, _MARGIN * reached), good_peak=max(peaks))
        appearance = replace(appearance, limits=limits)
    if progress:
        progress(1.0)
    return appearance


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


def _coordinates(collected: _Collected) -> np.ndarray:
    """Sweep coordinate of each place: the share of the way, or of the time where the way cannot be told.

    Frames of a steady camera lie evenly in both, but the way does not mind an uneven pace. What moves in the picture
    measures the way only where it moves by about as much from frame to frame; else s is the share of frames.
    """
    frames = np.array(collected.frames, float)
    frames = (frames - frames[0]) / (frames[-1] - frames[0])
    way, steps = np.hypot(*np.array(collected.motion).T), np.diff(collected.frames)
    usual = float(np.median(way / steps))
    uneven = float(np.median(np.abs(way / steps - usual)))
    if usual <= 0 or uneven > _UNEVEN * usual:
        return frames
    # where texture is poor, the usual pace knows better than the picture
    trust = 1 / (1 + np.square(np.array(collected.unsure) / (_STEADY * usual)))
    way = usual * steps + trust * (way - usual * steps)
    return np.concatenate([[0.0], np.cumsum(way)]) / way.sum()


def _noise(collected: _Collected, preparation: Preparation, pixels: int, norm: float) -> float:
    """What sensor noise does to a coordinate of z, by the energy of a usual picture."""
    if not preparation.unit_energy:
        return _SENSOR / 255
    shape = cv2.imdecode(np.frombuffer(collected.pictures[0], np.uint8), cv2.IMREAD_GRAYSCALE).size
    return _SENSOR / max(norm * float(np.sqrt(pixels / shape)), 1.0)


def _collect(frames: Iterable[Frame], wanted: Preparation | None) -> tuple[Preparation, _Collected]:
    kept = _Collected()
    preparation: Preparation | None = None
    before: tuple[Template, np.ndarray] | None = None
    pose = np.zeros(3)
    pixels = None
    for index, frame in enumerate(frames):
        kept.times.append(frame.t_ns)
        kept.sequences.append(frame.sequence)
        if pixels is None:
            pixels = frame.pixels
            preparation = (wanted or default_preparation(frame.size)).bind(frame.size)
        check_alike(pixels, frame, "the reference sweep")
        picture = levels(frame.pixels)
        smoothed = smooth(picture)
        if is_blind(smoothed):
            continue
        if before is not None:
            moved = _moved(before, smoothed, pose)
            pose = moved.pose
            if _is_still(moved, smoothed.shape[1]):
                continue
            kept.motion.append(pose[:2])
            kept.unsure.append(_unsure(moved))
        points = choose_points(smoothed)
        before = (Template.of(smoothed, points), smoothed)
        kept.frames.append(index)
        kept.points.append(points)
        kept.x.append(preparation.prepare(frame.pixels))
        kept.pictures.append(_keep(frame))
    if preparation is None:
        raise LearningError("the reference sweep holds no frame; at least two that differ are needed")
    if len(kept.x) < 2:
        raise LearningError(
            f"the reference sweep shows {len(kept.x)} place(s) in {len(kept.times)} frame(s): "
            "pictures of one grey and standstills teach nothing; at least two places are needed"
        )
    return preparation, kept


def default_preparation(size: tuple[int, int]) -> Preparation:
    """A grey thumbnail some 80 pixels wide, of unit energy."""
    shrink = max(size) / _THUMB
    if shrink <= 1:
        return Preparation()
    return Preparation(size=(max(1, round(size[0] / shrink)), max(1, round(size[1] / shrink))))


def check_alike(pixels: np.ndarray, frame: Frame, where: str) -> None:
    """Raises PictureError where a frame has another size or type than the pictures before it."""
    if frame.pixels.shape != pixels.shape or frame.pixels.dtype != pixels.dtype:
        raise PictureError(
            f"frame {frame.sequence} of {where} is {_described(frame.pixels)}, "
            f"but the frames before it are {_described(pixels)}; one size and type is allowed"
        )


def _described(pixels: np.ndarray) -> str:
    kind = "grey" if pixels.ndim == 2 else "colour"
    return f"{pixels.shape[1]}x{pixels.shape[0]} {kind} {8 * pixels.dtype.itemsize} bit"


def _moved(before: tuple[Template, np.ndarray], smoothed: np.ndarray, last: np.ndarray) -> Registered:
    """The next frame on the place before it."""
    template, old = before
    h, w = old.shape
    half = (w // 2, h // 2)
    a, b = (cv2.resize(p, half, interpolation=cv2.INTER_AREA).astype(np.float32) for p in (old, smoothed))
    (dx, dy), _ = cv2.phaseCorrelate(a, b, cv2.createHanningWindow(half, cv2.CV_32F))
    guesses = np.array([last, np.zeros(3), [2 * dx, 2 * dy, 0.0]])
    reach = 0.25 * w
    prior_pose = np.diag([reach**-2, reach**-2, 0.05**-2])
    prior_light = np.diag(1 / np.square([0.2, 20.0, 0.1, 0.1]))
    order = np.argsort(-scan(template, smoothed, guesses, NO_LIGHT))
    tries = [
        register(template, smoothed, Prior(guesses[i], prior_pose, NO_LIGHT, prior_light), steps=12)
        for i in order[:2]
    ]
    best = max(tries, key=lambda registered: registered.correlation)
    return best if best.correlation >= _FOLLOWS else replace(best, pose=np.zeros(3))


def _is_still(moved: Registered, width: int) -> bool:
    """Whether a frame shows the place before it again."""
    shift, turn = float(np.hypot(*moved.pose[:2])), abs(float(moved.pose[2]))
    return moved.correlation > _SAME and shift < _STILL * width and turn < 2 * _STILL


def _unsure(moved: Registered) -> float:
    """Standard deviation of the length of a motion: large where little texture lies along it."""
    way = moved.pose[:2]
    along = way / max(float(np.hypot(*way)), 1e-6)
    return float(np.sqrt(along @ moved.covariance[:2, :2] @ along)) if moved.correlation >= _FOLLOWS else np.inf


def _keep(frame: Frame) -> bytes:
    """The picture's own bytes where they can be decoded again to the same kind of picture; encoded otherwise."""
    if frame.encoded is not None and frame.encoded.format in ("jpeg", "png"):
        again = cv2.imdecode(np.frombuffer(frame.encoded.data, np.uint8), cv2.IMREAD_UNCHANGED)
        if again is not None and again.shape == frame.pixels.shape and again.dtype == frame.pixels.dtype:
            return frame.encoded.data
    kind, quality = (".png", []) if frame.pixels.dtype == np.uint16 else (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 95])
    done, data = cv2.imencode(kind, frame.pixels, quality)
    if not done:
        raise PictureError(f"frame {frame.sequence}: {_described(frame.pixels)} cannot be kept as {kind}")
    return data.tobytes()


def _slopes(collected: _Collected, preparation: Preparation, space: Eigenspace) -> np.ndarray:
    """Central differences of z over shift, rotation and shading of each reference picture: (n, 5, k)."""
    slopes = np.empty((len(collected.pictures), 5, space.k), np.float32)
    for i, data in enumerate(collected.pictures):
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        for j, (more, less, step) in enumerate(_varied(picture)):
            slopes[i, j] = space.basis @ (preparation.prepare(more) - preparation.prepare(less)) / np.float32(2 * step)
    return slopes


def _varied(picture: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    h, w = picture.shape[:2]
    by = shrink_by((w, h))
    pixel = max(w / _THUMB, 1.0)
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
    """Add what a further golden sweep shows beyond the band; and the highest score it had before that."""
    excess = dict(enumerate(appearance.excess))
    memory, peak, scored = remember(appearance), 0.0, 0
    for frame in frames:
        if frame.size != appearance.size:
            raise PictureError(
                f"frame {frame.sequence} of a further golden sweep is {frame.size[0]}x{frame.size[1]}, "
                f"the reference sweep is {appearance.size[0]}x{appearance.size[1]}; one size is allowed"
            )
        memory, shown = look(appearance, appearance.limits, memory, frame)
        if shown is None or shown.score is None:
            continue
        scored += 1
        peak = max(peak, float(shown.score.max()))
        for place, picture in spread_beyond(appearance, levels(frame.pixels), shown).items():
            excess[place] = _merged(excess[place], picture)
    if scored < 0.5 * appearance.places:
        raise LearningError(
            f"a further golden sweep fits the reference sweep in {scored} of {appearance.places} places; "
            "is it the same product, swept the same way?"
        )
    return peak, replace(appearance, excess=tuple(excess[i] for i in range(appearance.places)))


def _merged(old: bytes, picture: np.ndarray) -> bytes:
    if old:
        picture = np.maximum(picture, cv2.imdecode(np.frombuffer(old, np.uint8), cv2.IMREAD_UNCHANGED))
    return cv2.imencode(".png", picture)[1].tobytes()
