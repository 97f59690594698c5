"""Appearance: everything learnt of a part. Immutable, verified when loaded, named by the hash of its bytes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int, UInt

from models.eigenspace import Eigenspace
from models.encoder import Encoder, leads_on
from models.errors import AppearanceError
from models.fixture import Path
from models.ignored import Ignored
from models.limits import Limits
from models.localise import Guide, asked
from models.manifold import Manifold
from models.position import Track
from models.preparation import Preparation
from models.references import References
from models.registration import Grid
from models.sealed import Seal, under
from models.turning import Turn

VERSION = 3
SEAL = Seal(
    "appearance",
    VERSION,
    AppearanceError,
    "`inspector learn` makes them",
    "learn the part again",
    "restore it, or learn again",
)
_HUGE = 1e9


@dataclass(frozen=True, eq=False)
class Appearance:
    """What a part looks like along a sweep, over n places, m of them with a picture.

    Made by `models.learning.learn`. The bytes are sealed (`models.sealed`).
    """

    preparation: Preparation
    eigenspace: Eigenspace
    manifold: Manifold
    """Over s; its axis holds the sweep coordinate of each place."""
    slope: Float[np.ndarray, "n 5 k"]
    """How z moves with the picture: per pixel of shift in x and y, per radian, per unit of shading in x and y."""
    motion: Float[np.ndarray, "n 2"]
    """How far the picture moves from each place to the next, in pixels."""
    shifts: bool
    """Whether the picture moves from place to place; else it changes otherwise: turntables, corridors."""
    spare: float
    """Squared distance from the eigenspace that pictures of the reference sweep have."""
    rivals: Float[np.ndarray, " n"]
    """Agreement that pictures of other places reach at each place, in [0, 1]."""
    reached: Float[np.ndarray, " n"]
    """The lowest agreement that golden sweeps beyond the first reached there; 1 where there were none."""
    keys: Int[np.ndarray, " m"]
    """The places whose pictures are kept, increasing; frames between them are compared with the nearest by travel."""
    points: UInt[np.ndarray, "m p"]
    """Where registration looks: a pixel in each cell of a grid over each reference picture."""
    pictures: tuple[bytes, ...]
    """The reference pictures of the key places, JPEG or PNG."""
    tolerance: tuple[bytes, ...]
    """What further golden sweeps showed beyond the assumed limits, cell by cell, PNG per key place; empty where
    nothing."""
    limits: tuple[Limits, ...]
    """What is assumed of good parts, per scale: the fine one, and the coarse one where there are sweeps to tell."""
    peaks: tuple[float, ...]
    """What each golden sweep reached against the others, in units of that; none with a single sweep."""
    noise: float
    """Standard deviation of a coordinate of z at a known place, from the sensor alone."""
    interval_ns: int
    """Nominal time from frame to frame."""
    encoder: Float[np.ndarray, " n"] = field(default_factory=lambda: np.zeros(0))
    """Encoder position of each place, in its own unit, never turning back; empty where the sweep carried none such."""
    facts: Mapping[str, str] = field(default_factory=dict[str, str])
    """Where it comes from: number of sweeps and frames, versions of the libraries."""

    @property
    def places(self) -> int:
        """Number of places of the reference sweep."""
        return len(self.motion)

    @cached_property
    def s(self) -> Float[np.ndarray, " n"]:
        """Sweep coordinate of each place."""
        return self.manifold.axes[0]

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the pictures learnt from, in pixels."""
        return self.references.size

    @cached_property
    def references(self) -> References:
        """The reference pictures, ready for registration and comparison."""
        return References(self.pictures, self.points, self.limits, self.tolerance, self.keys, ignored=self.ignored)

    @cached_property
    def ignored(self) -> Ignored:
        """Pixels of every frame that say nothing."""
        return Ignored.of(self.preparation.ignore)

    @cached_property
    def track(self) -> Track:
        """The curve as the position filter uses it."""
        z, slope = self.manifold.samples.astype(float), self.slope.astype(float)
        return Track(z, slope, self.motion.astype(float), self.noise)

    @cached_property
    def guide(self) -> Guide:
        """What places a frame."""
        enough = asked(self.rivals.astype(float), self.reached.astype(float))
        turn = None if self.shifts else Turn(self.track.z, self.spare)
        encoder = Encoder(self.encoder) if len(self.encoder) else None
        return Guide(self.track, self.path, lambda place: self.references.get(place).template, enough, turn, encoder)

    @cached_property
    def path(self) -> Path:
        """How the picture moves along the sweep."""
        return Path(self.motion.astype(float), self.keys)

    def key_at(self, s: float) -> int:
        """The place whose reference picture shows most of what is seen at s."""
        return self.path.key(float(np.interp(s, self.s, np.arange(self.places))))

    @cached_property
    def id(self) -> str:
        """Its name: `sha256:` and the hash of its bytes."""
        return "sha256:" + hashlib.sha256(self.to_bytes()).hexdigest()

    def to_bytes(self) -> bytes:
        """The same appearance always gives the same bytes."""
        arrays = {
            **{f"preparation.{k}": v for k, v in self.preparation.arrays().items()},
            **{f"eigenspace.{k}": v for k, v in self.eigenspace.arrays().items()},
            **{f"manifold.{k}": v for k, v in self.manifold.arrays().items()},
            "slope": self.slope,
            "motion": self.motion,
            "rivals": self.rivals,
            "reached": self.reached,
            "keys": self.keys,
            "points": self.points,
            **_joined("pictures", self.pictures),
            **_joined("tolerance", self.tolerance),
            **({"encoder": self.encoder} if len(self.encoder) else {}),
        }
        header = {
            "preparation": self.preparation.to_header(),
            "manifold": self.manifold.to_header(),
            "shifts": self.shifts,
            "spare": self.spare,
            "limits": [asdict(limits) for limits in self.limits],
            "peaks": self.peaks,
            "noise": self.noise,
            "interval_ns": self.interval_ns,
            "facts": dict(self.facts),
        }
        return SEAL.to_bytes(arrays, header)

    @classmethod
    def from_bytes(cls, data: bytes) -> Appearance:
        """Verified: raises AppearanceError for a file that is foreign, newer, cut or changed in any bit."""
        arrays, header = SEAL.opened(data)
        try:
            return cls(
                Preparation.from_parts(header["preparation"], under("preparation.", arrays)),
                Eigenspace.from_arrays(under("eigenspace.", arrays)),
                Manifold.from_parts(header["manifold"], under("manifold.", arrays)),
                arrays["slope"],
                arrays["motion"],
                bool(header["shifts"]),
                float(header["spare"]),
                arrays["rivals"],
                arrays["reached"],
                arrays["keys"],
                arrays["points"],
                _parted("pictures", arrays),
                _parted("tolerance", arrays),
                tuple(Limits(**limits) for limits in header["limits"]),
                tuple(float(peak) for peak in header["peaks"]),
                float(header["noise"]),
                int(header["interval_ns"]),
                arrays.get("encoder", np.zeros(0)),
                header["facts"],
            )._checked()
        except AppearanceError:
            raise
        # a file made by hand can be wrong in more ways than can be named
        except Exception as error:
            raise AppearanceError(f"the appearance lacks what version {VERSION} holds: {error}") from error

    def _checked(self) -> Appearance:
        n, m, k, p = self.places, len(self.pictures), self.eigenspace.k, self.preparation.length(self.size)
        grid = Grid.over(self.references.template_size)
        allowed = {
            "mean": (self.eigenspace.mean, (p,)),
            "basis": (self.eigenspace.basis, (k, p)),
            "samples": (self.manifold.samples, (n, k)),
            "slope": (self.slope, (n, 5, k)),
            "motion": (self.motion, (n, 2)),
            "rivals": (self.rivals, (n,)),
            "reached": (self.reached, (n,)),
            "keys": (self.keys, (m,)),
            "points": (self.points, (m, grid.rows * grid.cols)),
            "encoder": (self.encoder, (n,) if len(self.encoder) else (0,)),
        }
        kinds = {"keys": "i", "points": "u"}
        for name, (array, shape) in allowed.items():
            if array.shape != shape:
                raise AppearanceError(f"the appearance's {name} has shape {array.shape}, allowed is {shape}")
            if array.dtype.kind != kinds.get(name, "f") or not np.isfinite(array).all():
                raise AppearanceError(f"the appearance's {name} holds what is no number, or none of its kind")
        if self.preparation.picture != self.size:
            raise AppearanceError(f"prepared are pictures of {self.preparation.picture}, kept are some of {self.size}")
        if len(self.tolerance) != m:
            raise AppearanceError(
                f"the appearance holds {len(self.tolerance)} tolerances, allowed is one a picture: {m}"
            )
        if len(self.limits) not in (1, 2):
            raise AppearanceError(f"the appearance holds limits of {len(self.limits)} scales, allowed are one or two")
        if self.keys[0] < 0 or self.keys[-1] >= n or (np.diff(self.keys) < 1).any():
            raise AppearanceError(f"the appearance's keys are {self.keys}, allowed are increasing places below {n}")
        if len(self.encoder) and not leads_on(self.encoder):
            raise AppearanceError("the appearance's encoder positions turn back or stand still, allowed is one way")
        w, h = self.references.template_size
        if min(n - 1, k) < 1 or self.points.max() >= grid.side**2:
            raise AppearanceError(f"the appearance's points lie outside of the cells of its {w}x{h} templates")
        if np.abs(self.motion).max() > max(w, h):
            raise AppearanceError(f"the appearance's motion leaves its {w}x{h} templates from one place to the next")
        self._check_numbers()
        if self.facts != {name: str(fact) for name, fact in self.facts.items()}:
            raise AppearanceError(f"the appearance's facts are {self.facts}, allowed is text")
        return self

    def _check_numbers(self) -> None:
        numbers = {"noise": self.noise, "spare": self.spare, **{f"peak {i}": peak for i, peak in enumerate(self.peaks)}}
        for i, limits in enumerate(self.limits):
            numbers |= {f"{name} of scale {i}": value for name, value in asdict(limits).items()}
        for name, value in numbers.items():
            if not 0 <= value < _HUGE:
                raise AppearanceError(f"the appearance's {name} is {value}, allowed are numbers from 0 to {_HUGE}")
        if not self.noise or not all(limits.floor and limits.weight for limits in self.limits):
            raise AppearanceError(f"the appearance tolerates nothing: {self.limits}, noise {self.noise}")


def _joined(name: str, parts: tuple[bytes, ...]) -> dict[str, np.ndarray]:
    ends = np.cumsum([len(part) for part in parts], dtype=np.int64)
    return {name: np.frombuffer(b"".join(parts), np.uint8), f"{name}.ends": ends}


def _parted(name: str, arrays: Mapping[str, np.ndarray]) -> tuple[bytes, ...]:
    data, ends = arrays[name].tobytes(), [0, *map(int, arrays[f"{name}.ends"])]
    return tuple(data[a:b] for a, b in pairwise(ends))
