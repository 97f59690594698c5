"""A camera -> a result, while exactly the frames that are scored are recorded, in that order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from inspector.recorder import FrameSource, record
from inspector.replay import OnScored
from models.appearance import Appearance
from models.frame import Frame
from models.inspection import Inspection, begin, conclude, step
from models.recognition import Other
from models.verdict import Policy, Result


class _Inspected:
    """A source that scores each frame when the recorder has taken it and comes for the next one."""

    def __init__(self, source: FrameSource, state: Inspection, on_scored: OnScored | None) -> None:
        self.state = state
        self._source, self._on_scored = source, on_scored

    def frames(self) -> Iterator[Frame]:
        for frame in self._source.frames():
            yield frame
            self.state, scored = step(self.state, frame)
            if self._on_scored is not None:
                self._on_scored(frame, scored)

    def describe(self) -> Mapping[str, str]:
        return self._source.describe()


def inspect_live(
    camera: FrameSource,
    appearance: Appearance,
    policy: Policy = Policy(),  # noqa: B008 (a frozen value)
    *,
    record_to: Path | None = None,
    product_id: str | None = None,
    part_id: str | None = None,
    on_scored: OnScored | None = None,
    others: Sequence[Other] = (),
) -> Result:
    """Inspect what the camera delivers until it ends; `record_to` names a new file for the recording.

    The replay of that recording by the same appearance and policy gives the same digest. The recorder waits for the
    disk rather than drop a frame that was scored. `others` may be what lies there instead.
    """
    source = _Inspected(camera, begin(appearance, policy), on_scored)
    if record_to is None:
        for _ in source.frames():
            pass
    else:
        record(source, record_to, product_id=product_id, part_id=part_id, lossless=True)
    return conclude(source.state, others=others)
