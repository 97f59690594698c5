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
from inspector.cameras.simulated.motion import Exposure, Path, exposures, reference_path
from inspector.cameras.simulated.part import Part, draw_part, features_of
from inspector.cameras.simulated.render import Renderer
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
            t = round(exposure.sequence * 1e9 / s.fps)
            if s.realtime:
                self._clock.wait_until(begun + t)
            yield self._frame(renderer, exposure, START_NS + t)

    def truth(self) -> tuple[FrameTruth, ...]:
        """What every frame shows: for tests, never for an inspection."""
        patches = [(defect.kind, self._patch(defect)) for defect in self._defects]
        return tuple(frame_truth(e, self._path, patches, self._settings) for e in self._exposures)

    def _surface(self, defects: tuple[Defect, ...]) -> Surface:
        s = self._settings
        return surface_of(replace(s.part, unit=s.unit), defects, s.scale, s.colour)

    def _patch(self, defect: Defect) -> Patch | None:
        return patch_of(self._surface(()), self._surface((defect,)))

    def _frame(self, renderer: Renderer, exposure: Exposure, t_ns: int) -> Frame:
        s = self._settings
        pixels, encoded = self._expose(renderer, exposure), None
        if s.jpeg:
            encoded = encode_jpeg(pixels, s.jpeg)
            pixels = decode(encoded)
        travel = round(exposure.u * self._path.step * (1 + s.encoder_error), 3) if s.encoder else None
        return Frame(pixels, t_ns, exposure.sequence, travel, encoded)

    def _expose(self, renderer: Renderer, exposure: Exposure) -> np.ndarray:
        """The sensor's picture: light, motion blur, noise."""
        s, rng = self._settings, np.random.default_rng([self._settings.seed, 2, exposure.sequence])
        image = renderer.picture(exposure.pose)
        if s.blur > 1:
            image = cv2.blur(image, (s.blur, 1) if self._sideways(exposure.u) else (1, s.blur))
        phase = 2 * np.pi * (exposure.u / self._path.last + s.seed * 0.381966)
        image *= np.float32(s.gain * (1 + s.drift * np.sin(phase)))
        if s.noise:
            noise = rng.standard_normal(image.shape, np.float32)
            noise *= np.float32(s.noise)
            image += noise
        return cv2.convertScaleAbs(np.maximum(image, 0, out=image))

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
