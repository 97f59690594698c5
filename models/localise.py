"""Place a frame: the filter over s, a scan along the path, registration, and the fixture carried along."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from models.fixture import Fixture, Path
from models.position import Places, Standing, Track, move, standing, start, vouch
from models.registration import NO_LIGHT, Prior, Registered, Template, register, scan

_SCAN = np.arange(-2.0, 2.01, 0.25)
_FITS, _GRAIN = 0.8, 0.7
_LIGHT_STD = np.array([0.25, 25.0, 0.15, 0.15])
_LIGHT_WANDER = np.array([0.02, 2.0, 0.01, 0.01])
_POSE_FLOOR = np.diag(np.square([0.15, 0.15, 0.0005]))


@dataclass(frozen=True, eq=False)
class Trail:
    """What is carried from frame to frame."""

    places: Places
    fixture: Fixture | None = None
    light: Float[np.ndarray, "4"] | None = None
    residual: float | None = None
    """What registration usually leaves unexplained."""
    misses: int = 0
    """Frames since the picture last agreed with a reference picture."""
    rivalry: int = 0
    """Frames for which the eigenspace has insisted on another place."""


@dataclass(frozen=True, eq=False)
class Located:
    """Where a frame is."""

    at: float
    """In reference frames."""
    reference: int
    registered: Registered
    uncertainty: float
    """Standard deviation of `at`, in reference frames."""
    verified: bool
    """The picture agrees with the reference picture."""
    margin: float
    """How much worse the eigenspace finds every other place."""


def begin(track: Track) -> Trail:
    """Before the first frame."""
    return Trail(start(track))


def _prior(fixture: Fixture, reference: int, path: Path, light: np.ndarray, new: bool) -> Prior:
    pose, covariance = fixture.pose(reference, path)
    std = _LIGHT_STD if new else 3 * _LIGHT_WANDER
    return Prior(pose, np.linalg.inv(covariance + _POSE_FLOOR), light, np.diag(1 / np.square(std)))


@dataclass(frozen=True, eq=False)
class _Attempt:
    fixture: Fixture
    reference: int
    registered: Registered
    fits: bool


def _light(model: Template, smoothed: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """How the frame is lit, before it is placed: lamp and lens look alike wherever the part lies."""
    fixed = Prior(pose, np.diag([1e9, 1e9, 1e15]), NO_LIGHT, np.diag(1 / np.square(_LIGHT_STD)))
    return register(model, smoothed, fixed).light


def _attempt(
    guess: Fixture,
    halted: Fixture | None,
    path: Path,
    template: Callable[[int], Template],
    smoothed: np.ndarray,
    trail: Trail,
) -> _Attempt:
    """Scan along the path about a guess, register there, and filter what was measured."""
    n = len(path.motion)
    reference = int(np.clip(round(guess.at), 0, n - 1))
    model = template(reference)
    ats = np.append(guess.at + _SCAN, guess.at if halted is None else halted.at)
    poses = np.empty((len(ats), 3))
    origin = guess.offset[:2] - path.at(reference)
    for pose, at in zip(poses, ats, strict=True):
        pose[:2] = path.at(at) + origin
    poses[:, 2] = guess.offset[2]
    light = trail.light if trail.light is not None else _light(model, smoothed, poses[len(_SCAN) // 2])
    agree = scan(model, smoothed, poses, light)
    doubt = 0.04 * np.square((ats - guess.at) / max(guess.uncertainty, 0.3))
    if halted is not None:
        doubt[-1] = 0.04
    best = int(np.argmax(agree - np.minimum(doubt, 0.5)))
    start_at = halted if halted is not None and best == len(ats) - 1 else guess
    start_at = replace(start_at, mean=np.concatenate([[ats[best]], start_at.mean[1:]]))
    nearest = int(np.clip(round(ats[best]), 0, n - 1))
    if nearest != reference:
        reference, model = nearest, template(nearest)
    prior = _prior(start_at, reference, path, light, trail.light is None)
    registered = register(model, smoothed, prior)
    fixture = start_at.measure(reference, registered.pose, registered.covariance + _POSE_FLOOR, path)
    return _Attempt(fixture, reference, registered, _fits(model, registered, trail.residual))


def _fits(model: Template, registered: Registered, residual: float | None) -> bool:
    """Whether the picture agrees with the reference as well as noise allows, and as well as those before it."""
    needed = _FITS * model.detail / float(np.hypot(model.detail, _GRAIN))
    usual = np.inf if residual is None else max(2.0 * residual, residual + 1.0)
    return registered.correlation >= needed and registered.residual <= usual


def _rivals(trail: Trail, best: Standing) -> list[Fixture]:
    """Where else the frame could be: not moved on, or where the eigenspace would have it."""
    offset = np.zeros(3) if trail.fixture is None else trail.fixture.offset
    rivals = [] if trail.fixture is None else [trail.fixture.halted()]
    for at in (best.at, *best.others):
        rivals.append(Fixture.unknown(at, best.pace, offset))
        if np.abs(offset[:2]).max() > 2:
            rivals.append(Fixture.unknown(at, best.pace))
    return rivals


def locate(
    trail: Trail,
    track: Track,
    path: Path,
    template: Callable[[int], Template],
    smoothed: np.ndarray,
    z: np.ndarray,
    elapsed: float,
) -> tuple[Trail, Located]:
    """Place one frame, `elapsed` nominal intervals after the one before it."""
    old = trail.fixture
    places = move(track, trail.places, z, elapsed, np.zeros(3) if old is None else old.offset)
    best = standing(places)
    if old is None:
        attempt = _attempt(Fixture.unknown(best.at, best.pace), None, path, template, smoothed, trail)
    else:
        attempt = _attempt(old.predict(elapsed, path), old.halted(), path, template, smoothed, trail)
    apart = abs(best.at - attempt.fixture.at) > 2.0
    rivalry = trail.rivalry + 1 if apart and best.margin > 4.0 else 0
    usual = trail.residual or attempt.registered.residual
    worse = attempt.registered.residual > max(1.3 * usual, usual + 0.15)
    if not attempt.fits or worse or rivalry >= 3:
        for guess in _rivals(trail, best):
            other = _attempt(guess, None, path, template, smoothed, trail)
            if other.fits and other.registered.residual < (0.85 if attempt.fits else 1.0) * attempt.registered.residual:
                attempt, rivalry = other, 0
    r = attempt.registered
    fixture, light, misses, residual = attempt.fixture.settled(path), trail.light, 0, trail.residual
    if attempt.fits:
        places = vouch(places, fixture.at, 2.0)
        residual = r.residual if residual is None else residual + 0.2 * (r.residual - residual)
        light = r.light if light is None else light + 0.3 * (r.light - light)
    else:
        misses = trail.misses + 1
        fixture = None if old is None or misses > 8 else old.predict(elapsed, path)
    standing_at = attempt.fixture if fixture is None else fixture
    at = float(np.clip(standing_at.seen(path), 0, len(path.motion) - 1))
    located = Located(at, attempt.reference, r, standing_at.uncertainty, attempt.fits, best.margin)
    return Trail(places, fixture, light, residual, misses, rivalry), located
