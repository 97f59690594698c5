"""Place a frame: the filter over s, a scan along the path, registration, and the fixture carried along."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite

import cv2
import numpy as np
from jaxtyping import Float

from models.encoder import Encoder, Reading
from models.fixture import Fixture, Path
from models.position import Places, Standing, Track, move, standing, start, vouch
from models.registration import NO_LIGHT, STEPS, STEPS_FAR, Prior, Registered, Template, register, scan
from models.turning import Turn, follow, resembles, strangeness
from models.turning import belongs as looks_alike

_SCAN = np.arange(-2.0, 2.01, 0.25)
"""Where along the path to look for the frame, in reference frames about the guess."""
_ACROSS = 0.0, -2.5, 2.5, -5.0, 5.0
"""Pixels that a part may lie off across the path, tried where nothing is known of it."""
_SURE = 0.4
"""Standard deviation of the place, in reference frames, up to which registration needs no help."""
_ASK_EVERY = 2.5
_BEGINS = (0.0, 4.0)
"""Places where a sweep is tried to begin, whatever the eigenspace says."""
_APART, _CERTAIN, _INSISTS = 2.0, 4.0, 3
"""The eigenspace insists when it stands so many places apart, by such a margin, so many times."""
_SINKS, _RISES = 0.2, 0.15
_LEAP, _PATIENT = 4.0, 4
"""A frame this many places off is believed where it fits as well as usual, or after so many that did not fit."""
_GIVE_UP = 8
"""Frames that agree with nothing, after which the fixture is forgotten."""
_RICH, _CLEARLY = 5.0, 0.97
"""Detail in grey levels, and agreement on it, that leave no doubt, however much a part differs from the golden one."""
_FITS, _FITS_USUAL, _USUAL = 0.8, 0.6, 1.3
_AS_EVER = 0.9
"""Share of the agreement that the frames before reached, which does for a frame with more unexplained than they."""
_UNMISTAKABLE = 0.85
"""Share of the doubt at every other place, up to which agreement that is not `_FITS` does."""
_ABOVE, _HALFWAY = 0.1, 0.5
"""Shares of the way from what wrong places reach to perfect agreement, and to what good parts reach, asked for."""
_UNLIT = 0.2
"""Gain below which nothing of the reference picture is left in the frame: whatever agrees then is the rest."""
_ENOUGH = 0.95
"""Agreement that is always enough: on periodic parts wrong places reach more than good parts do at the right ones."""
_PERFECT = 0.1
"""Agreement is never perfect: what is added to what lacks."""
_LIES_STD, _TURNED = np.array([1.0, 1.0, 0.005]), 0.5
"""Where pictures do not move: how a part may lie (pixels, radians), and how well its place is known, in frames."""
_LIGHT_STD = np.array([0.25, 25.0, 0.15, 0.15])
_LIGHT_WANDER = np.array([0.02, 2.0, 0.01, 0.01])
_LIGHT_ANY, _LIGHT_STEADY = (np.diag(1 / np.square(std)) for std in (_LIGHT_STD, 3 * _LIGHT_WANDER))
_ROUGHLY = np.array([4.0, 4.0, 0.05])
"""How well a pose is known that was searched in small pictures: pixels, radians."""
_POSE_FLOOR = np.diag(np.square([0.15, 0.15, 0.0005]))


@dataclass(frozen=True, eq=False)
class Trail:
    """What is carried from frame to frame."""

    places: Places
    fixture: Fixture | None = None
    light: Float[np.ndarray, " 4"] | None = None
    residual: float | None = None
    """What registration usually leaves unexplained."""
    agreement: float = 1.0
    """What agreement the frames that fitted have reached of late."""
    misses: int = 0
    """Frames since the picture last agreed with a reference picture."""
    rivalry: int = 0
    """Times that the eigenspace has insisted on another place."""
    waited: float = 0.0
    """Nominal intervals since the eigenspace was asked."""
    strange: float | None = None
    """Where pictures do not move: how far the looks are from the curve of late."""
    reading: Reading | None = None
    """The encoder's last word beside a place that the picture gave."""


