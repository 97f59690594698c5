"""One pass over the reference sweep: its places, what each shows, and how the picture moves from one to the next."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from models.errors import LearningError, PictureError
from models.frame import Frame
from models.ignored import Ignored
from models.preparation import Preparation
from models.registration import NO_LIGHT, Prior, Registered, Template, choose_points, register, scan, smooth
from models.scoring import is_blind
from models.tolerance import levels

THUMB = 80
"""Pixels across the thumbnails that the eigenspace is learnt from."""
_STILL = 0.005
"""Share of the width by which a frame must have moved to be a place of its own."""
_POINTS = 12
"""Fewer cannot tell shift, rotation and light apart."""
_SAME, _FOLLOWS = 0.9, 0.3
"""Agreement from which on a frame shows the place before it again; and at least continues it."""
_THE_SAME, _MOVES = 0.985, 0.975
"""Agreement, as a share of what noise allows: of pictures of one place; and of a picture with the last one moved on."""
_APART = 0.055
"""Share of the width that the picture moves from one key place to the next, at the most."""
_OFF = np.array([1.0, 1.0, 0.01])
"""Pixels and radians by which a picture may lie elsewhere on that of its key place than the way says."""
_STILLS, _EARLY = 2000, 12
"""Frames that stood still are kept up to here, as long as it is not known, by so many motions, that pictures move."""
_STEADY = 0.02
"""How much of its pace a steady camera gains or loses from frame to frame."""
_CORNER = 0.9
"""Cosine between the motions before and after a frame: below, the way turns there, and a frame cuts the corner."""
_UNEVEN = 0.25
"""Median deviation of the travel per frame, as a share of it, up to which travel measures the way."""


@dataclass
class GoldenSweep:
    """What the first pass over the reference sweep keeps of it."""

    frames: list[int] = field(default_factory=list[int])
    x: list[np.ndarray] = field(default_factory=list[np.ndarray])
    pictures: list[bytes] = field(default_factory=list[bytes])
    keys: list[int] = field(default_factory=list[int])
    """Places whose pictures the appearance keeps: enough of them that every frame lies close to one."""
    points: list[np.ndarray] = field(default_factory=list[np.ndarray])
    """Of the key places."""
    motion: list[np.ndarray] = field(default_factory=list[np.ndarray])
    stood: list[int] = field(default_factory=list[int])
    """Frames that stood still before each motion."""
    unsure: list[float] = field(default_factory=list[float])
    """Standard deviation of the length of each motion, in pixels."""
    still: list[tuple[int, bytes]] = field(default_factory=list[tuple[int, bytes]])
    """Frames that seemed to show the place before them again, with their pictures: bodies may look alike all round."""
    follows: list[float] = field(default_factory=list[float])
    """Agreement of each place with the one before it moved on, as a share of what noise allows."""
    times: list[int] = field(default_factory=list[int])
    sequences: list[int] = field(default_factory=list[int])
    encoders: list[float | None] = field(default_factory=list[float | None])
    """Of every frame, like the times and sequences."""


@dataclass(frozen=True, eq=False)
class _Key:
    """The last key place, and how far the picture has moved since."""

    template: Template
    way: np.ndarray
    step: float = 0.0
    """Length of the last motion, in pixels."""

    def after(self, motion: np.ndarray) -> _Key:
        """One place further."""
        return _Key(self.template, self.way + motion, float(np.hypot(*motion)))

    def stands_for(self, smoothed: np.ndarray) -> bool:
        """Whether a picture so far from it can be compared with it, and there is no need for another key yet.

        Where the picture changes in other ways than by moving, or its motion could not be measured, it cannot.
        """
        if float(np.hypot(*self.way)) + self.step > _APART * smoothed.shape[1]:
            return False
        pose = np.array([*self.way, 0.0])
        light = np.diag(1 / np.square([0.1, 10.0, 0.05, 0.05]))
        found = register(self.template, smoothed, Prior(pose, np.diag(1 / np.square(2 * _OFF)), NO_LIGHT, light))
        return found.correlation > _SAME * self.template.agrees and bool((np.abs(found.pose - pose) < _OFF).all())


def collect(
    frames: Iterable[Frame], wanted: Preparation | None, ignore: Bool[np.ndarray, "h w"] | None = None
) -> tuple[Preparation, GoldenSweep]:
    """Read a reference sweep once; frames that show nothing, or no new place, are left out.

    `ignore` is a don't-care mask, in place of that of `wanted`.
    Raises LearningError where fewer than two places are left, PictureError where a picture does not fit the others.
    """
    kept = GoldenSweep()
    kind, preparation, points = "", Preparation(), np.zeros(0, np.uint8)
    ignored = Ignored.of(None)
    before: tuple[Template, np.ndarray] | None = None
    key: _Key | None = None
    last, stood = np.zeros(3), 0
    for index, frame in enumerate(frames):
        kept.times.append(frame.t_ns)
        kept.sequences.append(frame.sequence)
        kept.encoders.append(frame.encoder)
        if not kind:
            kind = frame.kind
            preparation = wanted or default_preparation(frame.size)
            preparation = (preparation if ignore is None else replace(preparation, ignore=ignore)).bind(frame.size)
            ignored = Ignored.of(preparation.ignore)
        check_alike(kind, frame, "the reference sweep")
        smoothed = smooth(ignored.filled(levels(frame.pixels)))
        if is_blind(smoothed):
            continue
        if before is not None:
            moved = _moved(before, smoothed, last)
            last = moved.pose
            follows = moved.correlation / max(before[0].agrees, 0.05)
            if follows > _THE_SAME and _is_still(moved, smoothed.shape[1]):
                stood += 1
                early = len(kept.follows) < _EARLY
                if len(kept.still) < _STILLS and (early or not moves(kept, smoothed.shape[1])):
                    kept.still.append((index, _keep(frame)))
                continue
            kept.motion.append(last[:2])
            kept.stood.append(stood)
            stood = 0
            kept.unsure.append(_unsure(moved))
            kept.follows.append(follows)
        points = choose_points(smoothed)
        if len(points) < _POINTS:
            raise LearningError(f"pictures of {kind} are too small; at least some 24x18 pixels are needed")
        before = (Template.of(smoothed, points), smoothed)
        key = None if key is None else key.after(last[:2])
        if key is None or not key.stands_for(smoothed):
            key = _Key(before[0], np.zeros(2))
            kept.keys.append(len(kept.frames))
            kept.points.append(points)
        kept.frames.append(index)
        kept.x.append(preparation.prepare(frame.pixels))
        kept.pictures.append(_keep(frame))
    _check_places(kept)
    if kept.keys[-1] != len(kept.x) - 1:
        kept.keys.append(len(kept.x) - 1)
        kept.points.append(points)
    return preparation, kept


def _check_places(kept: GoldenSweep) -> None:
    if not kept.times:
        raise LearningError("the reference sweep holds no frame; at least two that differ are needed")
    if len(kept.x) < 2:
        raise LearningError(
            f"the reference sweep shows {len(kept.x)} place(s) in {len(kept.times)} frame(s): "
            "pictures of one grey and standstills teach nothing; at least two places are needed"
        )


def default_preparation(size: tuple[int, int]) -> Preparation:
    """A grey thumbnail some 80 pixels wide, of unit energy."""
    shrink = max(size) / THUMB
    if shrink <= 1:
        return Preparation()
    return Preparation(size=(max(1, round(size[0] / shrink)), max(1, round(size[1] / shrink))))


def check_alike(kind: str, frame: Frame, where: str) -> None:
    """Raises PictureError where a frame is of another kind than the pictures before it."""
    if frame.kind != kind:
        raise PictureError(
            f"frame {frame.sequence} of {where} is {frame.kind}, "
            f"but the frames before it are {kind}; one size and type is allowed"
        )


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
        register(template, smoothed, Prior(guesses[i], prior_pose, NO_LIGHT, prior_light), steps=12) for i in order[:2]
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


def moves(golden: GoldenSweep, width: int) -> bool:
    """Whether the picture moves from place to place, and does not change otherwise: no turntable, no corridor.

    `width` is that of the pictures that motion was measured in.
    """
    if not golden.follows:
        return False
    way = float(np.quantile(np.hypot(*np.array(golden.motion).T), 0.25))
    return way >= _STILL * width and float(np.quantile(golden.follows, 0.25)) >= _MOVES


def turned(golden: GoldenSweep) -> GoldenSweep:
    """The sweep with every frame a key place, and no motion: where pictures do not move, none stands still.

    Its `x` and `points` are still to be made of the pictures.
    """
    pictures = sorted([*zip(golden.frames, golden.pictures, strict=True), *golden.still])
    frames = [index for index, _ in pictures]
    return replace(
        golden,
        frames=frames,
        pictures=[picture for _, picture in pictures],
        keys=list(range(len(frames))),
        x=[],
        points=[],
        motion=[np.zeros(2)] * (len(frames) - 1),
        stood=[0] * (len(frames) - 1),
        still=[],
    )


def coordinates(golden: GoldenSweep) -> np.ndarray:
    """Sweep coordinate of each place: the share of the way, or of the time where the way cannot be told.

    Frames of a steady camera lie evenly in both, but the way does not mind an uneven pace. What moves in the picture
    measures the way only where it moves by about as much from frame to frame; else s is the share of frames.
    """
    frames = np.array(golden.frames, float)
    frames = (frames - frames[0]) / (frames[-1] - frames[0])
    # a frame that stood still took time, but no way
    way, steps = np.hypot(*np.array(golden.motion).T), np.diff(golden.frames) - np.array(golden.stood)
    usual = float(np.median(way / steps))
    uneven = float(np.median(np.abs(way / steps - usual)))
    if usual <= 0 or uneven > _UNEVEN * usual:
        return frames
    # where texture is poor, and where the picture cuts a corner of the way, the usual pace knows better
    trust = 1 / (1 + np.square(np.array(golden.unsure) / (_STEADY * usual)))
    trust[_turns(np.array(golden.motion))] = 0.0
    way = usual * steps + trust * (way - usual * steps)
    return np.concatenate([[0.0], np.cumsum(way)]) / way.sum()


def _turns(motion: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Which motions lie between two that point elsewhere."""
    ends = np.vstack([motion[:1], motion, motion[-1:]])
    before, after = ends[:-2], ends[2:]
    lengths = np.hypot(*before.T) * np.hypot(*after.T)
    return np.einsum("ni,ni->n", before, after) < _CORNER * lengths


def _keep(frame: Frame) -> bytes:
    """The picture's own bytes where they can be decoded again to the same kind of picture; encoded otherwise."""
    if frame.encoded is not None and frame.encoded.format in ("jpeg", "png"):
        again = cv2.imdecode(np.frombuffer(frame.encoded.data, np.uint8), cv2.IMREAD_UNCHANGED)
        if again is not None and again.shape == frame.pixels.shape and again.dtype == frame.pixels.dtype:
            return frame.encoded.data
    kind, quality = (".png", []) if frame.pixels.dtype == np.uint16 else (".jpg", [cv2.IMWRITE_JPEG_QUALITY, 95])
    done, data = cv2.imencode(kind, frame.pixels, quality)
    if not done:
        raise PictureError(f"frame {frame.sequence}: {frame.kind} cannot be kept as {kind}")
    return data.tobytes()
