"""A recording -> a result, by the one scoring path; a replay at any speed is the same function of the same frames."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from inspector.errors import RecordingStopped
from inspector.files import NotWritten, arriving
from inspector.recording import ScoredWriter, SweepReader, SweepWriter
from models.appearance import Appearance
from models.errors import NumericError
from models.frame import Frame
from models.inspection import begin, conclude, step
from models.recognition import Other
from models.verdict import Policy, Result, ScoredFrame

OnScored = Callable[[Frame, ScoredFrame], object]


@dataclass(frozen=True)
class Replayed:
    """What a recording turned out to be, judged by one appearance and one policy."""

    result: Result
    facts: dict[str, str]
    """What was said of the sweep when it was recorded: `product_id`, `part_id`, ..."""
    losses: tuple[str, ...]
    """A sentence for each thing that the recording has lost."""


def inspect(
    frames: Iterable[Frame],
    appearance: Appearance,
    policy: Policy,
    on_scored: OnScored | None,
    others: Sequence[Other] = (),
) -> Result:
    """Begin, a step for every frame, conclude: live and in replay. `others` may be what lies there instead."""
    state = begin(appearance, policy)
    for frame in frames:
        state, scored = step(state, frame)
        if on_scored is not None:
            on_scored(frame, scored)
    return conclude(state, others=others)


def replay(
    recording: SweepReader,
    appearance: Appearance,
    policy: Policy = Policy(),  # noqa: B008 (a frozen value)
    *,
    on_scored: OnScored | None = None,
    scored_recording: Path | None = None,
    others: Sequence[Other] = (),
) -> Replayed:
    """Inspect a recording; `scored_recording` names a new file for the frames with what was said of each; `others`
    are the parts of other recipes, one of which an INVALID sweep may be of.

    Raises RecordingError, OutputExists, NotWritten, and PictureError, which names the recording.
    """
    with ExitStack() as stack:
        write = stack.enter_context(_scored(scored_recording, recording)) if scored_recording else None
        heard = [each for each in (write, on_scored) if each is not None]

        def tell(frame: Frame, scored: ScoredFrame) -> None:
            for each in heard:
                each(frame, scored)

        try:
            result = inspect(recording, appearance, policy, tell, others)
        except NumericError as error:
            raise type(error)(f"{recording.path}: {error}") from error
    return Replayed(result, recording.facts, recording.losses)


@contextmanager
def _scored(path: Path, recording: SweepReader) -> Generator[OnScored]:
    """A writer of the scored recording, which is there when all of it is."""
    try:
        with arriving(path) as draft, ScoredWriter(SweepWriter(draft, metadata=recording.facts)) as writer:
            yield writer.write
            for drop in recording.drops:
                writer.drop(drop.count, drop.t_ns)
    except RecordingStopped as error:
        raise NotWritten(path, str(error.__cause__ or error)) from error
