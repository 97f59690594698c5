"""What an inspection says: scored frames, deviations, the verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from models.errors import PolicyError


class FrameState(StrEnum):
    """What could be said of one frame."""

    SCORED = "scored"
    """Compared with what should be there."""
    WAITING = "waiting"
    """The part has not come into the picture yet: the sweep has not begun."""
    AMBIGUOUS = "ambiguous"
    """More than one place of the sweep looks like this: not scored, counts against coverage."""
    LOST = "lost"
    """No place of the sweep looks like this: not scored, counts against coverage."""
    STRANGE = "strange"
    """The place is known, but this is not how the part looks there: not scored, counts against coverage."""
    BLIND = "blind"
    """No usable picture: lamp out, lens covered, saturated."""


class Judgement(StrEnum):
    """The verdict on one part."""

    OK = "OK"
    NG = "NG"
    REVIEW = "REVIEW"
    INCOMPLETE = "INCOMPLETE"
    INVALID = "INVALID"


ALLOWED = {
    "false_rejects": (0.0001, 0.5),
    "sensitivity": (0.01, 100.0),
    "review_margin": (0.0, 1.0),
    "hysteresis": (0.0, 1.0),
    "coverage": (0.0, 1.0),
    "invalid_share": (0.0, 1.0),
}
"""Lowest and highest value of each field of a policy."""


@dataclass(frozen=True)
class Policy:
    """Thresholds, apart from what was learnt; changed without learning again."""

    false_rejects: float = 0.02
    """Share of the good sweeps that may be NG; the limits are set by it (`models.limits.promise`)."""
    sensitivity: float = 1.0
    """Multiplies every score: above 1 finds weaker defects, below 1 forgives more."""
    review_margin: float = 0.05
    """A highest score within this share below the threshold asks for REVIEW instead of OK."""
    hysteresis: float = 0.7
    """A deviation that reached 1.0 goes on while the score stays above this."""
    coverage: float = 0.95
    """Share of the sweep that must have been scored; less is INCOMPLETE."""
    invalid_share: float = 0.5
    """More than this share of frames without a known place (or blind) is INVALID."""

    def __post_init__(self) -> None:
        for name, (low, high) in ALLOWED.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise PolicyError(f"{name} is {value}, allowed are {low} to {high}")


@dataclass(frozen=True)
class Region:
    """A place in the frame as recorded, in pixels; score 1.0 is the threshold."""

    x: int
    y: int
    width: int
    height: int
    score: float
    polarity: str
    """`bright` or `dark`, against what should be there."""


@dataclass(frozen=True)
class Residuals:
    """Three ways to be wrong, each 1.0 at its threshold."""

    appearance: float
    """A look never seen: local comparison and distance from the eigenspace."""
    position: float
    """In the space but off the curve: bumped camera, wrong placement."""
    timing: float
    """Right looks at the wrong pace."""


@dataclass(frozen=True)
class ScoredFrame:
    """What the inspection says of one frame."""

    index: int
    """Counts the frames of the inspection from 0."""
    t_ns: int
    state: FrameState
    s: float | None
    """Sweep coordinate in [0, 1], None where the place is not known; known where `state` is `scored` or `strange`."""
    score: float
    """1.0 at the threshold; 0.0 where `state` is not `scored`."""
    raw_score: float
    """Evidence in grey levels before thresholds."""
    residuals: Residuals
    regions: tuple[Region, ...] = ()
    reference: int = -1
    """The place of the reference sweep whose picture it was compared with, counted from 0; -1 where none was."""
    placement: tuple[float, ...] = ()
    """Affine (a, b, c, d, e, f): reference pixel (u, v) lies at (a u + b v + c, d u + e v + f) of the frame."""
    light: tuple[float, ...] = ()
    """Gain, offset in grey levels, shading across and down, that make the reference picture look like the frame."""


@dataclass(frozen=True)
class Deviation:
    """A stretch of the sweep out of tolerance: s_start <= s < s_end, index_start <= index < index_end."""

    s_start: float
    s_end: float
    index_start: int
    index_end: int
    kind: str
    """`appearance`, `position` or `timing`."""
    polarity: str | None
    peak_score: float
    peak_index: int
    regions: tuple[Region, ...] = ()


@dataclass(frozen=True)
class Recognised:
    """What lies there instead of the learnt part as it was learnt."""

    part: str | None
    """Name of the other recipe's part; None for the learnt one."""
    appearance_id: str
    turned: bool
    """By 180 degrees: upside down."""
    agree: int
    of: int
    """So many of so many frames from the beginning agree with that."""
    off: tuple[float, float] | None = None
    """How the learnt part lies, where it is too far off to be followed: pixels across the camera's path, and
    degrees, clockwise in the picture."""

    def sentence(self) -> str:
        """For a reason.

        >>> Recognised(None, "sha256:0", True, 6, 6).sentence()
        'the part lies upside down, turned by 180 degrees: 6 of 6 frames agree with it so'
        >>> Recognised(None, "sha256:0", False, 5, 6, (-31.2, 4.04)).sentence()
        'the part lies off, 31 px across the path, turned by 4.0 degrees: 5 of 6 frames agree with it so'
        """
        what = "the part lies" if self.part is None else f"another part: {self.part} fits better"
        way = f"{',' * (self.part is not None)} upside down, turned by 180 degrees" if self.turned else ""
        if self.off is not None:
            across, degrees = self.off
            way = f" off, {abs(across):.0f} px across the path, turned by {abs(degrees):.1f} degrees"
        return f"{what}{way}: {self.agree} of {self.of} frames agree with it{' so' * bool(way)}"


@dataclass(frozen=True)
class Result:
    """What `conclude` returns."""

    verdict: Judgement
    reasons: tuple[str, ...]
    """A sentence for each thing that decided the verdict."""
    coverage: float
    """Share of the sweep's places that were scored, in [0, 1]."""
    frames_scored: int
    frames_dropped: int
    """Frames that the camera counted but that never came (gaps in `sequence`)."""
    deviations: tuple[Deviation, ...]
    appearance_id: str
    digest: str
    """sha256 over appearance, policy and every scored frame; not over ids and clocks."""
    frames: tuple[ScoredFrame, ...] = field(repr=False, default=())
    recognised: Recognised | None = None
    """What lies there instead, where it was asked and is known: a matter of which others are known, so that neither
    verdict nor digest hang on it."""
