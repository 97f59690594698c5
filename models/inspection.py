"""begin, step, conclude: the one and only scoring path, live, in replay and in batch."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from math import hypot

import numpy as np
from jaxtyping import Float, Float32

from models.appearance import Appearance
from models.beginning import Beginning, agrees
from models.errors import PictureError
from models.excess import BRIGHT, DARK, Excess, strongest
from models.frame import Frame
from models.judging import judge
from models.limits import promise
from models.recognition import Other, recognise
from models.registration import WIDE, affine, full_pose
from models.scoring import Look, Memory, look, regions, remember
from models.tolerance import aligned, cells_shown, levels
from models.verdict import FrameState, Judgement, Policy, Residuals, Result, ScoredFrame

_LOST_AFTER = 8
"""Frames that agree with no place, one after the other, before it is said to be lost."""
_WAITS = 200
"""Frames without one that could be compared, after which the part is waited for again."""
_CHUNK = 256
_UNSURE = 1.5
"""Standard deviation of the place, in reference frames, from which on it is not known."""
_OFFSET_LIMIT = 0.08
"""Share of the picture's width by which a part may lie off: beyond, the fixture or the camera has moved."""
_OFF_CURVE = 40.0
"""Distance from the manifold, in standard deviations of a good part, at the limit of the position residual."""
_PACE_LIMIT = 3.0
"""Times the reference pace at the limit of the timing residual."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """One sweep of one part, so far. A value: keep it, resume it, compare two of them."""

    appearance: Appearance
    policy: Policy
    factor: float
    """Of the limits, for the false-reject target and the sensitivity of the policy."""
    memory: Memory
    beginning: Beginning
    """Whether the right part lies there, the right way round."""
    earlier: tuple[tuple[ScoredFrame, ...], ...] = ()
    """All frames scored but the last few, so many at a time: one more frame costs no more after ten thousand."""
    latest: tuple[ScoredFrame, ...] = ()
    last_scored: int | None = None
    """Index of the last frame that could be compared."""
    dropped: int = 0
    last_sequence: int | None = None
    first_ns: int = 0
    """Time of the first frame."""
    chain: bytes = b""
    """sha256 over the chain before and the latest frame, so that the digest costs the same after any number."""

    @property
    def count(self) -> int:
        """Number of frames so far."""
        return len(self.earlier) * _CHUNK + len(self.latest)

    @cached_property
    def frames(self) -> tuple[ScoredFrame, ...]:
        """What was said of every frame so far."""
        return tuple(frame for chunk in (*self.earlier, self.latest) for frame in chunk)

    def with_scored(self, scored: ScoredFrame) -> Inspection:
        """With what was said of one frame more, and what follows from that alone: neither memory nor sequence."""
        earlier, latest = self.earlier, (*self.latest, scored)
        if len(latest) == _CHUNK:
            earlier, latest = (*earlier, latest), ()
        first_ns = self.first_ns if self.count else scored.t_ns
        return replace(
            self,
            earlier=earlier,
            latest=latest,
            last_scored=scored.index if scored.state is FrameState.SCORED else self.last_scored,
            first_ns=first_ns,
            chain=_link(self.chain, scored, first_ns),
        )


@dataclass(frozen=True, eq=False)
class Explanation:
    """What should be there, and what is: pictures on the reference's grid."""

    expected: np.ndarray
    """uint8 (h, w) or (h, w, 3)."""
    seen: np.ndarray
    """The frame laid on it and lit like it, uint8."""
    difference: np.ndarray
    """float32 grey levels, seen less expected."""
    placement: tuple[float, ...]


def begin(appearance: Appearance, policy: Policy | None = None) -> Inspection:
    """Before the first frame of a part."""
    policy = policy or Policy()
    factor = promise(appearance.peaks, policy.false_rejects).factor / policy.sensitivity
    return Inspection(appearance, policy, factor, remember(appearance), Beginning.of(appearance))


