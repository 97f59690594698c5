"""Golden recordings -> an appearance on the disk: whole or not at all, and no loss in a recording goes untold."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from inspector.errors import PictureUnreadable
from inspector.files import refuse_taken, write_new
from inspector.locations import Location, RemoteFile, to_location
from inspector.pictures import decode
from inspector.recording import SweepReader, count_frames
from models.appearance import Appearance
from models.errors import AppearanceError, NumericError, PictureError, SweepsDiffer
from models.frame import EncodedPicture, Frame
from models.learning import absorb, learn, left_out
from models.spread import ODD


class _Golden:
    """A recording that enters itself in a list when it is begun, and tells each loss once."""

    def __init__(
        self, path: Path | RemoteFile | str, topic: str | None, tell: Callable[[str], object], begun: list[Location]
    ) -> None:
        self.reader = SweepReader(path, topic=topic)
        self._tell, self._told, self._begun = tell, set[str](), begun

    def __iter__(self) -> Iterator[Frame]:
        self._begun.append(self.reader.path)
        yield from self.reader
        for loss in self.reader.losses:
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
) -> Appearance:
    """Learn from golden recordings, the first as reference, and write the appearance to the new file `out`.

    `ignore` is a picture of the size of the others, white where nothing is said and black elsewhere. `progress` is
    called with the share done, `tell` with a sentence for each thing that a recording has lost, and for
    each recording that was left out because it is unlike the others. Raises RecordingError, OutputExists,
    NotWritten; LearningError and PictureError name the recording.
    """
    out, begun = Path(out), list[Location]()
    refuse_taken(out)
    mask = None if ignore is None else read_mask(ignore)
    goldens = [_Golden(path, topic, tell, begun) for path in paths]
    with _blamed_on(begun):
        appearance = learn(goldens, progress, _announced(goldens), ignore=mask)
    for said in _doubts(appearance, [golden.reader.path for golden in goldens]):
        tell(said)
    write_new(out, appearance.to_bytes())
    return appearance


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
    to: Path | str,
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
