"""An appearance, and golden recordings where there are some, to a detectability map."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from inspector.recording import SweepReader
from models.appearance import Appearance
from models.defects import Kind
from models.detectability import Detectability
from models.errors import NumericError
from models.frame import Frame
from models.probe import CONTRASTS, SPACING, SPACING_FINE, probe
from models.verdict import Policy

_HELD_BYTES = 256 * 2**20
"""Of decoded frames, over all recordings: longer ones are decoded anew each time they are read."""


def probe_recordings(
    appearance: Appearance,
    paths: Sequence[Path] = (),
    policy: Policy = Policy(),  # noqa: B008 (a frozen value)
    progress: Callable[[float], None] | None = None,
    *,
    kinds: Sequence[Kind] = tuple(Kind),
    contrasts: Sequence[float] = CONTRASTS,
    fine: bool = False,
    topic: str | None = None,
    tell: Callable[[str], object] = lambda loss: None,
) -> Detectability:
    """Put synthetic defects into recordings of good parts, or into the reference pictures where there are none.

    `progress` is called with the share done, `tell` with a sentence for each thing that a recording has lost. Raises
    RecordingError; LearningError and PictureError name the recordings.
    """
    readers = [SweepReader(path, topic=topic) for path in paths]
    sweeps = [_held(reader, _HELD_BYTES // len(readers)) for reader in readers]
    try:
        spacing = SPACING_FINE if fine else SPACING
        found = probe(appearance, policy, sweeps, kinds=kinds, contrasts=contrasts, spacing=spacing, progress=progress)
    except NumericError as error:
        if not paths:
            raise
        raise type(error)(f"{', '.join(str(path) for path in paths)}: {error}") from error
    for reader in readers:
        for loss in reader.losses:
            tell(f"{reader.path}: {loss}")
    return found


def _held(reader: SweepReader, most: int) -> Iterable[Frame]:
    """The frames in memory where they are not too many; else the reader."""
    frames: list[Frame] = []
    size = 0
    for frame in reader:
        size += frame.pixels.nbytes
        if size > most:
            return reader
        frames.append(Frame(frame.pixels, frame.t_ns, frame.sequence, frame.encoder))
    return frames
