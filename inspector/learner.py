"""Golden recordings -> an appearance on the disk: whole or not at all, and no loss in a recording goes untold."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, UInt8

from inspector.errors import PictureUnreadable, RecordingError
from inspector.files import refuse_taken, write_new
from inspector.locations import Location, RemoteFile, to_location
from inspector.pictures import decode
from inspector.recording import SweepReader, count_frames
from models.appearance import Appearance
from models.errors import AppearanceError, InspectionError, LearningError, NumericError, PictureError, SweepsDiffer
from models.frame import EncodedPicture, Frame
from models.learning import ShownBy, absorb, learn, left_out, shown_by
from models.spread import ODD

if TYPE_CHECKING:
    from inspector.executors import Executor


class _Golden:
    """A recording that enters itself in a list when it is begun, and tells each loss once."""

    def __init__(
        self, path: Path | RemoteFile | str, topic: str | None, tell: Callable[[str], object], begun: list[Location]
    ) -> None:
        self.reader, self.topic = SweepReader(path, topic=topic), topic
        self._tell, self._told, self._begun = tell, set[str](), begun

    def __iter__(self) -> Iterator[Frame]:
        self.begin()
        yield from self.reader
        self.lost(self.reader.losses)

    def begin(self) -> None:
        """What goes wrong from now on is of this one."""
        self._begun.append(self.reader.path)

    def lost(self, losses: Sequence[str]) -> None:
        """What a pass over it lost."""
        for loss in losses:
            if loss not in self._told:
                self._told.add(loss)
                self._tell(f"{self.reader.path}: {loss}")


def learn_recordings(
    paths: Sequence[Path | RemoteFile | str],
    out: Path | str,
    progress: Callable[[float], None] | None = None,
    *,
    topic: str | None = None,
    ignore: Path | str | None = None,
    tell: Callable[[str], object] = lambda said: None,
    executor: Executor | None = None,
) -> Appearance:
    """Learn from golden recordings, the first as reference, and write the appearance to the new file `out`.

    With an executor the further ones are read several at a time; what is learnt is the same, byte for byte.

    `ignore` is a picture of the size of the others, white where nothing is said and black elsewhere. `progress` is
    called with the share done, `tell` with a sentence for each thing that a recording has lost, and for
    each recording that was left out because it is unlike the others. Raises RecordingError, OutputExists,
    NotWritten; LearningError and PictureError name the recording.
    """
    out, begun = Path(out), list[Location]()
    refuse_taken(out)
    mask = None if ignore is None else read_mask(ignore)
    goldens = [_Golden(path, topic, tell, begun) for path in paths]
    further = None if executor is None else partial(_shown_elsewhere, executor, goldens, progress)
    with _blamed_on(begun):
        appearance = learn(goldens, progress, _announced(goldens), ignore=mask, showing=further)
    for said in _doubts(appearance, [golden.reader.path for golden in goldens]):
        tell(said)
    write_new(out, appearance.to_bytes())
    return appearance


@dataclass(frozen=True, eq=False)
class _Seen:
    """What came of a golden recording that was read elsewhere."""

    number: int
    shown: ShownBy | None
    losses: tuple[str, ...] = ()
    error: InspectionError | None = None


def _shown_elsewhere(
    executor: Executor,
    goldens: Sequence[_Golden],
    progress: Callable[[float], None] | None,
    appearance: Appearance,
    numbers: Sequence[int],
) -> list[ShownBy]:
    """Raises what reading them one after the other would raise, and WorkersLost."""
    things = [(number, goldens[number].reader.path, goldens[number].topic) for number in numbers]
    seen: dict[int, _Seen] = {}
    for each in executor.each(_shown_here, things, packed(appearance)):
        seen[each.number] = each
        if progress:
            progress((len(goldens) - len(numbers) + len(seen)) / len(goldens))
    shown: list[ShownBy] = []
    for number in numbers:
        each = seen[number]
        goldens[number].begin()
        goldens[number].lost(each.losses)
        if each.shown is None:
            raise each.error or LearningError("nothing was learnt")
        shown.append(each.shown)
    return shown


def _shown_here(golden: tuple[int, Location, str | None], appearance: UInt8[np.ndarray, " bytes"]) -> _Seen:
    """In a worker. Errors are told by what arrives elsewhere as it was: a kind and a sentence."""
    number, path, topic = golden
    try:
        reader = SweepReader(path, topic=topic)
        shown = shown_by(unpacked(appearance), reader, number)
    except NumericError as error:
        return _Seen(number, None, error=type(error)(str(error)))
    except InspectionError as error:
        return _Seen(number, None, error=RecordingError(str(error)))
    return _Seen(number, shown, reader.losses)


def packed(appearance: Appearance) -> UInt8[np.ndarray, " bytes"]:
    """An appearance for workers elsewhere, who need no file of it; an array is sent once."""
    return np.frombuffer(appearance.to_bytes(), np.uint8)


def unpacked(data: UInt8[np.ndarray, " bytes"]) -> Appearance:
    """What was packed; read once in each process."""
    return _of_bytes(data.tobytes())


_of_bytes = lru_cache(maxsize=2)(Appearance.from_bytes)


def _doubts(appearance: Appearance, paths: Sequence[Location]) -> Iterator[str]:
    """What should be looked at before the appearance is trusted."""
    left = {odd.sweep: odd for odd in left_out(appearance)}
    for sweep, odd in left.items():
        yield (
            f"{paths[sweep]}: left out: it reaches {odd.reached:.1f} times the assumed tolerance, "
            f"where golden sweeps usually reach {odd.usual:.1f}; is this part defective?"
        )
    used = [str(path) for sweep, path in enumerate(paths) if sweep not in left]
    if len(used) == 2 and appearance.peaks[0] > ODD:
        yield (
            f"{', '.join(used)}: they differ by {appearance.peaks[0]:.1f} times the assumed tolerance, and as much is "
            "tolerated; is one of the parts defective? A third golden sweep would tell which"
        )


def add_recordings(
    paths: Sequence[Path | RemoteFile | str],
    to: Path | RemoteFile | str,
    out: Path | str,
    progress: Callable[[float], None] | None = None,
    *,
    topic: str | None = None,
    tell: Callable[[str], object] = lambda said: None,
) -> Appearance:
    """The appearance in the file `to` with more good sweeps absorbed, one after the other, as the new file `out`.

    Costs what reading these sweeps costs. The rest is as for `learn_recordings`; a sweep that is unlike the golden
    ones is an error. Raises AppearanceError, too.
    """
    out, begun = Path(out), list[Location]()
    refuse_taken(out)
    old = appearance = load_appearance(to)
    goldens = [_Golden(path, topic, tell, begun) for path in paths]
    with _blamed_on(begun):
        for done, golden in enumerate(goldens):
            appearance = absorb(appearance, golden, _part_of(progress, done, len(goldens)), _announced([golden]))
    appearance = replace(appearance, facts={**appearance.facts, "added_to": old.id})
    write_new(out, appearance.to_bytes())
    return appearance


def _part_of(progress: Callable[[float], None] | None, done: int, of: int) -> Callable[[float], None] | None:
    """Progress of one of several recordings."""
    return (lambda share: progress((done + share) / of)) if progress else None


@contextmanager
def _blamed_on(begun: Sequence[Location]) -> Generator[None]:
    """What is wrong with a recording names it: the last one begun, or all where it may be any."""
    try:
        yield
    except NumericError as error:
        names = begun if isinstance(error, SweepsDiffer) else begun[-1:]
        raise type(error)(f"{', '.join(map(str, names))}: {error}") from error


def _announced(goldens: Sequence[_Golden]) -> int | None:
    """How many frames there will be, where every recording says it."""
    counts = [count_frames(golden.reader.path) for golden in goldens]
    known = [count for count in counts if count is not None]
    return sum(known) if len(known) == len(counts) else None


def read_mask(path: Path | str) -> Bool[np.ndarray, "h w"]:
    """A don't-care mask: True where a picture is white. Raises PictureError, which names the file."""
    try:
        pixels = decode(EncodedPicture("", Path(path).read_bytes()))
    except OSError as error:
        raise PictureError(
            f"{path}: {error.strerror or error}; allowed is a picture, white where not to look"
        ) from error
    except PictureUnreadable as error:
        raise PictureError(f"{path}: {error}") from error
    grey = pixels if pixels.ndim == 2 else pixels.min(axis=2)
    return grey > np.iinfo(grey.dtype).max // 2


def load_appearance(path: Path | RemoteFile | str) -> Appearance:
    """The appearance in a file, or by URL. Raises AppearanceError, which names it, whatever is wrong; ObjectError."""
    try:
        return Appearance.from_bytes(to_location(path).read_bytes())
    except OSError as error:
        raise AppearanceError(f"{path}: {error.strerror or error}; allowed is a file that `learn` wrote") from error
    except AppearanceError as error:
        raise AppearanceError(f"{path}: {error}") from error
