"""What can go wrong with an inspection; every class writes its own sentence.

inspector.errors.WorldError
├── AtCapacity               one inspection more than can be scored in time
├── Stopping                 the service takes nothing new: it is being stopped
├── NoRecipe                 a product without an active recipe
├── NotOpen                  something is asked of an inspection that takes no more frames
├── Busy                     a frame finds no room to wait; nothing has changed
├── TooManyFrames            an inspection that is longer than allowed
├── OutOfOrder               a frame whose number is not above all before, and that never came
├── Moved                    an inspection that another process goes on with
├── ResumeFrom               a frame that came before those that a process lost
├── ScorerLost               the process that scored an inspection is gone
├── PictureRefused           a picture that cannot be located
├── LocatorLost              the process that located is gone
├── TooManyTracked           one part more than may be tracked
├── NotConcluded             a result that is not there yet
├── RecordingGone            a recording that is not there any more
└── ScoresGone               scores of frames that are not kept any more
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import ClassVar

from inspector.errors import WorldError
from inspector.stores.records import RecordingState


class AtCapacity(WorldError):
    """One inspection more than can be scored in time."""

    retry_after = 5

    def __init__(self, why: str) -> None:
        super().__init__(f"no capacity for one more inspection: {why}; try again in a few seconds")


class Stopping(WorldError):
    """The service takes nothing new: it is being stopped."""

    retry_after = 10

    def __init__(self) -> None:
        super().__init__("the service is being stopped; try again when it runs")


class NoRecipe(WorldError):
    """A product without an active recipe."""

    def __init__(self, product_id: str) -> None:
        super().__init__(f"product {product_id!r} has no active recipe: learn an appearance, and make a recipe of it")


class NotOpen(WorldError):
    """Something is asked of an inspection that takes no more frames."""

    def __init__(self, inspection_id: str) -> None:
        super().__init__(f"inspection {inspection_id!r} takes no more frames: it is being concluded, or has ended")


class Busy(WorldError):
    """A frame finds no room to wait; nothing has changed."""

    retry_after = 1

    def __init__(self, waiting: int) -> None:
        super().__init__(f"{waiting} frames wait already; send this one again when one of them is answered")


class TooManyFrames(WorldError):
    """An inspection that is longer than allowed."""

    def __init__(self, allowed: int) -> None:
        super().__init__(f"the inspection has {allowed} frames, and no more are allowed; conclude it")


class OutOfOrder(WorldError):
    """A frame whose number is not above all before, and that never came."""

    def __init__(self, sequence: int, wanted: int) -> None:
        super().__init__(f"frame {sequence} comes too late: the next number is {wanted} or higher")


class ScorerLost(WorldError):
    """The process that scored an inspection is gone."""

    def __init__(self, inspection_id: str, why: str) -> None:
        super().__init__(f"inspection {inspection_id!r} is lost: {why}; begin another one")


class Moved(WorldError):
    """An inspection that another process goes on with, or soon will."""

    retry_after = None
    """At once."""

    def __init__(self, inspection_id: str) -> None:
        super().__init__(f"inspection {inspection_id!r} goes on in another process; send this once more")


class ResumeFrom(WorldError):
    """Frames were lost with a process that had the inspection, and are wanted first."""

    def __init__(self, inspection_id: str, wanted: int, came: int) -> None:
        super().__init__(
            f"inspection {inspection_id!r} goes on from frame {wanted}, and frame {came} came; send all from there "
            "once more, or go on with the next one if they are gone"
        )
        self.facts = {"next_sequence": wanted}


class PictureRefused(WorldError):
    """A picture that cannot be located: not readable, or of another size than those learnt from."""


class LocatorLost(WorldError):
    """The process that located is gone."""

    def __init__(self, why: str) -> None:
        super().__init__(f"nothing was located: {why}; send the picture again")


class TooManyTracked(WorldError):
    """One part more than may be tracked."""

    retry_after = 5

    def __init__(self, most: int) -> None:
        super().__init__(f"{most} parts are tracked, and no more may be; close another connection first")


class NotConcluded(WorldError):
    """A result that is not there yet."""

    def __init__(self, inspection_id: str, what: str = "result") -> None:
        super().__init__(f"inspection {inspection_id!r} is processing; there is a {what} when it is concluded")


class RecordingGone(WorldError):
    """A recording that is not there any more."""

    _WHY: ClassVar[dict[RecordingState, str]] = {
        "being written": "it is being written",
        "kept": "its file is not where it was kept",
        "none": "no frame came",
        "removed": "it was removed",
    }

    def __init__(self, inspection_id: str, recording: RecordingState, note: str | None) -> None:
        # What is noted of a kept one is what it lacks, not why it is gone.
        why = self._WHY[recording] if recording == "kept" or not note else note
        super().__init__(f"there is no recording of inspection {inspection_id!r}: {why}")


class ScoresGone(WorldError):
    """Scores of frames that are not kept any more."""

    def __init__(self, inspection_id: str, removed_ns: int) -> None:
        since = datetime.fromtimestamp(removed_ns / 1e9, UTC)
        super().__init__(
            f"there are no scores of the frames of inspection {inspection_id!r} any more: they were removed on "
            f"{since:%Y-%m-%d}, as the setting `keep_scores_days` has it; its result stays, with its profile"
        )
