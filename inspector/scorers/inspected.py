"""One inspection inside a scorer process: a picture's bytes in, the messages about it out; the one scoring path."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from inspector.errors import PictureUnreadable
from inspector.picture_headers import kind_of
from inspector.pictures import decode
from inspector.result_json import deviation_record, frame_record, frame_records, number, result_record
from inspector.scorers.saved import Going, Saved, save
from inspector.scorers.tape import Tape
from inspector.scores_json import scores_to_bytes
from models.appearance import Appearance
from models.deviations import Deviations
from models.errors import PictureError
from models.frame import EncodedPicture, Frame
from models.inspection import begin, conclude, step
from models.judging import place
from models.limits import promise
from models.verdict import Deviation, Judgement, Policy, ScoredFrame

Said = dict[str, Any]
"""A message as the protocol describes it, but for its number."""
_ASK_AGAIN = 8
"""Frames after which it is asked once more whether NG is certain."""
_UNFINISHED = {Judgement.OK, Judgement.REVIEW}
"""What may not be said of a part whose inspection was broken off."""


@dataclass(frozen=True)
class Names:
    """Who is inspected, by what, for the result."""

    inspection_id: str
    product_id: str
    part_id: str
    recipe_id: str
    result_id: str


@dataclass(frozen=True)
class Concluded:
    """An inspection that has ended."""

    result: Said
    """Without frames."""
    frames: bytes
    """As JSON."""
    scores: bytes
    doubted: bool
    """Whether it is INVALID because another part lay there, and not because it was broken off."""


class Inspected:
    """The state of one inspection, its recording, and the deviations that are open."""

    def __init__(
        self,
        appearance: Appearance,
        policy: Policy,
        names: Names,
        tape: Tape,
        *,
        max_pixels: int,
        going: Going | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """From the beginning, or going on."""
        self.tape = tape
        self._names, self._max_pixels, self._clock = names, max_pixels, clock
        self._state = begin(appearance, policy)
        self._deviations = Deviations(policy, place(appearance.s))
        self._early = False
        self._foreign: bool | None = None
        """Whether it was said that another part lies there; None before."""
        self.doubted: tuple[bytes, ...] = ()
        """Pictures of the beginning of such a sweep, when that has just been said."""
        self.sequence: int | None = None
        """Of the last frame that was handled, refused or not."""
        self._saved_frames = self._saved_kept = 0
        """How many are saved already."""
        if going is not None:
            self._go_on(going)

    def save(self) -> Saved:
        """To go on elsewhere: the state, and what came since it was saved before."""
        kept, frames = self._state.beginning.kept, self._state.frames
        new = frames[self._saved_frames :], kept[self._saved_kept :]
        self._saved_frames, self._saved_kept = len(frames), max(self._saved_kept, len(kept))
        return save(Going(self._state, self.sequence, self._early, self._foreign), *new)

    def _go_on(self, going: Going) -> None:
        self._state, self.sequence = going.inspection, going.sequence
        self._early, self._foreign = going.early, going.foreign
        for scored in self._state.frames:
            self._deviations, _, _ = self._deviations.step(scored)
        self._saved_frames, self._saved_kept = self._state.count, len(self._state.beginning.kept)

    def frame(self, sequence: int, t_ns: int, encoder: float | None, picture: bytes) -> tuple[list[Said], Said]:
        """What is to be said about a frame, and how many seconds decoding, scoring and handing to the tape took."""
        at, self.sequence = [self._clock()], sequence
        try:
            encoded = EncodedPicture(kind_of(picture) or "", picture)
            pixels = decode(encoded, max_pixels=self._max_pixels)
            at.append(self._clock())
            frame = Frame(pixels, t_ns, sequence, encoder, encoded)
            self._state, scored = step(self._state, frame)
        except (PictureUnreadable, PictureError) as error:
            self.tape.drop(1, t_ns)
            return [{"kind": "refused", "sequence": sequence, "why": str(error)}], {}
        at.append(self._clock())
        self.tape.write(frame)
        said: list[Said] = [{"kind": "scored", "sequence": sequence, **frame_record(scored)}, *self._news(scored)]
        at.append(self._clock())
        return said, {"decode": at[1] - at[0], "score": at[2] - at[1], "record": at[3] - at[2]}

    def drop(self, count: int, t_ns: int) -> None:
        """Frames that the service could not take in time."""
        self.tape.drop(count, t_ns)

    def end(self, announced: int, *, stopped: bool = False, aborted: str | None = None) -> Concluded:
        """The verdict. `announced` counts the frames from the first number to the last, whatever became of them."""
        result = replace(conclude(self._state, stopped), frames_dropped=announced - self._state.count)
        if aborted is not None:
            verdict = Judgement.INCOMPLETE if result.verdict in _UNFINISHED else result.verdict
            result = replace(result, verdict=verdict, reasons=(f"aborted: {aborted}", *result.reasons))
        names, promised = self._names, promise(self._state.appearance.peaks, self._state.policy.false_rejects)
        record = result_record(
            result,
            {"product_id": names.product_id, "part_id": names.part_id},
            is_simulated=False,
            recipe_id=names.recipe_id,
            promise=promised,
            result_id=names.result_id,
            with_frames=False,
        ) | {"inspection_id": names.inspection_id, "stopped": stopped}
        if aborted is not None:
            record |= {"result_state": "aborted", "is_partial": True}
        frames = json.dumps(frame_records(result.frames), allow_nan=False).encode()
        doubted = self._state.beginning.doubted and result.verdict is Judgement.INVALID and aborted is None
        return Concluded(record, frames, scores_to_bytes(result.frames), doubted)

    def _news(self, scored: ScoredFrame) -> list[Said]:
        """Deviations that opened or closed with this frame, and whether NG is certain."""
        self._deviations, opened, closed = self._deviations.step(scored)
        said: list[Said] = [{"kind": "deviation_closed", "deviation": deviation_record(each)} for each in closed]
        said += [{"kind": "deviation_opened", "deviation": deviation_record(each)} for each in opened]
        said += self._begun(scored)
        if not self._early and self._suspected(opened, scored):
            so_far = conclude(self._state, stopped=True)
            if so_far.verdict is Judgement.NG:
                self._early = True
                said.append(
                    {
                        "kind": "early_ng",
                        "index": scored.index,
                        "s": number(scored.s or 0.0),
                        "coverage": number(so_far.coverage),
                    }
                )
        return said

    def _begun(self, scored: ScoredFrame) -> list[Said]:
        """Whether the sweep begins with another part, or with this one after all."""
        beginning, self.doubted = self._state.beginning, ()
        if self._foreign is None and beginning.failed:
            so_far = conclude(self._state)
            if so_far.verdict is Judgement.INVALID:
                self._foreign = True
                self.doubted = tuple(frame.encoded.data for frame in beginning.kept if frame.encoded is not None)
                return [{"kind": "early_invalid", "index": scored.index, "reason": so_far.reasons[0]}]
        if self._foreign and beginning.confirmed:
            self._foreign = False
            return [{"kind": "part_found", "index": scored.index}]
        return []

    def _suspected(self, opened: tuple[Deviation, ...], scored: ScoredFrame) -> bool:
        if any(each.kind == "appearance" for each in opened):
            return True
        return scored.index % _ASK_AGAIN == 0 and any(each.kind == "appearance" for each in self._deviations.all)
