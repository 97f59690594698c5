"""A result in words: lines for a person at a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from models.verdict import Deviation, Result

WORDS = {"bright": "too bright", "dark": "too dark"}


def sentences(result: Result) -> Iterator[str]:
    """Every deviation with its place, further reasons, coverage, digest."""
    for number, deviation in enumerate(result.deviations, start=1):
        yield f"deviation {number}: {deviation_sentence(deviation)}"
    yield from (reason for reason in result.reasons if not any(_tells(reason, each) for each in result.deviations))
    dropped = f", {result.frames_dropped} dropped" if result.frames_dropped else ""
    yield f"coverage {100 * result.coverage:.1f} %, {result.frames_scored} frames scored{dropped}"
    yield f"digest {result.digest}"


def _tells(reason: str, deviation: Deviation) -> bool:
    """Whether a reason is but the deviation once more; what is not surely so is said twice rather than not at all."""
    return reason.startswith(f"{deviation.kind} ") and reason.endswith(f" frame {deviation.peak_index}")


def deviation_sentence(deviation: Deviation) -> str:
    """Where, what, how much.

    >>> deviation_sentence(Deviation(0.3601, 0.394, 144, 157, "appearance", "bright", 3.21, 150))
    's 0.360–0.394, frames 144–156, too bright, score 3.2 at frame 150'
    """
    what = WORDS.get(deviation.polarity or "", deviation.kind)
    return (
        f"{stretch(deviation)}, frames {deviation.index_start}–{deviation.index_end - 1}, {what},"
        f" score {deviation.peak_score:.1f} at frame {deviation.peak_index}"
    )


def stretch(deviation: Deviation) -> str:
    """The place on the part."""
    return f"s {deviation.s_start:.3f}–{deviation.s_end:.3f}"
