"""What can be asked of the simulated camera, by the options of its url."""

from __future__ import annotations

from dataclasses import dataclass

from inspector.cameras.options import choice, flag, number, numbers, whole, words
from inspector.cameras.simulated.defects import KINDS
from inspector.cameras.simulated.part import Part


def _size(text: str) -> tuple[int, int]:
    width, height = (int(v) for v in text.split("x"))
    if not (16 <= width <= 4096 and 12 <= height <= 1.5 * width):
        raise ValueError(text)
    return width, height


def _place(text: str) -> tuple[float, ...]:
    values = numbers(text, 3)
    if any(abs(v) > 180 for v in values):
        raise ValueError(text)
    return values


def _defects(text: str) -> tuple[str, ...]:
    """Names between commas, or how many of any kind."""
    if text.isdecimal():
        if int(text) > 20:
            raise ValueError(text)
        return ("any",) * int(text)
    names = tuple(name for name in text.split(",") if name not in ("", "none"))
    if not set(names) <= set(KINDS):
        raise ValueError(text)
    return names


def _places(text: str) -> tuple[float, ...]:
    values = numbers(text)
    if any(not 0 <= s <= 1 for s in values):
        raise ValueError(text)
    return values


@dataclass(frozen=True)
class Settings:
    """One sweep of one part. Lengths in px of a 320 wide picture ("units"), times in frames."""

    part: Part = words(  # noqa: RUF009 (a field with an immutable default)
        "plate", Part.named, "plate, board or casting, a design's number after it (board2), or a number"
    )
    """The product."""
    unit: int = whole(0, 0)
    """The individual: 0 is the drawing itself, others differ as good parts do."""
    seed: int = whole(1, 0)
    """Everything of this sweep that is left to chance."""
    size: tuple[int, int] = words("320x240", _size, "width x height like 320x240, 16 to 4096 wide, at most 1.5 as high")
    colour: bool = flag()
    jpeg: int = whole(92, 0, 100)
    """Quality in which pictures come, as from an IP camera; 0: raw pixels."""
    path: str = choice("serpentine", "serpentine", "line", "arc")
    step: float = number(8.0, 0.5, 60)
    """Nominal travel per frame."""
    frames: int = whole(0, 0, 20_000)
    """How many frames the nominal sweep has; 0: as `step` gives."""
    fps: float = number(30.0, 0.1, 10_000)
    realtime: bool = flag()
    """Deliver at `fps`, rather than as fast as possible."""

    pace: float = number(0.0, 0, 0.9)
    """Relative amplitude of slow changes of pace."""
    jitter: float = number(0.02, 0, 0.2)
    """Relative unsteadiness of the travel from frame to frame."""
    late: int = whole(0, 0)
    """Frames that are missing at the start."""
    early: int = whole(0, 0, 200)
    """Frames of lead-in before the reference path begins."""
    pause: int = whole(0, 0, 10_000)
    """Frames of standstill, somewhere in the middle."""
    reverse: int = whole(0, 0, 1_000)
    """Frames of moving back, somewhere in the middle."""
    lost: float = number(0.0, 0, 0.9)
    """Share of the frames that are lost: gaps in `sequence`."""
    stop: float = number(1.0, 0, 1)
    """Sweep coordinate at which the sweep is cut short."""
    place: tuple[float, ...] = words("0,0,0", _place, "dx,dy,degrees like 2,-1.5,0.3, each from -180 to 180")
    """Offset and turn of the part in its fixture."""
    vibration: float = number(0.05, 0, 20)
    """Standard deviation of the camera's shake."""

    gain: float = number(1.0, 0, 10)
    """Lamp and exposure."""
    drift: float = number(0.0, 0, 1)
    """Relative amplitude of the lamp's slow change over the sweep."""
    shade: float = number(0.0, -1, 1)
    """Relative change of light from one side of the picture to the other."""
    noise: float = number(2.0, 0, 100)
    """Standard deviation of the sensor's noise, grey levels."""
    blur: int = whole(0, 0, 31)
    """Length of the motion blur, pixels of the frame."""
    encoder: bool = flag()
    """Frames carry the travelled length, in units."""
    encoder_error: float = number(0.0, -0.5, 0.5)
    """Relative error of the encoder's scale."""

    defect: tuple[str, ...] = words("none", _defects, f"none, up to 20 of any kind, or some of {', '.join(KINDS)}")
    at: tuple[float, ...] = words("", _places, "sweep coordinates from 0 to 1 between commas, one per defect")
    """Where the camera sees each defect in the middle; those not told are left to chance."""
    defect_size: float = number(0.0, 0, 120)
    """Extent of each defect; 0: what is usual for its kind."""
    strength: float = number(1.0, 0.02, 3)
    """Contrast of each defect; 1 is plain to the eye."""

    @property
    def scale(self) -> float:
        """Pixels of the frame per unit."""
        return self.size[0] / 320
