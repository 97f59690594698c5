"""The simulated camera: a drawn part, a sweep over it, and the truth about both for tests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Self

import cv2
import numpy as np

from inspector.cameras.base import AbstractCamera, CameraNotOpened, Clock, OptionRefused
from inspector.cameras.options import read
from inspector.cameras.simulated.defects import KINDS, USUAL_SIZE, Defect, mark, with_defects
from inspector.cameras.simulated.motion import Exposure, Path, exposures, over_part, reference_path
from inspector.cameras.simulated.part import Part, draw_part, features_of
from inspector.cameras.simulated.render import Pose, Renderer
from inspector.cameras.simulated.settings import Settings
from inspector.cameras.simulated.surface import Surface
from inspector.cameras.simulated.truth import FrameTruth, Patch, frame_truth, patch_of
from inspector.pictures import decode, encode_jpeg
from models.frame import Frame

START_NS = 1_767_225_600_000_000_000
"""Simulated time begins with the year 2026; no clock is asked."""


class SimulatedCamera(AbstractCamera):
    """Frames of a drawn part, the same bytes for the same url. Every call of `frames` sweeps anew."""

    def __init__(self, settings: Settings, clock: Clock) -> None:
        self._settings, self._clock, self._closed = settings, clock, False
        self._path = reference_path(settings)
        self._exposures = exposures(self._path, settings)
        if not self._exposures:
            why = f"late={settings.late}, stop={settings.stop:g} and lost={settings.lost:g} leave no frame"
            raise CameraNotOpened("simulated", why)
        if len(settings.at) > len(settings.defect):
            at = ",".join(f"{s:g}" for s in settings.at)
            raise OptionRefused("simulated", "at", at, f"one sweep coordinate per defect: {len(settings.defect)}")
        self._defects = _defects(settings, self._path)
        self._looked: tuple[float, Renderer] | None = None

    @property
    def settings(self) -> Settings:
        """The options of its url."""
        return self._settings

    @classmethod
    def open(cls, place: str, query: dict[str, str], clock: Clock) -> Self:
        """See AbstractCamera; there is no place."""
        if place:
            raise CameraNotOpened(f"simulated:{place}", "has no place, only options: simulated:?part=board")
        return cls(read("simulated", Settings, query), clock)

    def describe(self) -> dict[str, str]:
        """See AbstractCamera. What is wrong with the part is not told here."""
        s = self._settings
        return {
            "camera": "simulated", "part": f"{s.part.kind}{s.part.design}", "unit": str(s.unit), "seed": str(s.seed),
            "width": str(s.size[0]), "height": str(s.size[1]), "fps": f"{s.fps:g}", "path": s.path,
        }  # fmt: skip

    def close(self) -> None:
        """See AbstractCamera."""
        self._closed = True

    def frames(self) -> Iterator[Frame]:
        """See AbstractCamera."""
        s = self._settings
        renderer = Renderer(self._surface(self._defects), s.size, float(np.deg2rad(s.place[2])), s.shade)
        begun = self._clock.now_ns()
        for exposure in self._exposures:
            if self._closed:
                return
            if s.realtime:
                self._clock.wait_until(begun + self._after(exposure.sequence))
            travel = round(exposure.u * self._path.step * (1 + s.encoder_error), 3) if s.encoder else None
            yield self._frame(self._expose(renderer, exposure), exposure.sequence, travel)

    def look(self, at: Pose, sequence: int = 0, *, covered: bool = False) -> Frame:
        """One frame from a hand that is told where to be, rather than from a sweep.

        `at` is over the fixture, as the sweep's path is. Frames of one `sequence` have the same noise and time.
        `covered`: something stands before the lens, out of focus.
        """
        s = self._settings
        shake = np.random.default_rng([s.seed, 4, sequence]).standard_normal(2) * s.vibration
        pose = over_part(np.array([at.x, at.y]) + shake, at.angle, s.place)
        if self._looked is None or self._looked[0] != pose.angle:
            self._looked = pose.angle, Renderer(self._surface(self._defects), s.size, pose.angle, s.shade)
        image = self._looked[1].picture(pose)
        if covered:
            image = cv2.GaussianBlur(image, (0, 0), s.size[0] / 8) / 3
        image *= np.float32(s.gain)
        return self._frame(image, sequence)

    def truth(self) -> tuple[FrameTruth, ...]:
        """What every frame shows: for tests, never for an inspection."""
        patches = [(defect.kind, self._patch(defect)) for defect in self._defects]
        return tuple(frame_truth(e, self._path, patches, self._settings) for e in self._exposures)

    def _surface(self, defects: tuple[Defect, ...]) -> Surface:
        s = self._settings
        return surface_of(replace(s.part, unit=s.unit), defects, s.scale, s.colour)

    def _patch(self, defect: Defect) -> Patch | None:
        return patch_of(self._surface(()), self._surface((defect,)))

    def _expose(self, renderer: Renderer, exposure: Exposure) -> np.ndarray:
        """What falls on the sensor: light, motion blur."""
        s, image = self._settings, renderer.picture(exposure.pose)
        if s.blur > 1:
            image = cv2.blur(image, (s.blur, 1) if self._sideways(exposure.u) else (1, s.blur))
        phase = 2 * np.pi * (exposure.u / self._path.last + s.seed * 0.381966)
        image *= np.float32(s.gain * (1 + s.drift * np.sin(phase)))
        return image

    def _frame(self, image: np.ndarray, sequence: int, travel: float | None = None) -> Frame:
        """What the sensor makes of it: noise, rounding, and the time at which it was taken."""
        s, rng = self._settings, np.random.default_rng([self._settings.seed, 2, sequence])
        if s.noise:
            noise = rng.standard_normal(image.shape, np.float32)
            noise *= np.float32(s.noise)
            image += noise
        pixels, encoded = cv2.convertScaleAbs(np.maximum(image, 0, out=image)), None
        if s.jpeg:
            encoded = encode_jpeg(pixels, s.jpeg)
            pixels = decode(encoded)
        return Frame(pixels, START_NS + self._after(sequence), sequence, travel, encoded)

    def _after(self, sequence: int) -> int:
        """Nanoseconds from the start."""
        return round(sequence * 1e9 / self._settings.fps)

    def _sideways(self, u: float) -> bool:
        """Whether the path goes more across than down here: blur is along the nearer axis only."""
        ahead, behind = self._path.at(np.array([u + 0.5, u - 0.5]))
        return abs(ahead[0] - behind[0]) >= abs(ahead[1] - behind[1])


@lru_cache(maxsize=6)
def surface_of(part: Part, defects: tuple[Defect, ...], scale: float, colour: bool) -> Surface:
    """The surface of one part, drawn once."""
    canvas = draw_part(part, with_defects(features_of(part), defects), scale)
    for defect in defects:
        mark(canvas, defect)
    return Surface.of(canvas, colour)


def _defects(settings: Settings, path: Path) -> tuple[Defect, ...]:
    """The defects asked for, each where the camera sees it in the middle; what was not told is drawn by seed."""
    rng = np.random.default_rng([settings.seed, 3])
    found: list[Defect] = []
    for index, name in enumerate(settings.defect):
        kind = str(rng.choice(KINDS)) if name == "any" else name
        chance = (index + float(rng.uniform(0.15, 0.85))) / len(settings.defect)
        s = settings.at[index] if index < len(settings.at) else 0.04 + 0.92 * chance
        x, y = path.at(np.array([s * path.last]))[0]
        size = settings.defect_size or USUAL_SIZE[kind]
        found.append(Defect(kind, float(x), float(y), size, settings.strength, int(rng.integers(1 << 31))))
    return tuple(found)