def step(inspection: Inspection, frame: Frame) -> tuple[Inspection, ScoredFrame]:
    """Score one frame. Raises PictureError for a picture of another kind, and then nothing has changed."""
    appearance = inspection.appearance
    kind = appearance.references.kind
    if frame.kind != kind:
        raise PictureError(
            f"frame {frame.sequence} is {frame.kind}, the appearance was learnt from {kind}; "
            "nothing else can be compared"
        )
    memory, shown = look(appearance, inspection.factor, inspection.memory, frame)
    beginning = inspection.beginning.with_frame(appearance, frame, shown)
    scored = _scored(inspection, frame, memory, shown, beginning)
    last = inspection.last_sequence
    dropped = inspection.dropped + (max(0, frame.sequence - last - 1) if last is not None else 0)
    now = replace(
        inspection.with_scored(scored),
        memory=memory,
        beginning=beginning,
        dropped=dropped,
        last_sequence=frame.sequence,
    )
    return now, scored


def conclude(inspection: Inspection, stopped: bool = False, others: Sequence[Other] | None = None) -> Result:
    """The verdict. `stopped` says that the line broke the sweep off on purpose, because NG was certain.

    Where the sweep is INVALID because it does not begin as the learnt one, and `others` are given (none will do), it is
    asked what lies there instead. That costs as much as some hundred frames, and changes neither verdict nor digest.
    """
    appearance, beginning = inspection.appearance, inspection.beginning
    result = judge(
        inspection.frames,
        inspection.policy,
        appearance.s,
        appearance.path,
        appearance_id=appearance.id,
        dropped=inspection.dropped,
        digest=digest(inspection),
        stopped=stopped,
    )
    if others is None or not beginning.doubted or result.verdict is not Judgement.INVALID:
        return result
    recognised = recognise(appearance, [frame.pixels for frame in beginning.kept], others)
    if recognised is None:
        return result
    return replace(result, reasons=(recognised.sentence(), *result.reasons), recognised=recognised)


def digest(inspection: Inspection) -> str:
    """sha256 over appearance, policy and every scored frame; not over ids and clocks."""
    running = hashlib.sha256(inspection.appearance.id.encode())
    running.update(json.dumps(asdict(inspection.policy), sort_keys=True).encode())
    running.update(inspection.chain)
    return "sha256:" + running.hexdigest()


def _link(chain: bytes, scored: ScoredFrame, first_ns: int) -> bytes:
    """All that was said of a frame, its time counted from the first one's, on top of all before."""
    said = json.dumps(vars(scored) | {"t_ns": scored.t_ns - first_ns}, default=vars, sort_keys=True)
    return hashlib.sha256(chain + said.encode()).digest()


def explain(appearance: Appearance, frame: Frame, scored: ScoredFrame) -> Explanation | None:
    """Expected and seen side by side; None where the frame was not compared."""
    if scored.reference < 0:
        return None
    expected = appearance.references.get(scored.reference).picture
    seen = aligned(levels(frame.pixels), _pose(scored, frame.size), np.array(scored.light))
    whole = np.clip(expected, 0, 255).astype(np.uint8)
    difference = seen - expected.astype(np.float32)
    return Explanation(whole, np.clip(seen, 0, 255).astype(np.uint8), difference, scored.placement)


def out_of_tolerance(
    appearance: Appearance, policy: Policy, scored: ScoredFrame, shown: Explanation
) -> Float32[np.ndarray, "h w"]:
    """Pixel by pixel, what the score is made of: above 0 too bright, below too dark, 1 and -1 at the threshold.

    Edges that stray are forgiven, and 0 is where nothing is compared. A score is a mean of this over some pixels that
    several frames agree on, so single pixels may reach more. Of the fine scale only, and of the strongest colour.
    """
    reference, factor = appearance.references.get(scored.reference), begin(appearance, policy).factor
    pose, cell, size = _pose(scored, appearance.size), reference.cell, appearance.size
    rows, cols = cells_shown(pose, size, cell)
    seen, unseen = appearance.ignored.laid(reference.picture, shown.seen.astype(reference.picture.dtype), pose, cell)
    excess = Excess.of(reference.picture, (reference.band.low, reference.band.high), seen)
    both: list[Float32[np.ndarray, "h w"]] = []
    for polarity in (BRIGHT, DARK):
        limit = np.full(reference.thresholds[0].shape, np.inf, np.float32)
        limit[rows, cols] = factor * reference.thresholds[0][rows, cols]
        if reference.allowed is not None:
            limit *= reference.allowed[:, :, polarity]
        if unseen is not None:
            limit[unseen] = np.inf
        each = np.repeat(np.repeat(limit, cell, axis=0), cell, axis=1)[: size[1], : size[0]]
        both.append(strongest(excess.forgiven(polarity)).astype(np.float32) / each)
    return np.where(both[0] >= both[1], both[0], -both[1])


