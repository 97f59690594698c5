"""Judging is a fold over scored frames: deviations, coverage, health, verdict; no picture is needed again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from models.deviations import deviations
from models.fixture import Path
from models.registration import WIDE
from models.verdict import Deviation, FrameState, Judgement, Policy, Result, ScoredFrame

_SEES = 0.15
"""A scored frame vouches for places whose pictures lie within this share of the width of its own."""
_STRAYS = 0.1
"""Share of frames without a place, above which short coverage means another part, not a sweep that ended early."""
_UNSCORED = {
    FrameState.WAITING: "agreed with no place",
    FrameState.AMBIGUOUS: "looked like more than one place, or like none for certain",
    FrameState.LOST: "agreed with no place",
    FrameState.STRANGE: "did not look as the part does there",
    FrameState.BLIND: "showed nothing",
}
"""What is said of frames that were not scored."""
_FEW = 5
"""Shorter sweeps show nothing of a part."""


def judge(
    frames: Sequence[ScoredFrame],
    policy: Policy,
    s: Float[np.ndarray, " n"],
    path: Path,
    *,
    appearance_id: str,
    dropped: int,
    digest: str,
    stopped: bool = False,
) -> Result:
    """The verdict on a sweep, with every reason. The order of weight: INVALID, INCOMPLETE, NG, REVIEW, OK.

    A sweep that ended early is INCOMPLETE even where deviations were found, so that a line never mistakes an aborted
    sweep for an inspected part; a sweep that the line `stopped` because NG was certain stays NG.
    """
    scored = [frame for frame in frames if frame.state is FrameState.SCORED]
    covered = _covered(scored, s, path)
    coverage = float(covered.mean()) if scored else 0.0
    found = deviations(scored, policy, place(s))
    verdict, reasons = _verdict(frames, policy, coverage, found, stopped)
    if coverage < policy.coverage:
        reasons = (*reasons, *_missing(covered, s, frames))
    return Result(verdict, reasons, coverage, len(scored), dropped, found, appearance_id, digest, tuple(frames))


def place(s: Float[np.ndarray, " n"]) -> float:
    """How far along s one place of the reference sweep reaches, usually."""
    return float(np.median(np.diff(s)))


def rescaled(frames: Sequence[ScoredFrame], by: float) -> tuple[ScoredFrame, ...]:
    """The frames as they would have scored with limits `by` times lower: `judge` them again, without a picture.

    From one false-reject target to another, `by` is the old promise's factor over the new one's. Where limits fall,
    regions are missing that had not reached the threshold; scores that were below half of it may be too high.
    """
    return tuple(
        replace(
            frame,
            score=frame.score * by,
            residuals=replace(frame.residuals, appearance=frame.residuals.appearance * by),
            regions=tuple(
                replace(region, score=region.score * by) for region in frame.regions if region.score * by >= 1.0
            ),
        )
        for frame in frames
    )


def _verdict(
    frames: Sequence[ScoredFrame],
    policy: Policy,
    coverage: float,
    found: tuple[Deviation, ...],
    stopped: bool,
) -> tuple[Judgement, tuple[str, ...]]:
    scored = [frame for frame in frames if frame.state is FrameState.SCORED]
    strayed = (len(frames) - len(scored)) / max(len(frames), 1)
    # a sweep that was broken off came to fewer places, but was at home in those
    foreign = strayed > (policy.invalid_share if coverage >= policy.coverage else _STRAYS)
    if len(scored) < _FEW or foreign:
        return Judgement.INVALID, (_why_invalid(frames, scored),)
    wrong = [d for d in found if d.kind == "appearance"]
    told = tuple(_told(d) for d in found)
    if coverage < policy.coverage and not (wrong and stopped):
        return Judgement.INCOMPLETE, told
    if wrong:
        return Judgement.NG, told
    peak = max(scored, key=lambda frame: frame.score)
    doubts = [*told]
    if _runs_backwards(scored):
        doubts.append("the sweep ran backwards: other than learnt")
    if peak.score >= 1.0 - policy.review_margin:
        doubts.append(f"near the limit: score {peak.score:.2f} at s = {peak.s:.3f} (frame {peak.index})")
    if doubts:
        return Judgement.REVIEW, tuple(doubts)
    return Judgement.OK, (f"all places within tolerance: highest score {peak.score:.2f} at s = {peak.s:.3f}",)


def _runs_backwards(scored: Sequence[ScoredFrame]) -> bool:
    """Whether most of the way was swept from its end to its beginning."""
    places = np.array([frame.s for frame in scored], float)
    way = np.diff(places)
    return float(-way[way < 0].sum()) > float(way[way > 0].sum())


def _why_invalid(frames: Sequence[ScoredFrame], scored: Sequence[ScoredFrame]) -> str:
    blind = sum(frame.state is FrameState.BLIND for frame in frames)
    if not frames:
        return "no frame came"
    if blind > len(frames) / 2:
        return f"{blind} of {len(frames)} frames show nothing: lamp out, lens covered or saturated"
    return (
        f"only {len(scored)} of {len(frames)} frames agree with the learnt part: another part, the wrong way round, "
        "or another sweep"
    )


def _told(deviation: Deviation) -> str:
    polarity = f" too {deviation.polarity}" if deviation.polarity else ""
    return (
        f"{deviation.kind}{polarity} between s = {deviation.s_start:.3f} and {deviation.s_end:.3f}, "
        f"score {deviation.peak_score:.2f} at frame {deviation.peak_index}"
    )


def _covered(scored: Sequence[ScoredFrame], s: Float[np.ndarray, " n"], path: Path) -> Bool[np.ndarray, " n"]:
    """Which places were seen: those that a scored frame shows most of."""
    covered = np.zeros(len(s), bool)
    places = np.arange(len(s))
    points = path.points
    for frame in scored:
        at = float(np.interp(frame.s if frame.s is not None else 0.0, s, places))
        near = slice(max(0, int(at) - 12), min(len(s), int(at) + 14))
        off = points[near] - points[min(round(at), len(s) - 1)]
        covered[near] |= (np.hypot(off[:, 0], off[:, 1]) <= _SEES * WIDE) & (np.abs(places[near] - at) < 8)
    return covered


def _missing(
    covered: Bool[np.ndarray, " n"], s: Float[np.ndarray, " n"], frames: Sequence[ScoredFrame]
) -> tuple[str, ...]:
    """A sentence for each long stretch that was not seen, with what became of the frames that may have shown it."""
    edges = np.flatnonzero(np.diff(np.concatenate([[1], covered.astype(np.int8), [1]])))
    stretches = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= max(2, 0.01 * len(s))]
    gaps = _gaps(frames)
    told: list[str] = []
    for a, b in stretches:
        start, end = float(s[a]), float(s[min(b, len(s) - 1)])
        said = Counter(_UNSCORED[state] for low, high, run in gaps if low < end and high > start for state in run)
        why = ", ".join(f"{count} frame{'s' * (count > 1)} {what}" for what, count in said.items())
        told.append(f"not seen between s = {start:.3f} and {end:.3f}{': ' * bool(why)}{why}")
    return tuple(told)


def _gaps(frames: Sequence[ScoredFrame]) -> list[tuple[float, float, list[FrameState]]]:
    """Runs of frames that were not scored: the lowest and highest s that they may have shown, and their states."""
    scored = [frame for frame in frames if frame.state is FrameState.SCORED]
    first, last = (1.0, 0.0) if _runs_backwards(scored) else (0.0, 1.0)
    gaps: list[tuple[float, float, list[FrameState]]] = []
    before, run = first, list[FrameState]()
    for frame in frames:
        if frame.state is not FrameState.SCORED:
            # what was lost in the end was so from the beginning
            if frame.state is FrameState.LOST:
                run = [frame.state if state is FrameState.AMBIGUOUS else state for state in run]
            run.append(frame.state)
            continue
        after = before if frame.s is None else frame.s
        if run:
            gaps.append((min(before, after), max(before, after), run))
        before, run = after, []
    return [*gaps, (min(before, last), max(before, last), run)] if run else gaps