@dataclass(frozen=True, eq=False)
class Located:
    """Where a frame is."""

    at: float
    """In reference frames."""
    reference: int
    """The place with a picture that the frame was registered on."""
    registered: Registered
    uncertainty: float
    """Standard deviation of `at`, in reference frames."""
    verified: bool
    """The picture agrees with the reference picture."""
    agreement: float
    """How well: correlation, as a share of what noise allows at the place."""
    resembles: bool = False
    """Not the picture that should be there, and yet its place is known by the looks before and after."""


@dataclass(frozen=True, eq=False)
class Guide:
    """What is known of a sweep before it comes: the curve, the way, and the pictures to register on."""

    track: Track
    path: Path
    template: Callable[[int], Template]
    """Of a place with a picture."""
    asked: Float[np.ndarray, " n"]
    """Agreement that tells each place from others; see `asked`."""
    turn: Turn | None = None
    """What places a frame where the picture changes otherwise than by moving; None where it moves."""
    encoder: Encoder | None = None
    """Where the reference sweep carried positions that can be used."""


def asked(wrong: Float[np.ndarray, " n"], good: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The agreement that tells a place from others, from what wrong places and good parts have reached there.

    >>> asked(np.array([0.5, 0.5]), np.array([1.0, 0.58])).round(3)
    array([0.55, 0.54])
    """
    return wrong + np.minimum(_ABOVE * (1.0 - wrong), _HALFWAY * np.maximum(good - wrong, 0.0))


def begin(track: Track) -> Trail:
    """Before the first frame."""
    return Trail(start(track))


@dataclass(frozen=True, eq=False)
class Attempt:
    """A frame laid on the reference picture of a place where it might be."""

    fixture: Fixture
    reference: int
    registered: Registered
    agreement: float
    """Correlation, as a share of what noise allows at the place: about 1 on the golden part."""
    fits: bool

    @property
    def doubt(self) -> float:
        """What is left unexplained at the points that are right, and how little of the detail agrees: the less, the
        likelier. Individuals that differ leave much at all places, periodic traces agree in many."""
        r = self.registered
        return r.residual / max(float(r.light[0]), 0.3) * (1.0 + _PERFECT - min(self.agreement, 1.0))


def belongs(guide: Guide, reference: int, registered: Registered, agreement: float) -> bool:
    """Whether a frame agrees with a place as the learnt part does, and as wrong places and other parts do not."""
    return bool(registered.light[0] >= _UNLIT and agreement >= min(float(guide.asked[reference]), _ENOUGH))


def _light(model: Template, smoothed: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """How the frame is lit, before it is placed: lamp and lens look alike wherever the part lies."""
    fixed = Prior(pose, np.diag([1e9, 1e9, 1e15]), NO_LIGHT, _LIGHT_ANY)
    return register(model, smoothed, fixed).light


@dataclass(frozen=True, eq=False)
class _Scene:
    """What every attempt at one frame needs."""

    guide: Guide
    smoothed: np.ndarray
    trail: Trail
    position: float | None = None
    """The encoder's, where it can be used."""

    @property
    def told(self) -> float | None:
        """The place by the encoder."""
        encoder = self.guide.encoder
        return None if encoder is None or self.position is None else encoder.place(self.position, self.trail.reading)

    def read(self, at: float) -> Reading | None:
        """What to remember of the encoder with a frame that the picture has placed."""
        encoder, last = self.guide.encoder, self.trail.reading
        return last if encoder is None or self.position is None else encoder.read(self.position, at, last)

    def light(self, model: Template, pose: np.ndarray) -> np.ndarray:
        """The light so far; measured, before the frame is placed, where none is known."""
        return self.trail.light if self.trail.light is not None else _light(model, self.smoothed, pose)


def _attempt(scene: _Scene, guess: Fixture, light: np.ndarray | None = None) -> Attempt:
    """Register at the place that a guess gives, and filter what was measured."""
    path = scene.guide.path
    reference = path.key(guess.at)
    model = scene.guide.template(reference)
    pose, covariance = guess.pose(reference, path)
    light = scene.light(model, pose) if light is None else light
    precision = _LIGHT_ANY if scene.trail.light is None else _LIGHT_STEADY
    prior = Prior(pose, cv2.invert(covariance + _POSE_FLOOR)[1], light, precision)
    far = scene.trail.fixture is None or guess.uncertainty > _SURE
    registered = register(model, scene.smoothed, prior, STEPS_FAR if far else STEPS)
    fixture = guess.measure(reference, registered.pose, registered.covariance + _POSE_FLOOR, path)
    agreement = _agreement(model, registered)
    fits = _fits(model, registered, agreement, scene.trail, float(scene.guide.asked[reference]))
    return Attempt(fixture, reference, registered, agreement, fits)


def compare(guide: Guide, smoothed: np.ndarray, at: float) -> Attempt:
    """Lay a frame of which nothing is known on a place, as well as it will go."""
    return _search(_Scene(guide, smoothed, begin(guide.track)), Fixture.unknown(at))


def lay(guide: Guide, smoothed: np.ndarray, reference: int, pose: Float[np.ndarray, " 3"]) -> tuple[Registered, float]:
    """Lay a frame on a reference picture about a pose that was found some other way; and how well it agrees there."""
    model = guide.template(reference)
    prior = Prior(pose, np.diag(1 / np.square(_ROUGHLY)), _light(model, smoothed, pose), _LIGHT_ANY)
    registered = register(model, smoothed, prior, STEPS_FAR)
    return registered, _agreement(model, registered)


def _search(scene: _Scene, guess: Fixture, halted: Fixture | None = None) -> Attempt:
    """Scan along the path about a guess, and where the robot would have halted; attempt where it agrees best.

    Across the path, too, where nothing is known of the fixture yet: a part that lies off looks like another place.
    """
    path = scene.guide.path
    reference = path.key(guess.at)
    model = scene.guide.template(reference)
    tries = [guess] if scene.trail.fixture is not None else _beside(guess, path)
    ats = guess.at + _SCAN
    poses = np.concatenate([_poses(each, ats, reference, path) for each in tries])
    if halted is not None:
        poses = np.concatenate([poses, _poses(halted, np.array([halted.at]), reference, path)])
    light = scene.light(model, poses[len(_SCAN) // 2])
    doubt = np.tile(0.04 * np.square((ats - guess.at) / max(guess.uncertainty, 0.3)), len(tries))
    if halted is not None:
        doubt = np.append(doubt, 0.04)
    best = int(np.argmax(scan(model, scene.smoothed, poses, light) - np.minimum(doubt, 0.5)))
    if best == len(tries) * len(ats) and halted is not None:
        return _attempt(scene, halted, light)
    chosen = tries[best // len(ats)]
    return _attempt(scene, replace(chosen, mean=np.array([ats[best % len(ats)], *chosen.mean[1:]])), light)


def _beside(guess: Fixture, path: Path) -> list[Fixture]:
    """The same guess with the part lying off across the path, by a few pixels either way; itself first."""
    x, y = (float(v) for v in path.speed(guess.at))
    across = np.array([-y, x]) / max(float(np.hypot(x, y)), 1e-6)
    shifts = [np.array([0.0, 0.0, *(by * across), 0.0]) for by in _ACROSS]
    return [replace(guess, mean=guess.mean + shift) for shift in shifts]


def _poses(guess: Fixture, ats: Float[np.ndarray, " m"], reference: int, path: Path) -> Float[np.ndarray, "m 3"]:
    """Where the frame would lie on a reference picture, were it at those places."""
    poses = np.empty((len(ats), 3))
    x, y, turn = (float(v) for v in guess.offset)
    way = path.along(ats) - path.at(reference)
    poses[:, :2] = way + turn * np.stack([-way[:, 1], way[:, 0]], axis=1) + (x, y)
    poses[:, 2] = turn
    return poses


def _agreement(model: Template, registered: Registered) -> float:
    """Correlation of a frame with a reference picture, of what noise allows there: about 1 where it fits."""
    return registered.correlation / max(model.agrees, 0.05)


def _fits(model: Template, registered: Registered, agreement: float, trail: Trail, asked: float) -> bool:
    """Whether the picture agrees with the reference as well as noise allows, and as well as those before it.

    A part with much wrong about it agrees less, but leaves no more unexplained at the points that are right.
    """
    usual = trail.residual
    if registered.light[0] < _UNLIT:
        return False
    if usual is None or (model.detail > _RICH and registered.correlation >= _CLEARLY):
        return agreement >= _FITS
    if registered.residual <= _USUAL * usual:
        return agreement >= min(_FITS_USUAL, asked)
    return agreement >= min(_FITS, _AS_EVER * trail.agreement) and registered.residual <= max(2.0 * usual, usual + 1.0)


def _rivals(scene: _Scene, old: Fixture, best: Standing) -> list[Fixture]:
    """Where else the frame could be: not moved on, or where the eigenspace or the encoder would have it.

    The first of equals wins: an encoder that moved as the pictures did is heard first, another one last.
    """
    rivals = [old.halted()]
    for at in (best.at, *best.others):
        rivals.append(Fixture.unknown(at, best.pace, old.offset))
        if np.abs(old.offset[:2]).max() > 2:
            rivals.append(Fixture.unknown(at, best.pace))
    told, reading = scene.told, scene.trail.reading
    if told is not None:
        heard = 0 if reading is not None and reading.honest else len(rivals)
        rivals.insert(heard, Fixture.unknown(told, best.pace, old.offset))
    return rivals


def locate(
    guide: Guide,
    trail: Trail,
    smoothed: np.ndarray,
    z: Float[np.ndarray, " k"],
    elapsed: float,
    *,
    position: float | None = None,
) -> tuple[Trail, Located]:
    """Place one frame, `elapsed` nominal intervals after the one before it; `position` is the encoder's.

    As long as the picture agrees with the one expected, registration carries the place along and the eigenspace is
    asked every few frames whether it knows better; when it does not agree, everything else is tried: looking about,
    a robot that halted, and the places that the eigenspace and the encoder prefer. The picture decides.
    """
    if guide.encoder is None or position is None or not isfinite(position):
        position = None
    old, path, scene = trail.fixture, guide.path, _Scene(guide, smoothed, trail, position)
    expected = None if old is None else old.predict(elapsed, path)
    waited = trail.waited + elapsed
    sure = old is not None and old.uncertainty < _SURE and not trail.misses
    attempt = _attempt(scene, expected) if expected is not None and sure else None
    if attempt is not None and attempt.fits and not _worse(trail, attempt) and waited < _ASK_EVERY:
        return _placed(scene, attempt, expected, replace(trail, waited=waited))
    places = move(guide.track, trail.places, z, waited, np.zeros(3) if old is None else old.offset)
    best = standing(places)
    if old is None or expected is None:
        attempt = _anywhere(scene, best)
    elif attempt is None or not attempt.fits or _worse(trail, attempt):
        attempt = _better(attempt, _search(scene, expected, old.halted()))
    apart = abs(best.at - attempt.fixture.at) > _APART and best.margin > _CERTAIN
    rivalry = trail.rivalry + 1 if apart else 0
    if old is not None and (not attempt.fits or _worse(trail, attempt) or rivalry >= _INSISTS):
        for rival in _rivals(scene, old, best):
            other = _better(attempt, _search(scene, rival), _leaps(trail, expected))
            attempt, rivalry = other, rivalry if other is attempt else 0
    if attempt.fits and not _worse(trail, attempt):
        places = vouch(places, attempt.fixture.at, 2.0)
    return _placed(scene, attempt, expected, replace(trail, places=places, waited=0.0, rivalry=rivalry))


def locate_by_look(
    guide: Guide, trail: Trail, smoothed: np.ndarray, away: Float[np.ndarray, " n"], elapsed: float
) -> tuple[Trail, Located]:
    """Place one frame of a sweep that does not move in the picture; `away` is how far its look is from every place.

    The eigenspace leads; registration only lays the frame straight.
    """
    places = follow(trail.places, away, elapsed)
    best = int(places.cost.argmin())
    strange = strangeness(trail.strange, float(away[best]))
    known = looks_alike(strange, float(away[best]))
    reference = guide.path.key(best)
    model = guide.template(reference)
    light = trail.light if trail.light is not None else NO_LIGHT
    std = _LIGHT_STD if trail.light is None else 3 * _LIGHT_WANDER
    prior = Prior(np.zeros(3), np.diag(1 / np.square(_LIES_STD)), light, np.diag(1 / np.square(std)))
    registered = register(model, smoothed, prior)
    misses = 0 if known else trail.misses + 1
    carried = replace(trail, places=places, strange=strange, misses=misses, light=registered.light if known else light)
    like = not known and resembles(strange)
    return carried, Located(
        float(best), reference, registered, _TURNED, known, _agreement(model, registered), resembles=like
    )


def _anywhere(scene: _Scene, best: Standing) -> Attempt:
    """Where the sweep begins, or goes on after it was lost: the one that fits best of all that look alike.

    A part that differs from the golden one agrees less than is asked for otherwise: it will do where the place is
    unmistakable.
    """
    # most sweeps begin where the golden one did, whatever looks like it elsewhere
    ats = [best.at, *best.others, *(_BEGINS if scene.trail.residual is None else ())]
    told, reading = scene.told, scene.trail.reading
    if told is not None:
        ats.append(told)
    attempts = [_search(scene, Fixture.unknown(at, best.pace)) for at in ats]
    chosen = min(attempts, key=lambda attempt: (not attempt.fits, attempt.doubt))
    if told is not None and reading is not None and reading.honest and attempts[-1].fits:
        chosen = _better(attempts[-1], chosen)
    if chosen.fits or chosen.agreement < scene.guide.asked[chosen.reference]:
        return chosen
    elsewhere = [a.doubt for a in attempts if abs(a.fixture.at - chosen.fixture.at) > _APART]
    return replace(chosen, fits=chosen.doubt < _UNMISTAKABLE * min(elsewhere, default=np.inf))


def _worse(trail: Trail, attempt: Attempt) -> bool:
    """Whether more is left unexplained than usual: perhaps the picture fits better elsewhere."""
    usual = trail.residual or attempt.registered.residual
    return attempt.registered.residual > max(1.3 * usual, usual + 0.15)


def _leaps(trail: Trail, guess: Fixture | None) -> Callable[[Attempt], bool]:
    """Whether an attempt is far from where the sweep should be, and not good enough to believe that at once."""
    if guess is None or trail.misses >= _PATIENT or trail.residual is None:
        return lambda attempt: False
    at, allowed = guess.at, _USUAL * trail.residual
    return lambda attempt: abs(attempt.fixture.at - at) > _LEAP and attempt.registered.residual > allowed


def _better(one: Attempt | None, other: Attempt, leaps: Callable[[Attempt], bool] = lambda _: False) -> Attempt:
    """The first unless the other fits and leaves clearly less unexplained."""
    if one is None:
        return other
    needed = 0.85 if one.fits else 1.0
    less = other.doubt < needed * one.doubt
    return other if other.fits and less and not leaps(other) else one


def _follow(usual: float, residual: float) -> float:
    """Down quickly and up slowly: what is left unexplained at a wrong place must not soon count as usual."""
    return usual + (_SINKS if residual < usual else _RISES) * (residual - usual)


def _placed(scene: _Scene, attempt: Attempt, guess: Fixture | None, asked: Trail) -> tuple[Trail, Located]:
    """Carry on from an attempt, or by dead reckoning (`guess`) where it does not fit."""
    trail, path, r = scene.trail, scene.guide.path, attempt.registered
    if attempt.fits:
        usual = r.residual if trail.residual is None else _follow(trail.residual, r.residual)
        light = r.light if trail.light is None else trail.light + 0.3 * (r.light - trail.light)
        fixture = attempt.fixture.settled(path)
        agreement = min(attempt.agreement, 1.0)
        if trail.residual is not None:
            agreement = trail.agreement + _RISES * (agreement - trail.agreement)
        reading = scene.read(fixture.at)
        carried = replace(
            asked, fixture=fixture, light=light, residual=usual, agreement=agreement, misses=0, reading=reading
        )
    else:
        misses = trail.misses + 1
        fixture = None if misses > _GIVE_UP else guess
        carried = replace(asked, fixture=fixture, misses=misses)
    stands = fixture or attempt.fixture
    at = min(max(stands.seen(path), 0.0), len(path.motion) - 1.0)
    return carried, Located(at, attempt.reference, r, stands.uncertainty, attempt.fits, attempt.agreement)