def _pose(scored: ScoredFrame, size: tuple[int, int]) -> Float[np.ndarray, " 3"]:
    """Shift and turn of a frame of this (width, height) on its reference picture, by its placement."""
    a, _, c, d, _, f = scored.placement
    pose = np.array([0.0, 0.0, np.arctan2(d, a)])
    base = affine(pose, size)
    pose[:2] = c - base[0, 2], f - base[1, 2]
    return pose


def _scored(
    inspection: Inspection, frame: Frame, memory: Memory, shown: Look | None, beginning: Beginning
) -> ScoredFrame:
    index, appearance = inspection.count, inspection.appearance
    state = _state(inspection, memory, shown)
    if state is FrameState.SCORED and shown is not None and beginning.failed and agrees(appearance, shown) is False:
        state = FrameState.STRANGE
    if state is not FrameState.SCORED or shown is None or shown.score is None:
        none = Residuals(0.0, 0.0, 0.0)
        s = None if shown is None or state is not FrameState.STRANGE else _coordinate(appearance, shown)
        return ScoredFrame(index, frame.t_ns, state, s, 0.0, 0.0, none)
    located = shown.located
    score, s = shown.peak, _coordinate(appearance, shown)
    residuals = Residuals(score, _position(appearance, memory, shown), _timing(memory))
    pose = full_pose(located.registered.pose, appearance.size)
    placement = tuple(affine(pose, appearance.size).ravel().tolist())
    return ScoredFrame(
        index,
        frame.t_ns,
        state,
        s,
        score,
        shown.raw,
        residuals,
        regions(appearance, shown),
        located.reference,
        placement,
        tuple(located.registered.light.tolist()),
    )


def _coordinate(appearance: Appearance, shown: Look) -> float:
    at = min(max(shown.located.at, 0.0), appearance.places - 1.0)
    i = min(int(at), appearance.places - 2)
    return float(appearance.s[i] + (at - i) * (appearance.s[i + 1] - appearance.s[i]))


def _state(inspection: Inspection, memory: Memory, shown: Look | None) -> FrameState:
    if shown is None:
        return FrameState.BLIND
    if shown.score is not None and shown.located.uncertainty <= _UNSURE:
        return FrameState.SCORED
    if shown.located.resembles:
        return FrameState.STRANGE
    if inspection.last_scored is None or inspection.last_scored < inspection.count - _WAITS:
        return FrameState.WAITING
    return FrameState.LOST if memory.trail.misses > _LOST_AFTER else FrameState.AMBIGUOUS


def _position(appearance: Appearance, memory: Memory, shown: Look) -> float:
    """Off the curve: the look does not belong to the place, or the part lies off in its fixture."""
    fixture = memory.trail.fixture
    off = 0.0
    if fixture is not None:
        off = hypot(*fixture.offset[:2].tolist()) / (_OFFSET_LIMIT * WIDE)
    # the curve's slopes hold for small shifts only: a part that lies off is allowed more
    shift = hypot(*shown.located.registered.pose[:2].tolist())
    return max(off, shown.z_distance / (_OFF_CURVE * (1.0 + 0.5 * shift)))


def _timing(memory: Memory) -> float:
    """How far the pace is from the learnt one; a standstill stays below the limit."""
    fixture = memory.trail.fixture
    if fixture is None:
        return 0.0
    pace = float(fixture.mean[1])
    return abs(pace - 1.0) / (_PACE_LIMIT - 1.0)
