"""A camera's or a recording's frames -> where the part is in each, and how it was tracked in all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from inspector.workspaces import located_record, named
from models.errors import PictureError
from models.frame import Frame
from models.tracking import Locates, Tracked, begin, step
from models.workspace import Workspace


@dataclass(frozen=True)
class TrackingSummary:
    """How tracking went, so far or in the end."""

    frames: int = 0
    seen: int = 0
    """Frames in which the part was found."""
    losses: int = 0
    """How often it was lost."""
    longest: int = 0
    """Frames of the longest loss."""

    def with_frame(self, tracked: Tracked) -> TrackingSummary:
        """One frame more."""
        return replace(
            self,
            frames=self.frames + 1,
            seen=self.seen + (tracked.state in ("tracking", "recovered")),
            losses=self.losses + (tracked.unseen == 1),
            longest=max(self.longest, tracked.unseen),
        )

    def sentence(self) -> str:
        """In words.

        >>> TrackingSummary(300, 290, 1, 10).sentence()
        'found in 290 of 300 frames, lost once, for 10 frames at the longest'
        """
        if not self.seen:
            return f"not found in any of {self.frames} frames"
        found = f"found in {self.seen} of {self.frames} frames"
        if not self.losses:
            return f"{found}, never lost"
        often = {1: "once", 2: "twice"}.get(self.losses, f"{self.losses} times")
        return f"{found}, lost {often}, for {self.longest} frames at the longest"


def track(frames: Iterable[Frame], workspace: Locates) -> Iterator[tuple[Frame, Tracked]]:
    """Each frame of a camera that stands still, and what it says. Raises PictureError, which names the frame."""
    tracking = begin(workspace)
    for frame in frames:
        try:
            tracking, tracked = step(tracking, frame.pixels, frame.t_ns)
        except PictureError as error:
            raise PictureError(f"frame {frame.sequence}: {error}") from error
        yield frame, tracked


def tracked_record(sequence: int, tracked: Tracked, workspace: Workspace) -> dict[str, Any]:
    """One frame for scripts: what `locate` says of the picture, and what tracking makes of it."""
    return {
        "sequence": sequence,
        "t_ns": tracked.t_ns,
        **located_record(tracked.located, workspace),
        "tracking": tracked.state,
        "tracked": tracked.object,
        "place": named(tracked.place, workspace),
        "velocity": named(tracked.velocity, workspace),
        "unseen": tracked.unseen,
    }
