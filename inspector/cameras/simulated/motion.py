"""How the camera travels: the reference path over the part, and one sweep along it with its human faults."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inspector.cameras.simulated.canvas import HEIGHT, WIDTH
from inspector.cameras.simulated.render import Pose
from inspector.cameras.simulated.settings import Settings

MARGIN = 10.0
"""What the reference path keeps from the surface's rim, in units."""


@dataclass(frozen=True, eq=False)
class Path:
    """The reference path, one row per nominal frame; `u` counts nominal frames, `s = u / (n - 1)`."""

    points: np.ndarray
    """(n, 2) feet of the camera's axis, in units."""

    @property
    def last(self) -> int:
        """`u` of the end."""
        return len(self.points) - 1

    @property
    def step(self) -> float:
        """Travel per nominal frame, in units."""
        return float(np.hypot(*(self.points[1] - self.points[0])))

    def at(self, u: np.ndarray) -> np.ndarray:
        """(m, 2) where the path is at u (m,); beyond its ends it goes straight on."""
        i = np.clip(np.floor(u).astype(int), 0, self.last - 1)
        a, b = self.points[i], self.points[i + 1]
        return a + (u - i)[:, None] * (b - a)

    def nearest(self, point: np.ndarray, u: float, reach: int = 5) -> float:
        """u of the place on the path, within `reach` frames of u, that is closest to the point."""
        knots = np.floor(u) + np.arange(-reach, reach + 1)
        a, b = self.at(knots[:-1]), self.at(knots[1:])
        along = b - a
        t = np.clip(((point - a) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
        apart = np.hypot(*(a + t[:, None] * along - point).T) + 1e-6 * np.abs(knots[:-1] + t - u)
        best = int(apart.argmin())
        return float(knots[best] + t[best])


@dataclass(frozen=True)
class Exposure:
    """One frame as it is taken."""

    sequence: int
    u: float
    """Where the robot is on its path, in nominal frames."""
    pose: Pose
    """Where that puts the camera over this part, as it lies in its fixture."""


def reference_path(settings: Settings) -> Path:
    """The path over the part in equal steps."""
    half = 160.0, 160.0 * settings.size[1] / settings.size[0]
    left, top = half[0] + MARGIN, half[1] + MARGIN
    right, low = WIDTH - left, HEIGHT - top
    if settings.path == "serpentine":
        rows = np.linspace(top, low, max(2, int(np.ceil(HEIGHT / (2 * half[1])))))
        corners = [(x, y) for r, y in enumerate(rows) for x in ((left, right) if r % 2 == 0 else (right, left))]
    elif settings.path == "line":
        corners = [(left, HEIGHT / 2), (right, HEIGHT / 2)]
    else:
        turn = np.linspace(np.pi, 0, 400)
        corners = np.stack(
            [WIDTH / 2 + (right - left) / 2 * np.cos(turn), low - (low - top) * np.sin(turn)], axis=1
        ).tolist()
    return Path(_even(np.array(corners, float), settings.step, settings.frames))


def _even(corners: np.ndarray, step: float, count: int) -> np.ndarray:
    """Points at equal distance along the corners: `count` of them, or one per step."""
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    whole = float(length[-1])
    stops = np.linspace(0, whole, max(2, count) if count else int(whole / step) + 1)
    return np.stack([np.interp(stops, length, corners[:, k]) for k in (0, 1)], axis=1)


def exposures(path: Path, settings: Settings) -> tuple[Exposure, ...]:
    """Every frame of the sweep that is not lost."""
    rng = np.random.default_rng([settings.seed, 1])
    us = _travel(path.last, settings, rng)
    shake = rng.standard_normal((len(us), 2)) * settings.vibration
    kept = np.flatnonzero(rng.random(len(us)) >= settings.lost)
    feet = path.at(us) + shake
    return tuple(Exposure(int(k), float(us[k]), over_part(feet[k], 0.0, settings.place)) for k in kept)


def over_part(foot: np.ndarray, angle: float, place: tuple[float, ...]) -> Pose:
    """Where a camera over the fixture, its axis at foot (2,), is over a part that lies in it as `place` says."""
    dx, dy, degrees = place
    turn = float(np.deg2rad(degrees))
    c, s, middle = np.cos(turn), np.sin(turn), np.array([WIDTH / 2, HEIGHT / 2])
    x, y = (foot + np.array([dx, dy]) - middle) @ np.array([[c, s], [-s, c]]) + middle
    return Pose(float(x), float(y), angle + turn)


def _travel(last: int, settings: Settings, rng: np.random.Generator) -> np.ndarray:
    """u of every frame, those included that will be lost."""
    phase, pause_at, turn_at = rng.random(3) * (2 * np.pi, 0.4 * last, 0.4 * last)
    u, held, backed, us = float(settings.late - settings.early), 0, 0, list[float]()
    while u <= last * settings.stop + 1e-9:
        us.append(u)
        pace = 1 + settings.pace * np.sin(6 * np.pi * u / last + phase) + settings.jitter * rng.standard_normal()
        if u >= pause_at + 0.3 * last and held < settings.pause:
            held += 1
        elif (u >= turn_at + 0.3 * last and backed < settings.reverse) or 0 < backed < settings.reverse:
            backed += 1
            u -= pace
        else:
            u += max(pace, 0.02)
    return np.array(us)
